"""The shift of the picture by the camera's own motion, against an independent projection."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from control.camera import Intrinsics
from control.ego_motion import CameraMotion
from control.messages import GimbalFrame
from control.range import NO_RANGE, RangeEstimate
from tests.control.builders import gimbal, vehicle

CAMERA = Intrinsics.from_hfov(640, 480, math.radians(66))
THING = np.array([24.0, 3.0, -1.0])
DT_S = 0.1


def project(thing, pos, pitch, yaw):
    """Pixel of a place: NED offset -> forward, right, down of the camera, written out."""
    north, east, down = thing - pos
    ahead, right = math.cos(yaw) * north + math.sin(yaw) * east, -math.sin(yaw) * north + math.cos(yaw) * east
    forward = math.cos(pitch) * ahead - math.sin(pitch) * down
    below = math.sin(pitch) * ahead + math.cos(pitch) * down
    return CAMERA.cx_px + CAMERA.fx_px * right / forward, CAMERA.cy_px + CAMERA.fy_px * below / forward


def shift_between(first, second, range_estimate, frame=GimbalFrame.EARTH, heading=(0.0, 0.0)):
    motion, found = CameraMotion(), None
    pixel = project(THING, *first)
    for k, ((pos, pitch, yaw), nose) in enumerate(zip((first, second), heading, strict=True)):
        t_s = 100.0 + k * DT_S
        own = vehicle(yaw_rad=nose, t_s=t_s, pos_ned_m=tuple(pos))
        seen = yaw if frame is GimbalFrame.EARTH else yaw - nose
        found = motion.step(own, gimbal(pitch, seen, t_s=t_s, frame=frame), t_s, pixel, range_estimate, CAMERA)
    expected = np.subtract(project(THING, *second), pixel)
    return found, expected


def exact_range(pos):
    return RangeEstimate(float(np.linalg.norm(THING - np.array(pos))), 1.0, True)


@given(
    st.tuples(*[st.floats(-1, 1)] * 3), st.floats(-0.7, -0.2), st.floats(-0.2, 0.4),
    st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)), st.sampled_from(list(GimbalFrame)), st.floats(-3, 3),
)  # fmt: skip
def test_turn_and_way_together_are_exact(way, pitch, yaw, turn, frame, nose):
    start = np.array([0.0, 0.0, -12.0])
    first, second = (start, pitch, yaw), (start + np.array(way), pitch + turn[0], yaw + turn[1])
    found, expected = shift_between(first, second, exact_range(start), frame, (nose, nose + 0.3))
    assert found == pytest.approx(tuple(expected), abs=1e-6)


def test_signs():
    """Camera turns right: the thing goes left. Camera turns up: it goes down. Vehicle flies forward: outwards, down."""
    start = np.array([0.0, 0.0, -12.0])
    assert shift_between((start, -0.5, 0.1), (start, -0.5, 0.2), NO_RANGE)[0][0] < -30
    assert shift_between((start, -0.5, 0.1), (start, -0.4, 0.1), NO_RANGE)[0][1] > 30
    assert shift_between((start, -0.6, 0.1), (start + np.array([1.0, 0, 0]), -0.6, 0.1), exact_range(start))[0][1] > 5


def test_without_a_range_only_the_turn_counts():
    start = np.array([0.0, 0.0, -12.0])
    found, _ = shift_between((start, -0.5, 0.1), (start + np.array([0, 2.0, 0]), -0.5, 0.1), NO_RANGE)
    assert found == pytest.approx((0.0, 0.0), abs=1e-9)


def steps(*changes):
    """Shifts over telemetry of which some values are changed; the camera turns 0.02 rad a step."""
    motion, found = CameraMotion(), []
    for k, change in enumerate(changes):
        t_s = 100.0 + k * DT_S
        values = {"vehicle": {}, "gimbal": {}, "t_s": t_s, "pixel": (320.0, 240.0)} | change
        own = vehicle(**{"t_s": t_s} | values["vehicle"])
        looks = gimbal(**{"pitch_rad": -0.5, "yaw_rad": 0.02 * k, "t_s": t_s} | values["gimbal"])
        found.append(motion.step(own, looks, values["t_s"], values["pixel"], NO_RANGE, CAMERA))
    return found


def test_a_steady_turn_moves_every_step():
    assert [s[0] < -5 for s in steps({}, {}, {})] == [False, True, True]


@pytest.mark.parametrize(
    "change",
    [
        {"vehicle": {"attitude_valid": False}},
        {"gimbal": {"valid": False}},
        {"vehicle": {"yaw_rad": math.nan}},
        {"gimbal": {"pitch_rad": math.inf}},
        {"gimbal": {"t_s": 99.0}},  # a report of another time
        {"t_s": math.nan},
        {"pixel": None},
    ],
)
def test_what_is_not_known_moves_nothing_and_neither_does_the_next(change):
    found = steps({}, change, {}, {})
    assert found[1] == (0.0, 0.0)
    if "pixel" not in change:
        assert found[2] == (0.0, 0.0), "there is no exposure before it to compare with"
    assert found[3][0] < -5


def test_a_long_gap_and_a_wild_turn_move_nothing():
    assert steps({}, {"t_s": 102.0, "vehicle": {"t_s": 102.0}, "gimbal": {"t_s": 102.0}})[1] == (0.0, 0.0)
    assert steps({}, {"gimbal": {"yaw_rad": 1.2}})[1] == (0.0, 0.0)


@pytest.mark.parametrize("late_s", [0.0, 0.04, DT_S])
def test_a_late_or_repeated_exposure_tells_nothing_and_the_way_is_told_once(late_s):
    """A picture that came late is one of the past: the camera is not moved back, and not moved again after it."""

    def told(times):
        motion, found = CameraMotion(), []
        for t_s in times:
            turn = 0.2 * (t_s - 100.0)
            looks = gimbal(-0.5, turn, t_s=t_s, frame=GimbalFrame.EARTH)
            found.append(motion.step(vehicle(t_s=t_s), looks, t_s, (320.0, 240.0), NO_RANGE, CAMERA)[0])
        return found

    on_time = told([100.0, 100.1, 100.2])
    late = told([100.0, 100.1, 100.1 - late_s, 100.2])
    assert min(abs(x) for x in on_time[1:]) > 5
    assert late[2] == 0.0
    assert [late[0], late[1], late[3]] == on_time
