"""Runs of the simulator with this application in the loop; the one part of it that knows the simulator."""
