"""What the autopilot needs of the bodies that it flies; `sitl.plant` has them."""

from __future__ import annotations

from typing import Protocol

Vector = tuple[float, float, float]


class Vehicle(Protocol):
    """A multicopter with an inner velocity loop; NED metres, radians (see `sitl.plant.Quadrotor`)."""

    @property
    def pos_ned_m(self) -> Vector:
        """Position relative to home."""

    @property
    def vel_ned_m_s(self) -> Vector:
        """Velocity over ground."""

    @property
    def roll_rad(self) -> float:
        """Right side down +."""

    @property
    def pitch_rad(self) -> float:
        """Nose up +."""

    @property
    def yaw_rad(self) -> float:
        """Clockwise from north, from above."""

    @property
    def rates_rad_s(self) -> Vector:
        """Body rates: roll, pitch, yaw."""

    on_ground: bool

    def command(
        self, v_ned_m_s: Vector, yaw_rate_rad_s: float, t_s: float, accel_ned_m_s2: Vector = (0.0, 0.0, 0.0)
    ) -> None:
        """Fly this velocity and yaw rate; `accel_ned_m_s2` is the feed-forward that belongs to it."""

    def idle(self) -> None:
        """Motors off."""

    def spin(self) -> None:
        """Motors on, turning at idle."""

    def step(self, t_s: float, dt_s: float) -> None:
        """Advance from `t_s` by `dt_s`."""


class Gimbal(Protocol):
    """A stabilised two-axis gimbal; yaw is relative to the vehicle's heading (see `sitl.plant.GimbalPlant`)."""

    @property
    def measured_pitch_rad(self) -> float:
        """What its encoders and sensors report: up from the horizon +."""

    @property
    def measured_yaw_rad(self) -> float:
        """What its encoders and sensors report: right of the nose +."""

    def command_angle(self, pitch_rad: float, yaw_rad: float, t_s: float) -> None:
        """Point there."""

    def command_rate(self, pitch_rate_rad_s: float, yaw_rate_rad_s: float, t_s: float) -> None:
        """Turn at these rates."""

    def step(self, t_s: float, dt_s: float, roll_rad: float = 0.0, pitch_rad: float = 0.0) -> None:
        """Advance from `t_s` by `dt_s` under a vehicle that leans this far."""
