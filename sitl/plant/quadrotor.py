"""A quadrotor as setpoints see it: velocity loop, tilt and thrust with their limits and lags, drag, wind, ground.

Axes: NED and heading frame; roll right side down +, pitch nose up +, yaw clockwise from above + (as sitl/scene.py).
"""

from __future__ import annotations

import math
from collections import deque

from sitl.plant.quadrotor_params import GRAVITY_M_S2, QuadrotorParams
from sitl.plant.wind import Vector, Wind

__all__ = ["GRAVITY_M_S2", "Quadrotor", "QuadrotorParams"]

_PI, _TURN = math.pi, 2.0 * math.pi
# Commands due "now" must be taken in spite of the rounding of times that are sums of steps.
_TIME_SLACK_S = 1e-9
# What heading a lag may owe: as far as a yaw at the acceleration limit falls behind, and no wind-up beyond.
_YAW_ERROR_MAX_RAD = 0.5
# A standing vehicle levels out with this time constant: legs, not motors, do it.
_LEVEL_S = 0.1

_Setpoint = tuple[float, float, float, float, float, float, float, float]  # due, v ned, yaw rate, a ned
_REST: _Setpoint = (0.0,) * 8


class Quadrotor:
    """The plant of the vehicle. Starts with motors off, on the ground or, from `pos_ned_m` above it, falling.

    `params` are fixed for a run, but for `thrust_factor` (share of the greatest thrust that the battery still gives),
    which may be set at any time. Read-only state: see the properties.
    """

    __slots__ = (
        "_ad", "_ae", "_alpha_asked", "_alpha_rate", "_alpha_thrust", "_alpha_yaw", "_an", "_behind_d", "_behind_e",
        "_behind_n", "_drag1", "_drag2", "_dt", "_east_demand", "_flying", "_idle_thrust", "_least_up", "_max_slope",
        "_max_thrust", "_most_up", "_north_demand", "_params", "_pd", "_pe", "_pitch", "_pitch_rate", "_pn", "_queue",
        "_roll", "_roll_rate", "_setpoint", "_sum_d", "_sum_e", "_sum_n", "_thrust", "_up_demand", "_vd", "_ve", "_vn",
        "_wind", "_yaw", "_yaw_asked", "_yaw_error", "_yaw_rate", "ground_down_m", "motors_on", "on_ground",
        "thrust_factor",
    )  # fmt: skip
    _behind_n: float
    _behind_e: float
    _behind_d: float
    _sum_n: float
    _sum_e: float
    _sum_d: float
    _north_demand: float
    _east_demand: float

    def __init__(
        self,
        params: QuadrotorParams | None = None,
        wind: Wind | None = None,
        pos_ned_m: Vector = (0.0, 0.0, 0.0),
        yaw_rad: float = 0.0,
        ground_down_m: float = 0.0,
    ) -> None:
        self._params = params if params is not None else QuadrotorParams()
        self._wind = wind if wind is not None else Wind()
        self.ground_down_m = ground_down_m
        self.motors_on = False
        self.thrust_factor = 1.0
        self._queue: deque[_Setpoint] = deque()
        self._pn, self._pe, self._pd = pos_ned_m[0], pos_ned_m[1], min(pos_ned_m[2], ground_down_m)
        self.on_ground = self._pd >= ground_down_m
        self._yaw = _wrap(yaw_rad)
        self._vn = self._ve = self._vd = 0.0
        self._an = self._ae = self._ad = 0.0
        self._roll = self._pitch = self._roll_rate = self._pitch_rate = self._yaw_rate = 0.0
        self._dt = math.nan  # none yet; unlike any step
        mass = self._params.mass_kg
        self._drag1 = self._params.drag_linear_n_s_m / mass
        self._drag2 = self._params.drag_quadratic_n_s2_m2 / mass
        self._max_thrust = self._params.max_thrust_n / mass
        self._idle_thrust = self._params.idle_thrust_n / mass
        self._most_up = GRAVITY_M_S2 + self._params.max_accel_up_m_s2
        self._least_up = GRAVITY_M_S2 - self._params.max_accel_down_m_s2
        self._max_slope = math.tan(self._params.max_tilt_rad)
        self._set_idle()

    # --- what it is told -----------------------------------------------------------------------------------------

    def command(
        self, v_ned_m_s: Vector, yaw_rate_rad_s: float, t_s: float, accel_ned_m_s2: Vector = (0.0, 0.0, 0.0)
    ) -> None:
        """Demand of the inner velocity loop, told at `t_s`, in force `delay_s` later until the next one.

        `accel_ned_m_s2` is the feed-forward that belongs to a shaped velocity (`VelocityShaper.accel`). Without
        motors it has no effect. Raises ValueError for a number that is not finite or a time before the last command.
        """
        vn, ve, vd = v_ned_m_s
        an, ae, ad = accel_ned_m_s2
        # One sum is NaN or infinite exactly when a summand is (or overflows, which is as bad).
        if not math.isfinite(vn + ve + vd + yaw_rate_rad_s + an + ae + ad + t_s):
            raise ValueError("Quadrotor.command: velocity, yaw rate, acceleration and time must be finite")
        due = t_s + self._params.delay_s
        queue = self._queue
        if queue and due < queue[-1][0]:
            raise ValueError(f"Quadrotor.command: t_s {t_s} is before that of the last command")
        queue.append((due, vn, ve, vd, yaw_rate_rad_s, an, ae, ad))

    def idle(self) -> None:
        """Motors off, at once; commands on their way are forgotten."""
        self.motors_on = False
        self._set_idle()

    def spin(self) -> None:
        """Motors on, turning at idle until a command comes into force."""
        self.motors_on = True
        self._set_idle()

    def hover(self) -> None:
        """Motors on and thrust equal to weight, at rest and level: for runs that begin in the air."""
        self.spin()
        self._flying = True
        self._thrust = self._up_demand = GRAVITY_M_S2
        self._vn = self._ve = self._vd = 0.0
        self._roll = self._pitch = self._roll_rate = self._pitch_rate = self._yaw_rate = 0.0

    def _set_idle(self) -> None:
        self._flying = False
        self._queue.clear()
        self._setpoint = _REST
        self._stand(GRAVITY_M_S2)
        self._thrust = 0.0
        self._yaw_asked = self._yaw_error = 0.0

    # --- one step ------------------------------------------------------------------------------------------------

    def step(self, t_s: float, dt_s: float) -> None:
        """Advance the state from `t_s` to `t_s + dt_s` (at most 0.02 s: the loops are stable up to there)."""
        if dt_s != self._dt:
            self._set_dt(dt_s)
        queue = self._queue
        while queue and queue[0][0] <= t_s + _TIME_SLACK_S:
            setpoint = queue.popleft()
            if self.motors_on:
                self._setpoint = setpoint
                self._flying = True
        if self._flying:
            self._velocity_loop(dt_s)
        self._turn(dt_s)
        self._move(t_s, dt_s)

    def _set_dt(self, dt_s: float) -> None:
        if not 0.0 < dt_s <= 0.02:
            raise ValueError(f"Quadrotor.step: dt_s must be above 0 and at most 0.02 s, not {dt_s}")
        p = self._params
        self._dt = dt_s
        # Exact discretisation of the lags: the rate of the physics does not change them.
        self._alpha_rate = 1.0 - math.exp(-dt_s / p.tilt_rate_lag_s)
        self._alpha_thrust = 1.0 - math.exp(-dt_s / p.thrust_lag_s)
        self._alpha_asked = 1.0 - math.exp(-dt_s / p.yaw_command_lag_s)
        self._alpha_yaw = 1.0 - math.exp(-dt_s / p.yaw_rate_lag_s)

    def _velocity_loop(self, dt_s: float) -> None:
        """Feed-forward, velocity PI and position hold -> wanted specific force within the limits.

        The position hold is ArduPilot's: also under velocity setpoints it keeps up with the path that they describe.
        """
        p = self._params
        _, vn, ve, vd, _, an, ae, ad = self._setpoint
        gain, hold = p.climb_p_1_s, p.climb_hold_1_s
        missing = vd - self._vd
        error = missing + hold * self._behind_d
        down = ad + gain * error + self._sum_d
        up = GRAVITY_M_S2 - down
        # Height first: what the thrust cannot give any more is taken from the horizontal.
        thrust = self._max_thrust * self.thrust_factor
        most = thrust if thrust < self._most_up else self._most_up
        inside = self._least_up < up < most
        if not inside:
            up = most if up >= most else self._least_up
        if self.on_ground:
            self._stand(up)
            return
        # Anti-windup, here and below: at a limit an integrator may only go back, never on.
        if inside or error * self._sum_d < 0.0:
            self._sum_d += p.climb_i_1_s2 * dt_s * error
        if inside or missing * self._behind_d < 0.0:
            self._behind_d += dt_s * missing
        self._up_demand = up
        room = up * self._max_slope
        if room > p.max_accel_m_s2:
            room = p.max_accel_m_s2
        if room * room > thrust * thrust - up * up:
            room = math.sqrt(max(0.0, thrust * thrust - up * up))
        self._horizontal_loop(vn - self._vn, ve - self._ve, an, ae, room, dt_s)

    def _horizontal_loop(self, vn: float, ve: float, an: float, ae: float, room: float, dt_s: float) -> None:
        """`vn`, `ve`: velocity that is missing; `an`, `ae`: feed-forward; `room`: greatest acceleration."""
        p = self._params
        behind_n, behind_e, sum_n, sum_e = self._behind_n, self._behind_e, self._sum_n, self._sum_e
        gain, hold = p.velocity_p_1_s, p.position_hold_1_s
        error_n, error_e = vn + hold * behind_n, ve + hold * behind_e
        north, east = an + gain * error_n + sum_n, ae + gain * error_e + sum_e
        size = math.sqrt(north * north + east * east)
        step = p.velocity_i_1_s2 * dt_s
        if size <= room:
            self._sum_n, self._sum_e = sum_n + step * error_n, sum_e + step * error_e
            self._behind_n, self._behind_e = behind_n + dt_s * vn, behind_e + dt_s * ve
        else:
            north, east = north * room / size, east * room / size
            if north * error_n + east * error_e < 0.0:
                self._sum_n, self._sum_e = sum_n + step * error_n, sum_e + step * error_e
            if north * vn + east * ve < 0.0:
                self._behind_n, self._behind_e = behind_n + dt_s * vn, behind_e + dt_s * ve
        change_n, change_e = north - self._north_demand, east - self._east_demand
        change, most = math.sqrt(change_n * change_n + change_e * change_e), p.max_jerk_m_s3 * dt_s
        if change > most:
            north = self._north_demand + change_n * most / change
            east = self._east_demand + change_e * most / change
        self._north_demand, self._east_demand = north, east

    def _stand(self, up: float) -> None:
        """On the ground there is nothing to integrate: the first lift-off begins from rest and level."""
        self._up_demand = up
        self._north_demand = self._east_demand = 0.0
        self._sum_n = self._sum_e = self._sum_d = 0.0
        self._behind_n = self._behind_e = self._behind_d = 0.0

    def _turn(self, dt_s: float) -> None:
        """Attitude: roll and pitch follow the wanted force, yaw its rate; on the ground it stands level."""
        if self.on_ground:
            share = min(1.0, dt_s / _LEVEL_S)
            self._roll -= share * self._roll
            self._pitch -= share * self._pitch
            self._roll_rate = self._pitch_rate = self._yaw_rate = self._yaw_asked = self._yaw_error = 0.0
            return
        p = self._params
        if self._flying:
            north, east, up = self._north_demand, self._east_demand, self._up_demand
            c, s = math.cos(self._yaw), math.sin(self._yaw)
            pitch_wanted = -math.atan((c * north + s * east) / up)
            roll_wanted = math.atan((c * east - s * north) / up * math.cos(pitch_wanted))
            roll_rate = p.tilt_p_1_s * (roll_wanted - self._roll)
            pitch_rate = p.tilt_p_1_s * (pitch_wanted - self._pitch)
            # The heading that the rate asked for is kept too: what the lag lost is made good (and overshoots, as real).
            self._yaw_asked = asked = self._yaw_asked + self._alpha_asked * (self._setpoint[4] - self._yaw_asked)
            yaw_rate = asked + p.yaw_p_1_s * self._yaw_error
            error = self._yaw_error + (asked - self._yaw_rate) * dt_s
            if -_YAW_ERROR_MAX_RAD < error < _YAW_ERROR_MAX_RAD:
                self._yaw_error = error
        else:
            roll_rate = pitch_rate = yaw_rate = 0.0
        most, limit, alpha = p.max_tilt_accel_rad_s2 * dt_s, p.max_tilt_rate_rad_s, self._alpha_rate
        self._roll_rate = roll_rate = _approach(self._roll_rate, roll_rate, limit, alpha, most)
        self._pitch_rate = pitch_rate = _approach(self._pitch_rate, pitch_rate, limit, alpha, most)
        self._yaw_rate = yaw_rate = _approach(
            self._yaw_rate, yaw_rate, p.max_yaw_rate_rad_s, self._alpha_yaw, p.max_yaw_accel_rad_s2 * dt_s
        )
        self._roll += roll_rate * dt_s
        self._pitch += pitch_rate * dt_s
        self._yaw = _wrap(self._yaw + yaw_rate * dt_s)

    def _move(self, t_s: float, dt_s: float) -> None:
        """Forces to motion: thrust along the body, drag of the air, weight, ground."""
        cos_roll = math.cos(self._roll)
        lift = cos_roll * math.cos(self._pitch)
        if self._flying:
            wanted, most = self._up_demand / lift, self._max_thrust * self.thrust_factor
            if wanted > most:
                wanted = most
        else:
            wanted = self._idle_thrust if self.motors_on else 0.0
        self._thrust = thrust = self._thrust + self._alpha_thrust * (wanted - self._thrust)
        if self.on_ground and thrust * lift <= GRAVITY_M_S2:
            return
        self.on_ground = False
        wind_n, wind_e, wind_d = self._wind.at(t_s)
        vn, ve, vd = self._vn, self._ve, self._vd
        air_n, air_e, air_d = vn - wind_n, ve - wind_e, vd - wind_d
        drag = self._drag1 + self._drag2 * math.sqrt(air_n * air_n + air_e * air_e + air_d * air_d)
        forward, right = -thrust * cos_roll * math.sin(self._pitch), thrust * math.sin(self._roll)
        yaw = self._yaw
        c, s = math.cos(yaw), math.sin(yaw)
        self._an = an = c * forward - s * right - drag * air_n
        self._ae = ae = s * forward + c * right - drag * air_e
        self._ad = ad = GRAVITY_M_S2 - thrust * lift - drag * air_d
        half = 0.5 * dt_s * dt_s
        self._pn += vn * dt_s + half * an
        self._pe += ve * dt_s + half * ae
        self._pd += vd * dt_s + half * ad
        self._vn, self._ve, self._vd = vn + an * dt_s, ve + ae * dt_s, vd + ad * dt_s
        if self._pd >= self.ground_down_m:
            self._land()

    def _land(self) -> None:
        self.on_ground = True
        self._pd = self.ground_down_m
        self._vn = self._ve = self._vd = 0.0
        self._an = self._ae = self._ad = 0.0

    # --- what is true --------------------------------------------------------------------------------------------

    @property
    def pos_ned_m(self) -> Vector:
        """Position of the body, NED, m; its down is that of the ground while it stands."""
        return self._pn, self._pe, self._pd

    @property
    def vel_ned_m_s(self) -> Vector:
        """Velocity over ground, NED."""
        return self._vn, self._ve, self._vd

    @property
    def accel_ned_m_s2(self) -> Vector:
        """Change of the velocity in the last step, NED (what an accelerometer shows, plus gravity)."""
        return self._an, self._ae, self._ad

    @property
    def roll_rad(self) -> float:
        """Roll, right side down +."""
        return self._roll

    @property
    def pitch_rad(self) -> float:
        """Pitch, nose up +."""
        return self._pitch

    @property
    def yaw_rad(self) -> float:
        """Heading, clockwise from north +, in [-pi, pi)."""
        return self._yaw

    @property
    def euler_rates_rad_s(self) -> Vector:
        """Rates of roll, pitch and yaw."""
        return self._roll_rate, self._pitch_rate, self._yaw_rate

    @property
    def rates_rad_s(self) -> Vector:
        """Body rates p, q, r (about forward, right, down)."""
        sin_roll, cos_roll = math.sin(self._roll), math.cos(self._roll)
        turn = self._yaw_rate * math.cos(self._pitch)
        return (
            self._roll_rate - self._yaw_rate * math.sin(self._pitch),
            self._pitch_rate * cos_roll + turn * sin_roll,
            turn * cos_roll - self._pitch_rate * sin_roll,
        )


def _approach(rate: float, wanted: float, limit: float, alpha: float, most: float) -> float:
    """One step of a first-order lag towards `wanted` within +-`limit`, changing by at most `most`."""
    if wanted > limit:
        wanted = limit
    elif wanted < -limit:
        wanted = -limit
    change = alpha * (wanted - rate)
    if change > most:
        change = most
    elif change < -most:
        change = -most
    return rate + change


def _wrap(angle_rad: float) -> float:
    if -_PI <= angle_rad < _PI:
        return angle_rad
    return (angle_rad + _PI) % _TURN - _PI
