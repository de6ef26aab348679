from __future__ import annotations

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest

from sitl.plant.gimbal import GimbalParams, GimbalPlant
from sitl.plant.pose import camera_pose
from sitl.plant.quadrotor import Quadrotor
from sitl.plant.wind import Wind
from sitl.scene import CameraPose

DT_S = 1.0 / 400.0


def axes(pose: CameraPose) -> np.ndarray:
    """Columns: the optical axes in NED, written down independently of the code under test."""
    cy, sy = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    cp, sp = math.cos(pose.pitch_rad), math.sin(pose.pitch_rad)
    cr, sr = math.cos(pose.roll_rad), math.sin(pose.roll_rad)
    yaw = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    pitch = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    roll = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    return yaw @ pitch @ roll


def hovering(yaw_rad: float = 0.0) -> Quadrotor:
    quad = Quadrotor(pos_ned_m=(5.0, 6.0, -20.0), yaw_rad=yaw_rad)
    quad.hover()
    return quad


def test_angles_add_up_when_level() -> None:
    params = GimbalParams(misalignment_pitch_rad=0.01, misalignment_yaw_rad=0.02, misalignment_roll_rad=0.03)
    pose = camera_pose(hovering(0.5), GimbalPlant(params, -0.6, 0.3), (0.1, 0.0, 0.2))
    assert (pose.roll_rad, pose.pitch_rad, pose.yaw_rad) == pytest.approx((0.03, -0.59, 0.82))
    assert pose.pos_ned_m == pytest.approx((5.0 + 0.1 * math.cos(0.5), 6.0 + 0.1 * math.sin(0.5), -19.8))
    assert pose.rates_rad_s == pose.vel_ned_m_s == pytest.approx((0.0, 0.0, 0.0))


@pytest.mark.parametrize("heading", [0.0, 2.0, -3.0])
def test_straight_down_keeps_the_heading(heading: float) -> None:
    pose = camera_pose(hovering(heading), GimbalPlant(None, -math.pi / 2.0, 0.0))
    assert pose.pitch_rad == pytest.approx(-math.pi / 2.0, abs=1e-6)
    looking = axes(pose)
    assert looking[:, 0] == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)  # optical axis down
    assert looking[:, 1] == pytest.approx(
        [-math.sin(heading), math.cos(heading), 0.0], abs=1e-6
    )  # right of the picture


def _fly(side: float, params: GimbalParams, seconds: float) -> list[CameraPose]:
    """A lively flight; side -1 is its mirror image."""
    quad = Quadrotor(
        None, Wind((2.0, 1.0, 0.0), 1.0, 2.0, seed=3, mirrored=side < 0.0), (0.0, 0.0, -20.0), yaw_rad=side * 0.4
    )
    quad.hover()
    gimbal = GimbalPlant(params if side > 0.0 else params.mirrored(), -0.4, side * 0.3)
    poses = []
    for index in range(round(seconds / DT_S)):
        t_s = index * DT_S
        if index % 20 == 0:
            quad.command((4.0, side * 3.0, -0.5), side * 0.4, t_s)
            gimbal.command_rate(-0.2, side * 0.5, t_s)
        quad.step(t_s, DT_S)
        gimbal.step(t_s, DT_S, quad.roll_rad, quad.pitch_rad)
        poses.append(camera_pose(quad, gimbal, (0.1, side * 0.05, 0.15)))
    return poses


LOOSE = GimbalParams(
    misalignment_pitch_rad=0.02, misalignment_yaw_rad=-0.03, misalignment_roll_rad=0.04, stabilisation_residue=0.3
)


def test_rates_and_velocity_are_those_of_the_motion() -> None:
    poses = _fly(1.0, LOOSE, 1.5)
    worst_rate = worst_velocity = 0.0
    for before, after in pairwise(poses[100:]):
        turn = axes(before).T @ axes(after)
        seen = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / (2.0 * DT_S)
        # After a step the pose holds the rates with which it came there.
        worst_rate = max(worst_rate, float(np.abs(seen - np.array(after.rates_rad_s)).max()))
        moved = (np.array(after.pos_ned_m) - np.array(before.pos_ned_m)) / DT_S
        middle = 0.5 * (np.array(after.vel_ned_m_s) + np.array(before.vel_ned_m_s))
        worst_velocity = max(worst_velocity, float(np.abs(moved - middle).max()))
    # What a step of 2.5 ms cannot resolve of rates that reach 0.87 rad/s.
    assert worst_rate < 0.01
    assert worst_velocity < 0.005
    assert max(abs(v) for v in poses[-1].rates_rad_s) > 0.3


def test_the_mirror_image() -> None:
    for a, b in zip(_fly(1.0, LOOSE, 2.0), _fly(-1.0, LOOSE, 2.0), strict=True):
        assert b.pos_ned_m == pytest.approx((a.pos_ned_m[0], -a.pos_ned_m[1], a.pos_ned_m[2]), abs=1e-9)
        assert b.vel_ned_m_s == pytest.approx((a.vel_ned_m_s[0], -a.vel_ned_m_s[1], a.vel_ned_m_s[2]), abs=1e-9)
        assert (b.roll_rad, b.pitch_rad, b.yaw_rad) == pytest.approx((-a.roll_rad, a.pitch_rad, -a.yaw_rad), abs=1e-9)
        assert b.rates_rad_s == pytest.approx((-a.rates_rad_s[0], a.rates_rad_s[1], -a.rates_rad_s[2]), abs=1e-9)


def test_the_picture_stays_level_but_for_the_residue() -> None:
    tight = dataclasses.replace(LOOSE, misalignment_roll_rad=0.0, misalignment_pitch_rad=0.0, stabilisation_residue=0.0)
    assert max(abs(p.roll_rad) for p in _fly(1.0, tight, 1.0)) < 1e-12
    leaky = dataclasses.replace(tight, stabilisation_residue=0.1)
    assert 0.002 < max(abs(p.roll_rad) for p in _fly(1.0, leaky, 1.0)) < 0.08
