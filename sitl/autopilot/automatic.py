"""LAND, RTL and BRAKE."""

from __future__ import annotations

import math
from enum import Enum

from sitl.autopilot.motion import Limits, Motion, closing_speed
from sitl.autopilot.parameters import Parameters

# RTL: home is reached within this distance, at less than this speed.
HOME_RADIUS_M = 2.0
HOME_SPEED_M_S = 0.5
# The climb of RTL ends this close below its height.
HEIGHT_REACHED_M = 0.2
# BRAKE gives up comfort: twice its acceleration a second, so that it stops from 5 m/s in about 2 s.
BRAKE_JERK_M_S3 = 15.0
# ArduPilot's smallest height of the RTL cone.
CONE_MIN_M = 2.0


def land_down(motion: Motion, parameters: Parameters) -> float:
    """Descent of a landing, m/s: WPNAV_SPEED_DN down to LAND_ALT_LOW, then LAND_SPEED to the ground."""
    above_m = motion.height_m - parameters["LAND_ALT_LOW"] * 0.01
    wanted = closing_speed(above_m, parameters["WPNAV_ACCEL_Z"] * 0.01)
    return min(motion.speed_down_m_s, max(parameters["LAND_SPEED"] * 0.01, wanted))


class RtlState(Enum):
    """Where a return to launch is."""

    CLIMB = "climb"
    RETURN = "return"
    WAIT = "wait"
    DESCEND = "descend"


class AutomaticModes:
    """State of the modes that need no pilot and no setpoint."""

    __slots__ = ("_home_at_s", "_motion", "_parameters", "_rtl_height_m", "rtl")

    def __init__(self, motion: Motion, parameters: Parameters) -> None:
        self._motion = motion
        self._parameters = parameters
        self.rtl = RtlState.CLIMB
        self._rtl_height_m = 0.0
        self._home_at_s = 0.0

    def enter_rtl(self) -> None:
        """Choose the height of the way home: RTL_ALT, less near home (cone), never below the present one."""
        motion, parameters = self._motion, self._parameters
        position = motion.vehicle.pos_ned_m
        height = parameters["RTL_ALT"] * 0.01
        if parameters["RTL_CONE_SLOPE"] > 0.0:
            cone_m = parameters["RTL_CONE_SLOPE"] * math.hypot(position[0], position[1])
            height = min(height, max(CONE_MIN_M, cone_m))
        self._rtl_height_m = max(height, motion.height_m)
        self.rtl = RtlState.CLIMB

    def land(self, t_s: float, dt_s: float) -> None:
        """Down on the spot."""
        motion = self._motion
        motion.fly(motion.hold_velocity(), land_down(motion, self._parameters), 0.0, t_s, dt_s)

    def brake(self, t_s: float, dt_s: float) -> None:
        """Stop as hard as BRK_DECEL_CMSS allows and stay."""
        motion = self._motion
        limits = Limits(
            self._parameters["BRK_DECEL_CMSS"] * 0.01, self._parameters["WPNAV_ACCEL_Z"] * 0.01, BRAKE_JERK_M_S3
        )
        motion.fly(motion.hold_velocity(), motion.keep_height(), 0.0, t_s, dt_s, limits)

    def return_home(self, t_s: float, dt_s: float) -> None:
        """Climb, fly home, wait, land."""
        if self.rtl is RtlState.DESCEND:
            self.land(t_s, dt_s)
            return
        motion = self._motion
        horizontal = motion.hold_velocity() if self.rtl is RtlState.CLIMB else motion.velocity_to((0.0, 0.0))
        motion.fly(horizontal, motion.down_to(-self._rtl_height_m), 0.0, t_s, dt_s)
        self._next_state(t_s)

    def _next_state(self, t_s: float) -> None:
        motion = self._motion
        if self.rtl is RtlState.CLIMB:
            if motion.height_m >= self._rtl_height_m - HEIGHT_REACHED_M:
                self.rtl = RtlState.RETURN
        elif self.rtl is RtlState.RETURN:
            position = motion.vehicle.pos_ned_m
            if math.hypot(position[0], position[1]) < HOME_RADIUS_M and motion.speed_m_s < HOME_SPEED_M_S:
                self.rtl, self._home_at_s = RtlState.WAIT, t_s
        elif t_s - self._home_at_s >= self._parameters["RTL_LOIT_TIME"] * 0.001:
            motion.release()
            self.rtl = RtlState.DESCEND
