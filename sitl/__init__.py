"""The simulated side of the loop: pictures and vehicles that the application meets only as frames and MAVLink bytes."""
