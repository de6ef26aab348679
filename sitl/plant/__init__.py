"""The vehicle of the simulator as physics: wind, quadrotor, gimbal, and the pose of the camera under it.

Plain Python scalars, no clock: every step is told its time. The models are those of a closed velocity loop and of a
stabilised two-axis gimbal, because that is what setpoints can see; propellers and rate loops are too fast for pictures.
"""
