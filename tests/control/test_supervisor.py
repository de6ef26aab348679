"""The supervisor only ever takes away, and what it took stays away until it is asked again."""

from __future__ import annotations

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from control.messages import CommandReason, FlightStatus, VelocityCommand
from control.supervisor import FlightReason, FlightSupervisor, flight_obstacle

NOW_S = 100.0
GOOD = FlightStatus(
    t_heartbeat_s=NOW_S,
    mode="GUIDED",
    accepts_setpoints=True,
    armed=True,
    failsafe=False,
    t_landed_state_s=NOW_S,
    airborne=True,
    position_good=True,
    t_timesync_s=NOW_S,
)
BROKEN = [
    ({"t_heartbeat_s": -math.inf}, FlightReason.NO_HEARTBEAT),
    ({"t_heartbeat_s": NOW_S - 2.6}, FlightReason.NO_HEARTBEAT),
    ({"t_heartbeat_s": math.nan}, FlightReason.NO_HEARTBEAT),
    ({"accepts_setpoints": False, "mode": "LOITER"}, FlightReason.OTHER_MODE),
    ({"armed": False}, FlightReason.NOT_ARMED),
    ({"airborne": False}, FlightReason.NOT_AIRBORNE),
    ({"t_landed_state_s": NOW_S - 2.1}, FlightReason.NOT_AIRBORNE),
    ({"t_landed_state_s": math.nan}, FlightReason.NOT_AIRBORNE),
    ({"t_timesync_s": NOW_S - 5.1}, FlightReason.LINK_LATE),
    ({"t_timesync_s": -math.inf}, FlightReason.LINK_LATE),
]
# Not old enough to end, too old to fly on.
AGEING = [{"t_heartbeat_s": NOW_S - 1.3}, {"t_landed_state_s": NOW_S - 1.1}, {"t_timesync_s": NOW_S - 3.6}]


def moving(now_s: float = NOW_S) -> VelocityCommand:
    return VelocityCommand((1.0, 2.0, -0.5), 0.3, now_s, CommandReason.TRACKING)


def engaged() -> FlightSupervisor:
    supervisor = FlightSupervisor()
    assert supervisor.engage(GOOD, NOW_S).allowed
    return supervisor


def test_silence_before_the_start():
    supervisor = FlightSupervisor()
    assert supervisor.passed(moving(), NOW_S, GOOD, NOW_S) is None
    assert supervisor.permission.reason is FlightReason.NOT_STARTED


def test_engaged_passes_the_command_unchanged():
    command = moving()
    assert engaged().passed(command, NOW_S - 0.1, GOOD, NOW_S) is command


@pytest.mark.parametrize(("change", "reason"), BROKEN)
def test_each_condition_is_needed_to_engage(change, reason):
    supervisor = FlightSupervisor()
    permission = supervisor.engage(dataclasses.replace(GOOD, **change), NOW_S)
    assert not permission.allowed
    assert permission.reason is reason
    assert supervisor.passed(moving(), NOW_S, GOOD, NOW_S) is None


@pytest.mark.parametrize(("change", "reason"), BROKEN)
def test_each_condition_ends_it_for_good(change, reason):
    supervisor = engaged()
    assert supervisor.passed(moving(), NOW_S, dataclasses.replace(GOOD, **change), NOW_S) is None
    assert supervisor.permission.reason is reason
    assert supervisor.passed(moving(), NOW_S, GOOD, NOW_S) is None, "a mode that comes back must not resume"
    assert supervisor.permission.reason is reason
    assert supervisor.engage(GOOD, NOW_S).allowed, "a new start is possible"


def test_a_refused_start_does_not_end_what_runs():
    """engage() while engaged with a broken status: the next step, not the request, ends it."""
    supervisor = engaged()
    assert not supervisor.engage(dataclasses.replace(GOOD, armed=False), NOW_S).allowed
    assert supervisor.permission.allowed
    assert not supervisor.step(dataclasses.replace(GOOD, armed=False), NOW_S).allowed


def test_engaging_again_keeps_the_time_of_the_first():
    supervisor = engaged()
    assert supervisor.engage(GOOD, NOW_S).since_s == NOW_S
    later = dataclasses.replace(GOOD, t_heartbeat_s=NOW_S + 1, t_landed_state_s=NOW_S + 1, t_timesync_s=NOW_S + 1)
    assert supervisor.engage(later, NOW_S + 1).since_s == NOW_S


