"""The simulated ground and everything on it."""
