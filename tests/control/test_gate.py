import math

import pytest

from control.gate import (
    MAX_TARGET_AGE_S,
    MAX_TELEMETRY_AGE_S,
    all_finite,
    gimbal_usable,
    has_jumped,
    is_fresh,
    target_hold,
    telemetry_hold,
)
from control.messages import CommandReason
from tests.control.builders import NOW_S, gimbal, target, vehicle
from tracker.box import Box
from tracker.messages import TargetStatus


def test_good_inputs_pass():
    assert target_hold(target(), NOW_S) is None
    assert target_hold(target(status=TargetStatus.COASTING), NOW_S) is None
    assert telemetry_hold(vehicle(), gimbal(), NOW_S) is None
    assert gimbal_usable(gimbal(), NOW_S)


@pytest.mark.parametrize("status", [s for s in TargetStatus if s not in (TargetStatus.LOCKED, TargetStatus.COASTING)])
def test_other_states_hold(status):
    assert target_hold(target(status=status), NOW_S) is CommandReason.HOLD_NO_TARGET


def test_a_target_without_a_valid_box_holds():
    assert target_hold(target(box=None), NOW_S) is CommandReason.HOLD_NO_TARGET
    assert target_hold(target(box=Box(1, 1, 0, 5)), NOW_S) is CommandReason.HOLD_NO_TARGET


def test_staleness_has_an_edge_on_both_sides():
    assert is_fresh(NOW_S - 0.25, NOW_S, 0.25)
    assert not is_fresh(NOW_S - 0.26, NOW_S, 0.25)
    assert is_fresh(NOW_S + 0.06, NOW_S, 0.25)
    assert not is_fresh(NOW_S + 0.1, NOW_S, 0.25)
    assert not is_fresh(math.nan, NOW_S, 0.25)
    assert target_hold(target(t_s=NOW_S - MAX_TARGET_AGE_S - 0.01), NOW_S) is CommandReason.HOLD_STALE_TARGET
    assert target_hold(target(t_s=NOW_S + 1), NOW_S) is CommandReason.HOLD_STALE_TARGET


@pytest.mark.parametrize("which", ["vehicle", "gimbal"])
def test_stale_telemetry_holds(which):
    old = {"t_s": NOW_S - MAX_TELEMETRY_AGE_S - 0.01}
    states = (vehicle(**old), gimbal()) if which == "vehicle" else (vehicle(), gimbal(**old))
    assert telemetry_hold(*states, NOW_S) is CommandReason.HOLD_NO_TELEMETRY
    assert gimbal_usable(gimbal(**old), NOW_S) is False


@pytest.mark.parametrize("flag", ["attitude_valid", "position_valid"])
def test_invalid_telemetry_holds_even_when_its_numbers_are_not_finite(flag):
    assert telemetry_hold(vehicle(math.nan, **{flag: False}), gimbal(), NOW_S) is CommandReason.HOLD_NO_TELEMETRY
    assert telemetry_hold(vehicle(), gimbal(valid=False), NOW_S) is CommandReason.HOLD_NO_TELEMETRY


def test_absurdly_large_is_not_finite():
    assert all_finite(1.0, -1e9)
    assert not all_finite(1.0, 1e200)


def reports(dt_s=0.1, **changes):
    before = vehicle(t_s=NOW_S, vel_ned_m_s=(4.0, 0.0, 0.0))
    after = {"t_s": NOW_S + dt_s, "vel_ned_m_s": (4.0, 0.0, 0.0), "pos_ned_m": (4.0 * dt_s, 0.0, -10.0)} | changes
    return before, vehicle(**after)


@pytest.mark.parametrize(
    ("changes", "jumped"),
    [
        ({}, False),
        ({"pos_ned_m": (1.8, 0.0, -10.0)}, False),
        ({"pos_ned_m": (5.4, 0.0, -10.0)}, True),
        ({"pos_ned_m": (0.4, 0.0, -14.0)}, True),
        ({"yaw_rad": 0.45}, False),
        ({"yaw_rad": 0.55}, True),
        ({"yaw_rad": -0.55}, True),
        ({"pos_ned_m": (50.0, 0.0, -10.0), "position_valid": False}, False),
        ({"pos_ned_m": (50.0, 0.0, -10.0), "dt_s": 1.1}, False),
        ({"pos_ned_m": (50.0, 0.0, -10.0), "dt_s": 0.0}, False),
    ],
)
def test_a_reset_of_the_estimator_is_no_motion(changes, jumped):
    assert has_jumped(*reports(**changes)) is jumped
