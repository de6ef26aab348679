"""The modes that the pilot's sticks fly. Approximations: the plant takes velocities, not lean angles.

LOITER and POSHOLD: sticks ask for a velocity, centred sticks brake and hold the place. ALT_HOLD and STABILIZE: sticks
lean the vehicle, so they ask for an acceleration against drag, and centred sticks drift on. STABILIZE has no height
control: the throttle asks for a vertical speed.
"""

from __future__ import annotations

import math

from sitl.autopilot.modes import Mode
from sitl.autopilot.motion import Limits, Motion
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.rc import LOW_US, MIDDLE_US, PITCH, ROLL, YAW, RcInput

GRAVITY_M_S2 = 9.80665
# ArduPilot's ANGLE_MAX and PILOT_ACCEL_Z.
LEAN_MAX_RAD = math.radians(30.0)
PILOT_ACCEL_Z_M_S2 = 2.5
# Drag of a leaning vehicle: at full lean about 14 m/s.
DRAG_1_S = 0.4
# What full or closed throttle gives in STABILIZE.
STABILIZE_SPEED_M_S = 5.0
LEAN_ACCEL_M_S2 = GRAVITY_M_S2 * math.tan(LEAN_MAX_RAD)
# LOIT_ACC_MAX; a lean follows the stick within tenths of a second.
LOITER_LIMITS = Limits(5.0, PILOT_ACCEL_Z_M_S2)
LEAN_LIMITS = Limits(LEAN_ACCEL_M_S2, PILOT_ACCEL_Z_M_S2, 20.0)


class PilotModes:
    """State of the modes flown by hand."""

    __slots__ = ("_drift_ne", "_motion", "_parameters", "_rc")

    def __init__(self, motion: Motion, parameters: Parameters, rc: RcInput) -> None:
        self._motion = motion
        self._parameters = parameters
        self._rc = rc
        self._drift_ne = (0.0, 0.0)

    def enter(self) -> None:
        """The mode begins: drift on at the present velocity."""
        north, east, _ = self._motion.vehicle.vel_ned_m_s
        self._drift_ne = (north, east)

    def run(self, mode: Mode, t_s: float, dt_s: float) -> None:
        """Fly one tick."""
        yaw_rate = self._rc.stick(YAW, t_s) * math.radians(self._parameters["PILOT_Y_RATE"])
        leaning = mode in (Mode.STABILIZE, Mode.ALT_HOLD)
        horizontal = self._drifted(t_s, dt_s) if leaning else self._loitered(t_s)
        down = self._thrown(t_s) if mode is Mode.STABILIZE else self.climb_wish(t_s)
        self._motion.fly(horizontal, down, yaw_rate, t_s, dt_s, LEAN_LIMITS if leaning else LOITER_LIMITS)

    def wants_to_lift(self, mode: Mode, t_s: float) -> bool:
        """On the ground: the throttle asks for a take-off."""
        if mode is Mode.STABILIZE:
            return self._rc.throttle_us(t_s) > MIDDLE_US
        return self._rc.climb(t_s) > 0.0

    def climb_wish(self, t_s: float) -> float:
        """Vertical velocity from the throttle, down +; in the middle it keeps the height."""
        wish = self._rc.climb(t_s)
        if wish == 0.0:
            return self._motion.keep_height()
        self._motion.down_target_m = None
        up = self._parameters["PILOT_SPEED_UP"] * 0.01
        down = self._parameters["PILOT_SPEED_DN"] * 0.01 or up
        return -wish * (up if wish > 0.0 else down)

    def _thrown(self, t_s: float) -> float:
        throttle = (self._rc.throttle_us(t_s) - LOW_US) / (2.0 * (MIDDLE_US - LOW_US))
        return STABILIZE_SPEED_M_S * (1.0 - 2.0 * throttle)

    def _asked(self, t_s: float) -> tuple[float, float]:
        """Sticks as a vector in north and east: forward is pitch stick forward, which is a short pulse."""
        forward, right = -self._rc.stick(PITCH, t_s), self._rc.stick(ROLL, t_s)
        yaw = self._motion.vehicle.yaw_rad
        c, s = math.cos(yaw), math.sin(yaw)
        return c * forward - s * right, s * forward + c * right

    def _loitered(self, t_s: float) -> tuple[float, float]:
        north, east = self._asked(t_s)
        if north == east == 0.0:
            return self._motion.hold_velocity()
        self._motion.leave_place()
        speed = self._parameters["LOIT_SPEED"] * 0.01
        return speed * north, speed * east

    def _drifted(self, t_s: float, dt_s: float) -> tuple[float, float]:
        north, east = self._asked(t_s)
        vn, ve = self._drift_ne
        self._drift_ne = (
            vn + (LEAN_ACCEL_M_S2 * north - DRAG_1_S * vn) * dt_s,
            ve + (LEAN_ACCEL_M_S2 * east - DRAG_1_S * ve) * dt_s,
        )
        return self._drift_ne
