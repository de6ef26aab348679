"""Simulated autopilots that speak MAVLink 2; no code shared with the application."""
