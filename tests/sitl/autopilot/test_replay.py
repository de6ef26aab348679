"""A recorded flight, its companion's side played into the simulated autopilot: does it answer as the real one did?"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.link import pipe
from tests.sitl.autopilot import comparison
from tests.sitl.autopilot.recording import Log, Record, autopilot_side, companion_side, new_autopilot, play

END_S = 167.5
BRAKE_S = 132.021


@pytest.fixture(scope="module")
def real() -> Log:
    return autopilot_side()


@pytest.fixture(scope="module")
def simulated() -> Log:
    return play(new_autopilot(), companion_side(), END_S)


CHECKS = [
    comparison.acknowledgements, comparison.heartbeats, comparison.landed_states, comparison.gimbal_status,
    comparison.velocities, comparison.headings, comparison.silence, comparison.gimbal_attitude,
    comparison.gimbal_rates, comparison.rates, comparison.landing,
]  # fmt: skip


def with_few_streams(records: Log) -> Log:
    """Only what a test reads is asked for: position and target. Saves half of the time."""
    return Log(
        r
        for r in records
        if not (r.kind == "COMMAND_LONG" and r.message.command == 511 and r.message.param1 not in (32, 85))
    )


@pytest.mark.parametrize("check", CHECKS, ids=lambda c: c.__name__)
def test_answers_as_the_real_autopilot(check, real, simulated):
    assert check(real, simulated) == []


def test_no_position_before_the_estimator_is_ready(real, simulated):
    first = [next(r.t_s for r in s.of("LOCAL_POSITION_NED")) for s in (real, simulated)]
    assert abs(first[0] - first[1]) < 0.06
    for records in (real, simulated):
        flags = comparison.changes(records, "EKF_STATUS_REPORT", lambda m: m.flags)
        assert flags[-1][1] == 831
        assert flags[-1][0] == pytest.approx(40.6, abs=0.5)


def test_someone_else_brakes():
    """The same flight, but the change to BRAKE comes from a ground station on another link."""
    quiet = with_few_streams(companion_side())
    theirs = [r for r in quiet if not (r.kind == "COMMAND_LONG" and abs(r.t_s - BRAKE_S) < 0.01)]
    assert len(theirs) == len(quiet) - 1
    autopilot = new_autopilot()
    autopilot_end, station_end = pipe()
    autopilot.attach(autopilot_end, "ground station")
    station = mavlink.MAVLink(station_end, srcSystem=255, srcComponent=190)
    told = []

    def command(t_s: float) -> None:
        if t_s >= BRAKE_S and not told:
            told.append(t_s)
            station.command_long_send(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, 17, 0, 0, 0, 0, 0)

    heard = play(autopilot, [r for r in theirs if r.t_s < 137.0], 137.0, command)
    modes = comparison.changes(heard, "HEARTBEAT", lambda m: m.custom_mode)
    assert modes[-1] == (pytest.approx(BRAKE_S, abs=0.02), 17)
    # The command and its acknowledgement stay on the ground station's link.
    assert [r for r in heard.of("COMMAND_ACK") if abs(r.t_s - BRAKE_S) < 2.0] == []
    late = [r.message for r in heard.of("LOCAL_POSITION_NED") if r.t_s > 133.0]
    assert max(math.hypot(m.vx, m.vy) for m in late) < 0.15  # setpoints of 3 m/s go on and are ignored
    assert math.hypot(late[-1].x - late[0].x, late[-1].y - late[0].y) < 0.3


def _without_one_ack(records: Log) -> Log:
    gone = records.of("COMMAND_ACK")[17]
    return Log(r for r in records if r is not gone)


def _changed(kind: str, change: Callable[[object], None]) -> Callable[[Log], Log]:
    def apply(records: Log) -> Log:
        out = Log()
        for record in records:
            if record.kind == kind:
                message = copy.copy(record.message)
                change(message)
                record = Record(record.t_s, record.frame, message)
            out.append(record)
        return out

    return apply


def _mirror_yaw(message) -> None:
    message.yaw, message.yawspeed = -message.yaw, -message.yawspeed


def _swap_axes(message) -> None:
    message.vx, message.vy = message.vy, message.vx


def _upside_down(message) -> None:
    message.vz = -message.vz


def _mirror_gimbal(message) -> None:
    message.q = [message.q[0], message.q[1], message.q[2], -message.q[3]]


def _no_lock_flag(message) -> None:
    message.flags &= ~16


def _accept_everything(message) -> None:
    message.result = 0


@pytest.mark.parametrize(
    "mutation",
    [
        _without_one_ack,
        _changed("COMMAND_ACK", _accept_everything),
        _changed("ATTITUDE", _mirror_yaw),
        _changed("LOCAL_POSITION_NED", _swap_axes),
        _changed("LOCAL_POSITION_NED", _upside_down),
        _changed("GIMBAL_DEVICE_ATTITUDE_STATUS", _mirror_gimbal),
        _changed("GIMBAL_DEVICE_ATTITUDE_STATUS", _no_lock_flag),
        lambda records: Log(r for i, r in enumerate(records) if r.kind != "ATTITUDE" or i % 5),
    ],
    ids=["lost ack", "all accepted", "yaw sign", "axes", "down sign", "gimbal yaw sign", "lock flag", "lost messages"],
)
def test_the_comparison_notices(mutation, real, simulated):
    assert comparison.all_checks(real, mutation(simulated)) != []


def test_the_comparison_notices_a_shorter_time_out(real):
    other = play(new_autopilot(GUID_TIMEOUT=2.0), with_few_streams(companion_side()), 131.0)
    assert comparison.silence(real, other) != []


def test_the_real_flight_passes_its_own_comparison(real):
    assert comparison.all_checks(real, real) == []
