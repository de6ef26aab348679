"""Whether velocity setpoints may leave at all: the pilot and the autopilot decide, this only ever takes away.

    engage() --all conditions hold--> ENGAGED --one fails--> not engaged, for good, until engage() is called again

Conditions: a fresh heartbeat of the autopilot, its mode is the one for setpoints (ArduPilot GUIDED), no failsafe,
armed, in the air, a link that answers quickly. A mode that comes back by itself changes nothing. Not engaged means
silence: no setpoint of any kind, for a stream of zeros would fight whoever flies now. While engaged, what cannot be
flown on (no target, stale data) is a HOLD: zeros. Silence alone does not stop the vehicle (ArduPilot flies on for 3 s),
so where it comes from age, zeros come first: each `MAX_..._HOLD_S` lies a second or more before its `MAX_..._AGE_S`.

This is the least that is safe in simulation; fences, other modes' hand-over and the rules of the links are not in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from control.gate import MAX_COMMAND_AGE_S, all_finite, is_fresh
from control.limits import HOLDS
from control.messages import CommandReason, FlightStatus, VelocityCommand

# ArduPilot beats at 1 Hz and at once on every change of mode (asked for at 5 Hz); two lost beats and some delay are no
# link any more.
MAX_HEARTBEAT_AGE_S = 2.5
MAX_HEARTBEAT_HOLD_S = 1.2
# The landed state is asked for at 5 Hz; so long without one, "in the air" is a memory.
MAX_LANDED_STATE_AGE_S = 2.0
MAX_LANDED_STATE_HOLD_S = 1.0
# The time is asked for every second. Without answers nobody knows how old the heartbeats are that come in.
MAX_TIMESYNC_AGE_S = 5.0
MAX_TIMESYNC_HOLD_S = 3.5
# A failsafe that leaves the mode as it is (a warning only) must not leave the vehicle flying on: zeros come first.
FAILSAFE_HOLD_S = 1.0
# A HOLD of this length is no following any more: whoever wants it again starts it again (as long as a search lasts).
MAX_HOLD_S = 12.0
# A command that is sent again must still rest on a picture as young as this: the high end of the 0.3-0.5 s that a
# control decision may rest on (mavlink.md, 5).
MAX_PICTURE_AGE_S = 0.5


class FlightReason(str, Enum):
    """Why setpoints may be sent, or why not; logged whenever it changes."""

    ENGAGED = "engaged"
    NOT_STARTED = "not_started"
    STOPPED = "stopped"  # by whoever started it
    NO_HEARTBEAT = "no_heartbeat"
    OTHER_MODE = "other_mode"  # somebody else flies
    FAILSAFE = "failsafe"  # the autopilot reports a critical state
    LINK_LATE = "link_late"  # it answers late or not at all
    STALLED = "stalled"  # the program itself stood still; what waits in the link is of unknown age
    NO_TARGET = "no_target"  # a start needs a target that is LOCKED
    NO_RANGE = "no_range"  # a start needs to know how far it is
    NO_POSITION = "no_position"  # a start needs an estimator that has a position
    HELD_LONG = "held_long"  # nothing to fly on for `MAX_HOLD_S`, or the target was given up
    NOT_ARMED = "not_armed"
    NOT_AIRBORNE = "not_airborne"
    REBOOTED = "rebooted"  # the autopilot's clock went back: nothing of what was agreed before holds
    FAULT = "fault"  # an error of the program while it was about to send


@dataclass(frozen=True, slots=True)
class FlightPermission:
    """Whether velocity setpoints may be sent, since when that is so, and why."""

    allowed: bool
    reason: FlightReason
    since_s: float


class FlightSupervisor:
    """Holds the authorisation to fly. Never raises in the loop."""

    def __init__(self) -> None:
        self._permission = FlightPermission(False, FlightReason.NOT_STARTED, 0.0)
        self._hold_since_s: float | None = None
        self._failsafe_since_s: float | None = None

    @property
    def permission(self) -> FlightPermission:
        """As of the last call."""
        return self._permission

    def engage(self, status: FlightStatus, now_s: float) -> FlightPermission:
        """Start, when every condition holds now; else nothing changes and the answer says which one does not."""
        obstacle = flight_obstacle(status, now_s)
        if obstacle is None and _is_holding(status, now_s):
            obstacle = FlightReason.LINK_LATE
        if obstacle is None and status.failsafe:
            obstacle = FlightReason.FAILSAFE
        if obstacle is None and not status.position_good:
            obstacle = FlightReason.NO_POSITION
        if obstacle is not None:
            return FlightPermission(False, obstacle, now_s)
        if not self._permission.allowed:
            self._permission = FlightPermission(True, FlightReason.ENGAGED, now_s)
            self._hold_since_s = None
        return self._permission

    def stop(self, now_s: float, reason: FlightReason = FlightReason.STOPPED) -> FlightPermission:
        """End for good. The reason of an earlier end is kept."""
        if self._permission.allowed:
            self._permission = FlightPermission(False, reason, now_s)
        return self._permission

    def step(self, status: FlightStatus, now_s: float) -> FlightPermission:
        """Look at the autopilot again; call it before anything is sent and whenever a heartbeat came."""
        if not status.failsafe:
            self._failsafe_since_s = None
        elif self._failsafe_since_s is None:
            self._failsafe_since_s = now_s
        elif now_s - self._failsafe_since_s > FAILSAFE_HOLD_S:
            self.stop(now_s, FlightReason.FAILSAFE)
        obstacle = flight_obstacle(status, now_s)
        return self.stop(now_s, obstacle) if obstacle is not None else self._permission

    def passed(
        self, command: VelocityCommand | None, t_picture_s: float, status: FlightStatus, now_s: float
    ) -> VelocityCommand | None:
        """What may be sent now: the command, zeros in its place, or None for silence.

        `t_picture_s` is the exposure of the picture that the command rests on. A command or a picture that has become
        too old, no command yet, or a number that is not finite is a HOLD.
        """
        if not self.step(status, now_s).allowed:
            return None
        reason = _hold_reason(command, t_picture_s, status, now_s)
        held = reason is not None or (command is not None and command.reason in HOLDS)
        if not held:
            self._hold_since_s = None
        elif self._hold_since_s is None:
            self._hold_since_s = now_s
        elif now_s - self._hold_since_s > MAX_HOLD_S:
            self.stop(now_s, FlightReason.HELD_LONG)  # the zeros sent so far are the last word
            return None
        return command if reason is None else VelocityCommand((0.0, 0.0, 0.0), 0.0, now_s, reason)


def flight_obstacle(status: FlightStatus, now_s: float) -> FlightReason | None:
    """The first condition that does not hold, or None."""
    if not is_fresh(status.t_heartbeat_s, now_s, MAX_HEARTBEAT_AGE_S):
        return FlightReason.NO_HEARTBEAT
    if not status.accepts_setpoints:
        return FlightReason.OTHER_MODE
    if not status.armed:
        return FlightReason.NOT_ARMED
    if not (status.airborne and is_fresh(status.t_landed_state_s, now_s, MAX_LANDED_STATE_AGE_S)):
        return FlightReason.NOT_AIRBORNE
    if not is_fresh(status.t_timesync_s, now_s, MAX_TIMESYNC_AGE_S):
        return FlightReason.LINK_LATE
    return None


def _is_holding(status: FlightStatus, now_s: float) -> bool:
    """Whether what the autopilot says of itself is too old to fly on, and not yet old enough to end."""
    return not (
        is_fresh(status.t_heartbeat_s, now_s, MAX_HEARTBEAT_HOLD_S)
        and is_fresh(status.t_landed_state_s, now_s, MAX_LANDED_STATE_HOLD_S)
        and is_fresh(status.t_timesync_s, now_s, MAX_TIMESYNC_HOLD_S)
    )


def _hold_reason(
    command: VelocityCommand | None, t_picture_s: float, status: FlightStatus, now_s: float
) -> CommandReason | None:
    """Why zeros are sent instead of the command, or None."""
    if status.failsafe:
        return CommandReason.HOLD_FAILSAFE
    if _is_holding(status, now_s):
        return CommandReason.HOLD_NO_TELEMETRY
    if command is None:
        return CommandReason.HOLD_NO_TARGET
    if not all_finite(*command.v_ned_m_s, command.yaw_rate_rad_s, command.t_s, t_picture_s):
        return CommandReason.HOLD_NOT_FINITE
    if not is_fresh(command.t_s, now_s, MAX_COMMAND_AGE_S):
        return CommandReason.HOLD_STALE_COMMAND
    return None if is_fresh(t_picture_s, now_s, MAX_PICTURE_AGE_S) else CommandReason.HOLD_STALE_TARGET