def test_stop_is_silence_and_keeps_the_first_reason():
    supervisor = engaged()
    assert supervisor.stop(NOW_S).reason is FlightReason.STOPPED
    assert supervisor.stop(NOW_S, FlightReason.FAULT).reason is FlightReason.STOPPED
    assert supervisor.passed(moving(), NOW_S, GOOD, NOW_S) is None


@pytest.mark.parametrize(
    ("command", "t_picture_s", "reason"),
    [
        (None, NOW_S, CommandReason.HOLD_NO_TARGET),
        (moving(NOW_S - 0.31), NOW_S, CommandReason.HOLD_STALE_COMMAND),
        (moving(), NOW_S - 0.51, CommandReason.HOLD_STALE_TARGET),
        (moving(), math.nan, CommandReason.HOLD_NOT_FINITE),
        (dataclasses.replace(moving(), yaw_rate_rad_s=math.nan), NOW_S, CommandReason.HOLD_NOT_FINITE),
        (dataclasses.replace(moving(), v_ned_m_s=(math.inf, 0.0, 0.0)), NOW_S, CommandReason.HOLD_NOT_FINITE),
        (moving(math.nan), NOW_S, CommandReason.HOLD_NOT_FINITE),
    ],
)
def test_what_cannot_be_flown_on_is_zeros(command, t_picture_s, reason):
    passed = engaged().passed(command, t_picture_s, GOOD, NOW_S)
    assert passed == VelocityCommand((0.0, 0.0, 0.0), 0.0, NOW_S, reason)


@pytest.mark.parametrize("change", AGEING)
def test_zeros_come_before_silence(change):
    """ArduPilot flies on for 3 s after silence, so the last word before it must be a stop."""
    supervisor = engaged()
    passed = supervisor.passed(moving(), NOW_S, dataclasses.replace(GOOD, **change), NOW_S)
    assert passed == VelocityCommand((0.0, 0.0, 0.0), 0.0, NOW_S, CommandReason.HOLD_NO_TELEMETRY)
    assert supervisor.permission.allowed
    assert supervisor.passed(moving(), NOW_S, GOOD, NOW_S) == moving(), "it was only late"


@pytest.mark.parametrize("change", [*AGEING, {"position_good": False}, {"failsafe": True}])
def test_a_start_asks_for_more_than_going_on(change):
    status = dataclasses.replace(GOOD, **change)
    assert not FlightSupervisor().engage(status, NOW_S).allowed
    assert engaged().step(status, NOW_S).allowed


def test_a_failsafe_is_zeros_and_then_the_end():
    """One that leaves the mode as it is would else leave the vehicle flying on for 3 s."""
    supervisor = engaged()
    for k in range(21):
        now_s = NOW_S + k / 10
        status = dataclasses.replace(
            GOOD, t_heartbeat_s=now_s, t_landed_state_s=now_s, t_timesync_s=now_s, failsafe=True
        )
        passed = supervisor.passed(moving(now_s), now_s, status, now_s)
        if k <= 10:
            assert passed == VelocityCommand((0.0, 0.0, 0.0), 0.0, now_s, CommandReason.HOLD_FAILSAFE)
        elif k > 11:
            assert passed is None
    assert supervisor.permission.reason is FlightReason.FAILSAFE


def test_a_long_hold_ends_it_and_a_short_one_does_not():
    supervisor = engaged()
    for k in range(200):
        now_s = NOW_S + k / 10
        status = dataclasses.replace(GOOD, t_heartbeat_s=now_s, t_landed_state_s=now_s, t_timesync_s=now_s)
        command = moving(now_s) if k == 50 else VelocityCommand((0, 0, 0), 0, now_s, CommandReason.HOLD_NO_TARGET)
        passed = supervisor.passed(command, now_s, status, now_s)
        assert (passed is not None) is (k <= 51 + 120)
    assert supervisor.permission.reason is FlightReason.HELD_LONG


@given(st.lists(st.sampled_from(["engage", "stop", "good", *(str(i) for i in range(len(BROKEN)))]), max_size=30))
def test_motion_only_between_a_start_and_the_first_trouble(actions):
    supervisor, may = FlightSupervisor(), False
    for action in actions:
        if action == "engage":
            may = supervisor.engage(GOOD, NOW_S).allowed
        elif action == "stop":
            supervisor.stop(NOW_S)
            may = False
        else:
            status = GOOD if action == "good" else dataclasses.replace(GOOD, **BROKEN[int(action)][0])
            may = may and flight_obstacle(status, NOW_S) is None
            assert (supervisor.passed(moving(), NOW_S, status, NOW_S) is not None) is may
    assert supervisor.permission.allowed is may
