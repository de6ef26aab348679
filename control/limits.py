"""The last stage before the wire: whatever was decided, this is the most that the vehicle may be told."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from control.gate import MAX_COMMAND_AGE_S, all_finite, is_fresh
from control.messages import CommandReason, VelocityCommand

# A change smaller than this is rounding, not a limit at work.
CHANGE_TOLERANCE = 1e-9
# One period at 20 Hz, the rate of setpoints (mavlink.md, 3.1), taken as the time step of the first call.
FIRST_STEP_S = 0.05
# Longer steps are taken as this long, so that a pause cannot become one large jump of speed.
MAX_STEP_S = 0.25
# While coasting, horizontal speed falls by 1/e in this time: a bounded COAST (5 s) from 5 m/s ends below 0.1 m/s.
COAST_DECAY_S = 1.0
# After a silence this long the autopilot has stopped by itself (PX4 COM_OF_LOSS_T 1 s): start again from zero.
RESTART_AFTER_S = 1.0
# What they rest on is stale, missing or broken: zero at once. A ramp would be motion from data that is not there.
HOLDS = frozenset(reason for reason in CommandReason if reason.value.startswith("hold_"))
# The target is known and the motion towards it must end: the harder `brake_*` limits count.
BRAKES = frozenset({CommandReason.TOO_CLOSE, CommandReason.NO_RANGE})


@dataclass(frozen=True, slots=True)
class VelocityLimits:
    """Greatest speeds and accelerations; TOO_CLOSE and NO_RANGE brake harder. Raises ValueError when not positive."""

    max_horizontal_m_s: float = 5.0  # a runner or a bicycle can be followed (mavlink.md, 5)
    max_up_m_s: float = 1.0  # height is held, not chased (mavlink.md, 5)
    max_down_m_s: float = 1.0  # well clear of a multicopter's own downwash
    max_yaw_rate_rad_s: float = math.radians(45.0)  # above it video smears (mavlink.md, 5)
    max_horizontal_accel_m_s2: float = 2.0  # 12 degrees of tilt: the gimbal and the tracker hardly notice
    max_vertical_accel_m_s2: float = 1.0  # full vertical speed within a second
    max_yaw_accel_rad_s2: float = math.radians(90.0)  # full yaw rate within half a second
    brake_horizontal_accel_m_s2: float = 5.0  # 27 degrees of tilt, which every multicopter has: 5 m/s to rest in 1 s
    brake_vertical_accel_m_s2: float = 3.0  # 1 m/s to rest in 0.33 s
    brake_yaw_accel_rad_s2: float = math.radians(180.0)  # 45 deg/s to rest in 0.25 s

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"VelocityLimits.{field.name} = {value}: must be finite and above 0")

    def tighten(self, other: VelocityLimits) -> VelocityLimits:
        """The smaller of each limit of the two: a profile can take away and never add.

        The braking limits take part too; a profile that wants hard braking leaves them at their default.
        """
        return VelocityLimits(*(min(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)))


class VelocityLimiter:
    """Clamps speed and its change. No component of the output exceeds both the one asked for and the one before."""

    def __init__(self, limits: VelocityLimits) -> None:
        self._limits = limits
        self.reset()

    def reset(self) -> None:
        """Start from standstill, as when following begins."""
        self._last_s: float | None = None
        self._velocity = (0.0, 0.0, 0.0)
        self._yaw_rate = 0.0

    def step(self, command: VelocityCommand, now_s: float) -> VelocityCommand:
        """The command that may be sent: NED m/s, yaw rate right + rad/s.

        Not finite (command or time): zero at once with HOLD_NOT_FINITE; a command that was not made just now: zero with
        HOLD_STALE_COMMAND. A HOLD is zero at once, whatever it asks for. COASTING loses horizontal speed by
        `COAST_DECAY_S`. Time
        that stands still or runs back changes nothing but a HOLD. TRACKING becomes LIMITED when it was changed; any
        other reason is kept.
        """
        if not all_finite(*command.v_ned_m_s, command.yaw_rate_rad_s, command.t_s, now_s):
            self.reset()
            return VelocityCommand((0.0, 0.0, 0.0), 0.0, now_s, CommandReason.HOLD_NOT_FINITE)
        dt_s = self._time_step(now_s)
        if command.reason in HOLDS:
            return self._stop(now_s, command.reason)
        if not is_fresh(command.t_s, now_s, MAX_COMMAND_AGE_S):
            return self._stop(now_s, CommandReason.HOLD_STALE_COMMAND)
        self._advance(command, dt_s)
        return self._output(command, now_s)

    def _stop(self, now_s: float, reason: CommandReason) -> VelocityCommand:
        self._velocity, self._yaw_rate = (0.0, 0.0, 0.0), 0.0
        return VelocityCommand(self._velocity, self._yaw_rate, now_s, reason)

    def _time_step(self, now_s: float) -> float:
        """Seconds since the last call, in [0, MAX_STEP_S]; a time that came before gives nothing a second time."""
        if self._last_s is not None and now_s - self._last_s > RESTART_AFTER_S:
            self.reset()
        dt_s = FIRST_STEP_S if self._last_s is None else now_s - self._last_s
        if dt_s >= 0 or dt_s < -RESTART_AFTER_S:
            self._last_s = now_s
        return min(max(dt_s, 0.0), MAX_STEP_S)

    def _advance(self, command: VelocityCommand, dt_s: float) -> None:
        limits, (north, east, down) = self._limits, command.v_ned_m_s
        north, east = _shortened((north, east), self._max_horizontal_m_s(command.reason, dt_s))
        down = min(max(down, -limits.max_up_m_s), limits.max_down_m_s)
        yaw_rate = min(max(command.yaw_rate_rad_s, -limits.max_yaw_rate_rad_s), limits.max_yaw_rate_rad_s)
        old_north, old_east, old_down = self._velocity
        brakes = command.reason in BRAKES
        horizontal = (limits.max_horizontal_accel_m_s2, limits.brake_horizontal_accel_m_s2)
        vertical = (limits.max_vertical_accel_m_s2, limits.brake_vertical_accel_m_s2)
        yaw = (limits.max_yaw_accel_rad_s2, limits.brake_yaw_accel_rad_s2)
        d_north, d_east = _change((north, east), (old_north, old_east), *horizontal, dt_s, brakes)
        (d_down,) = _change((down,), (old_down,), *vertical, dt_s, brakes)
        (d_yaw,) = _change((yaw_rate,), (self._yaw_rate,), *yaw, dt_s, brakes)
        self._velocity = (old_north + d_north, old_east + d_east, old_down + d_down)
        self._yaw_rate += d_yaw

    def _max_horizontal_m_s(self, reason: CommandReason, dt_s: float) -> float:
        """A prediction may shrink or grow the target's box; neither is a reason to fly on as when it was seen."""
        if reason is CommandReason.COASTING:
            speed = math.hypot(*self._velocity[:2]) * math.exp(-dt_s / COAST_DECAY_S)
            return min(self._limits.max_horizontal_m_s, speed)
        return self._limits.max_horizontal_m_s

    def _output(self, command: VelocityCommand, now_s: float) -> VelocityCommand:
        asked = (*command.v_ned_m_s, command.yaw_rate_rad_s)
        given = (*self._velocity, self._yaw_rate)
        changed = any(abs(a - g) > CHANGE_TOLERANCE for a, g in zip(asked, given, strict=True))
        limited = changed and command.reason is CommandReason.TRACKING
        reason = CommandReason.LIMITED if limited else command.reason
        return VelocityCommand(self._velocity, self._yaw_rate, now_s, reason)


def _change(
    wanted: tuple[float, ...], old: tuple[float, ...], accel: float, brake: float, dt_s: float, brakes: bool
) -> tuple[float, ...]:
    """What may be added to `old` in this step: up to `brake` per second against the motion, else up to `accel`."""
    change = tuple(w - o for w, o in zip(wanted, old, strict=True))
    slows = sum(c * o for c, o in zip(change, old, strict=True)) < 0
    limit = max(accel, brake) if brakes and slows else accel  # braking is never softer than an ordinary change
    return _shortened(change, limit * dt_s)


def _shortened(vector: tuple[float, ...], max_norm: float) -> tuple[float, ...]:
    """The vector with its direction kept and its length at most `max_norm`."""
    norm = math.hypot(*vector)
    return vector if norm <= max_norm else tuple(v * (max_norm / norm) for v in vector)
