"""How an autopilot turns a velocity setpoint into a velocity that a vehicle can follow: limited acceleration and jerk.

This belongs to the autopilot, not to the vehicle: `shaped command -> Quadrotor.command` gives the responses that were
recorded of ArduCopter. Its rule is ArduPilot's (`shape_vel_accel` in AP_Math/control.cpp, retold): the wanted
acceleration is proportional to the velocity that is missing, limited, and approached with limited jerk.
"""

from __future__ import annotations

import math


class VelocityShaper:
    """A group of one or two axes that share a limit: horizontal (2 axes), vertical (1).

    `accel` is the greatest length of the acceleration vector (unit/s), `jerk` that of its change (unit/s2). State:
    `velocity` and `accel`, tuples with one number per axis; the acceleration is the feed-forward of the velocity loop.
    Yaw rates need none: `Quadrotor` has the autopilot's smoothing of them built in. Raises ValueError for limits that
    are not positive and for other numbers of axes.
    """

    __slots__ = ("_gain", "_jerk", "_limit", "accel", "velocity")

    def __init__(self, accel: float, jerk: float, axes: int = 1) -> None:
        if not (accel > 0.0 and jerk > 0.0 and math.isfinite(accel) and math.isfinite(jerk)):
            raise ValueError(f"accel and jerk must be positive and finite, not {accel} and {jerk}")
        if axes not in (1, 2):
            raise ValueError(f"axes must be 1 or 2, not {axes}")
        self._limit = accel
        self._jerk = jerk
        # With this gain the acceleration dies out at just the jerk limit: the fastest way in without overshoot.
        self._gain = jerk / accel
        self.velocity: tuple[float, ...] = (0.0,) * axes
        self.accel: tuple[float, ...] = (0.0,) * axes

    def reset(self, velocity: tuple[float, ...]) -> None:
        """Start again from `velocity`, without acceleration (mode change, end of a take-off)."""
        self.velocity = velocity
        self.accel = (0.0,) * len(velocity)

    def step(self, target: tuple[float, ...], dt_s: float) -> tuple[float, ...]:
        """Advance by `dt_s` towards `target` (one number per axis) and return the new `velocity`.

        Raises ValueError when the target has another number of axes or is not finite.
        """
        # 1 / dt: within one step never more than what is missing, whatever the rate.
        gain = min(self._gain, 1.0 / dt_s)
        # Trapezoid: the mean acceleration of the step, so that half the rate gives the same path.
        half = 0.5 * dt_s
        if len(self.velocity) == 1:
            (wanted,), (v,), (a,) = target, self.velocity, self.accel
            _check(wanted)
            ax, _ = self._accelerate(gain * (wanted - v), 0.0, a, 0.0, dt_s)
            self.accel = (ax,)
            self.velocity = (v + half * (a + ax),)
        else:
            (x, y), (vx, vy), (bx, by) = target, self.velocity, self.accel
            _check(x + y)
            ax, ay = self._accelerate(gain * (x - vx), gain * (y - vy), bx, by, dt_s)
            self.accel = (ax, ay)
            self.velocity = (vx + half * (bx + ax), vy + half * (by + ay))
        return self.velocity

    def _accelerate(self, wx: float, wy: float, bx: float, by: float, dt_s: float) -> tuple[float, float]:
        """From acceleration (bx, by) towards (wx, wy), within acceleration and jerk."""
        size = math.sqrt(wx * wx + wy * wy)
        if size > self._limit:
            wx, wy = wx * self._limit / size, wy * self._limit / size
        cx, cy = wx - bx, wy - by
        change, most = math.sqrt(cx * cx + cy * cy), self._jerk * dt_s
        if change > most:
            cx, cy = cx * most / change, cy * most / change
        return bx + cx, by + cy


def _check(number: float) -> None:
    if not math.isfinite(number):
        raise ValueError("VelocityShaper.step: the target must be finite")
