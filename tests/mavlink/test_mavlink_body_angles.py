"""Servo mounts report body angles under flags that say levelled: the roll gives them away."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from control.frames import gimbal_rotation, rotation_from_rpy, rpy_from_rotation
from uavfollow.mavlink.body_angles import DECIDING, BodyAngles


def servo(pitch, yaw, vehicle):
    """What the servos of a mount show that levels a camera at pitch and yaw (from the heading)."""
    return rpy_from_rotation(rotation_from_rpy(*vehicle[:2], 0.0).T @ gimbal_rotation(pitch, yaw))


@given(st.floats(-1.2, 0.2), st.floats(-1.0, 1.0), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_body_angles_are_turned_back_exactly(pitch, yaw, roll, tilt):
    judge = BodyAngles()
    judge.are_body = True
    vehicle = (roll, tilt, 0.0)
    assert judge.levelled(servo(pitch, yaw, vehicle), vehicle) == pytest.approx((0.0, pitch, yaw), abs=1e-9)


def test_the_verdict_needs_a_roll_and_several_reports():
    judge = BodyAngles()
    assert not any(judge.update(0.0, 0.0) for _ in range(100))
    assert not judge.are_body, "level flight says nothing"
    changes = [judge.update(-0.2, 0.2) for _ in range(2 * DECIDING)]
    assert changes.index(True) == DECIDING - 1
    assert judge.are_body
    assert changes.count(True) == 1


def test_a_stabilised_gimbal_is_left_as_it_is():
    judge = BodyAngles()
    for _ in range(50):
        judge.update(0.01, 0.3)
    assert not judge.are_body
    assert judge.levelled((0.01, -0.4, 0.2), (0.3, 0.1, 0.0)) == (0.01, -0.4, 0.2)


def test_single_bent_reports_change_nothing():
    judge = BodyAngles()
    for k in range(200):
        judge.update(-0.3 if k % 5 == 0 else 0.0, 0.3)
    assert not judge.are_body


def test_the_observed_flight():
    """mavlink.md 8.1: roll 27.5, pitch -7.1, target -20 was reported as roll -27.4, pitch -12.9.

    ArduPilot subtracts the angles, which points a mount by some degrees wrong at such a tilt; that is where it points.
    """
    judge = BodyAngles()
    judge.are_body = True
    vehicle = (math.radians(27.5), math.radians(-7.1), 0.0)
    _, pitch, _ = judge.levelled((math.radians(-27.4), math.radians(-12.9), 0.0), vehicle)
    assert math.degrees(pitch) == pytest.approx(-20.0, abs=2.0)
