"""From what a flight mode wants to what the vehicle is told: shaped velocities, position hold, heading.

North, east, down; radians. Nothing here knows of MAVLink or of modes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from sitl.autopilot.parameters import Parameters
from sitl.autopilot.ports import Vehicle
from sitl.plant.shaping import VelocityShaper

# ArduPilot's PSC_JERK_XY and PSC_JERK_Z.
JERK_M_S3 = 5.0
# ArduPilot's PSC_POSXY_P and PSC_POSZ_P.
POSITION_P_1_S = 1.0
# Heights are approached along a path that slows down evenly until shortly before the end, so its end is stiffer.
HEIGHT_P_1_S = 2.5
# Position errors are closed with half of the acceleration that the shaping may use, so that the shaping can follow;
# the recorded take-off slows down at 0.54 m/s2 with WPNAV_ACCEL_Z at 1.
POSITION_ACCEL_SHARE = 0.5
# "Up to 10.7 m/s whatever is asked" with WPNAV_SPEED at 10: the cap as it was seen.
SPEED_CAP_FACTOR = 1.07
# Below this speed a vehicle that brakes has come to rest and its place is held from then on.
REST_M_S = 0.15
# Heading control towards an angle: ArduPilot's yaw gain, slowed for the lag of the plant's rate loop.
YAW_P_1_S = 1.5
YAW_SLEW_RAD_S = math.radians(60.0)


def wrap(angle_rad: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle_rad + math.pi) % math.tau - math.pi


def closing_speed(error_m: float, accel_m_s2: float, p_1_s: float = POSITION_P_1_S) -> float:
    """Speed (m/s, with the sign of the error) that closes a position error: linear near zero, a square root beyond."""
    linear_m = accel_m_s2 / (p_1_s * p_1_s)
    if abs(error_m) <= linear_m:
        return p_1_s * error_m
    return math.copysign(math.sqrt(2.0 * accel_m_s2 * (abs(error_m) - 0.5 * linear_m)), error_m)


class Limits(NamedTuple):
    """How a velocity may change."""

    accel_m_s2: float
    accel_z_m_s2: float
    jerk_m_s3: float = JERK_M_S3


class Motion:
    """Drives a `Vehicle` with limited acceleration and jerk; keeps the state that has to survive a mode change."""

    __slots__ = ("_hold_ne", "_horizontal", "_limits", "_parameters", "_vertical", "down_target_m", "vehicle")

    def __init__(self, vehicle: Vehicle, parameters: Parameters) -> None:
        self.vehicle = vehicle
        self._parameters = parameters
        self._hold_ne: tuple[float, float] | None = None
        self.down_target_m: float | None = None
        self._limits = Limits(parameters["WPNAV_ACCEL"] * 0.01, parameters["WPNAV_ACCEL_Z"] * 0.01)
        self._horizontal = VelocityShaper(self._limits.accel_m_s2, self._limits.jerk_m_s3, 2)
        self._vertical = VelocityShaper(self._limits.accel_z_m_s2, JERK_M_S3, 1)

    def _limit(self, limits: Limits) -> None:
        """New limits; velocity and acceleration go on from where they are."""
        if limits == self._limits:
            return
        horizontal = VelocityShaper(limits.accel_m_s2, limits.jerk_m_s3, 2)
        vertical = VelocityShaper(limits.accel_z_m_s2, JERK_M_S3, 1)
        horizontal.velocity, horizontal.accel = self._horizontal.velocity, self._horizontal.accel
        vertical.velocity, vertical.accel = self._vertical.velocity, self._vertical.accel
        self._horizontal, self._vertical, self._limits = horizontal, vertical, limits

    @property
    def height_m(self) -> float:
        """Height above home."""
        return -self.vehicle.pos_ned_m[2]

    @property
    def speed_m_s(self) -> float:
        """Horizontal speed over ground."""
        north, east, _ = self.vehicle.vel_ned_m_s
        return math.hypot(north, east)

    @property
    def speed_up_m_s(self) -> float:
        """Fastest climb of the guided and automatic modes."""
        return self._parameters["WPNAV_SPEED_UP"] * 0.01

    @property
    def speed_down_m_s(self) -> float:
        """Fastest descent of the guided and automatic modes, positive."""
        return self._parameters["WPNAV_SPEED_DN"] * 0.01

    def restart(self) -> None:
        """Take over from whatever flew before: start at the present velocity and hold no place yet."""
        north, east, down = self.vehicle.vel_ned_m_s
        self._horizontal.reset((north, east))
        self._vertical.reset((down,))
        self.release()

    def release(self) -> None:
        """Forget the place and the height that were held (mode change)."""
        self._hold_ne = None
        self.down_target_m = None

    def leave_place(self) -> None:
        """Forget the place that was held."""
        self._hold_ne = None

    def fly(
        self,
        velocity_ne_m_s: tuple[float, float],
        down_m_s: float,
        yaw_rate_rad_s: float,
        t_s: float,
        dt_s: float,
        limits: Limits | None = None,
    ) -> None:
        """Shape these velocities with the given or the guided modes' limits and tell the vehicle."""
        if limits is None:
            parameters = self._parameters
            limits = Limits(parameters["WPNAV_ACCEL"] * 0.01, parameters["WPNAV_ACCEL_Z"] * 0.01)
            velocity_ne_m_s = limited(velocity_ne_m_s, SPEED_CAP_FACTOR * parameters["WPNAV_SPEED"] * 0.01)
        self._limit(limits)
        north, east = self._horizontal.step(velocity_ne_m_s, dt_s)
        (down,) = self._vertical.step((down_m_s,), dt_s)
        accel = (*self._horizontal.accel, *self._vertical.accel)
        self.vehicle.command((north, east, down), yaw_rate_rad_s, t_s, (accel[0], accel[1], accel[2]))

    def hold_velocity(self) -> tuple[float, float]:
        """Horizontal velocity that brakes to rest and then keeps the place where it came to rest."""
        position = self.vehicle.pos_ned_m
        if self._hold_ne is None:
            if self.speed_m_s > REST_M_S or math.hypot(*self._horizontal.velocity) > REST_M_S:
                return 0.0, 0.0
            self._hold_ne = (position[0], position[1])
        return self.velocity_to(self._hold_ne)

    def velocity_to(self, place_ne_m: tuple[float, float]) -> tuple[float, float]:
        """Horizontal velocity towards a place, at most WPNAV_SPEED."""
        position = self.vehicle.pos_ned_m
        north, east = place_ne_m[0] - position[0], place_ne_m[1] - position[1]
        distance = math.hypot(north, east)
        if distance < 1e-6:
            return 0.0, 0.0
        speed = closing_speed(distance, POSITION_ACCEL_SHARE * self._parameters["WPNAV_ACCEL"] * 0.01)
        speed = min(speed, self._parameters["WPNAV_SPEED"] * 0.01)
        return speed * north / distance, speed * east / distance

    def down_to(self, down_m: float) -> float:
        """Vertical velocity towards a height, within the climb and descent speeds."""
        accel = POSITION_ACCEL_SHARE * self._parameters["WPNAV_ACCEL_Z"] * 0.01
        wanted = closing_speed(down_m - self.vehicle.pos_ned_m[2], accel, HEIGHT_P_1_S)
        return min(self.speed_down_m_s, max(-self.speed_up_m_s, wanted))

    def keep_height(self) -> float:
        """Vertical velocity that brakes and then keeps the height where the vertical speed came to rest."""
        down = self.vehicle.pos_ned_m[2]
        if self.down_target_m is None:
            if abs(self.vehicle.vel_ned_m_s[2]) > REST_M_S:
                return 0.0
            self.down_target_m = down
        return self.down_to(self.down_target_m)

    def yaw_rate_to(self, yaw_rad: float) -> float:
        """Yaw rate that turns the nose to an azimuth, within the slew limit."""
        rate = YAW_P_1_S * wrap(yaw_rad - self.vehicle.yaw_rad)
        return min(YAW_SLEW_RAD_S, max(-YAW_SLEW_RAD_S, rate))


def limited(vector: tuple[float, float], most: float) -> tuple[float, float]:
    """`vector`, shortened to the length `most` where it is longer."""
    length = math.hypot(*vector)
    if length <= most:
        return vector
    return vector[0] * most / length, vector[1] * most / length
