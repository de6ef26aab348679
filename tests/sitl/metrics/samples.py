"""Samples of a run for tests: a target seen and tracked well, spoiled where a test says so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from sitl.metrics.sample import Sample
from sitl.scene import ObjectTruth
from tracker.box import Box

DT_S = 1 / 30
BOX = Box(320, 240, 40, 20)
TRUTH = ObjectTruth("target", BOX, BOX, 1.0, 0.0, (320.0, 240.0), 23.0)
HIDDEN = ObjectTruth("target", BOX, None, 0.0, 0.0, (320.0, 240.0), 23.0)
GOOD = Sample(
    t_s=0.0,
    now_s=0.1,
    status="LOCKED",
    reason="seen",
    box=BOX,
    truth=TRUTH,
    aim_px=(320.0, 240.0),
    following=True,
    command_v_ned_m_s=(1.0, 0.0, 0.0),
    command_yaw_rate_rad_s=0.0,
    command_reason="tracking",
    command_sent=True,
    gimbal_pitch_rate_rad_s=0.0,
    gimbal_yaw_rate_rad_s=0.0,
    gimbal_reason="tracking",
    vehicle_pos_ned_m=(0.0, 0.0, -12.0),
    vehicle_vel_ned_m_s=(0.0, 0.0, 0.0),
    vehicle_yaw_rad=0.0,
    target_pos_ned_m=(20.0, 0.0, 0.0),
    target_vel_ned_m_s=(0.0, 0.0, 0.0),
)
FAR_BOX = Box(100, 100, 40, 20)


def run(n: int, change: Callable[[int, Sample], Sample] = lambda _, s: s) -> list[Sample]:
    """`n` samples at 30 Hz, each GOOD and then changed."""
    return [change(i, replace(GOOD, t_s=i * DT_S, now_s=i * DT_S + 0.1)) for i in range(n)]
