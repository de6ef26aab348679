"""steps.csv: one row for each picture that was taken up, with the truth beside what was estimated and commanded."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

from sitl.run import Step
from tracker.box import Box

_BOX = ("x", "y", "w", "h")
COLUMNS = (
    "frame", "t_s", "now_s", "status", "reason", "confidence", *_BOX, *(f"true_{n}" for n in _BOX), "visibility",
    "iou", "centre_err_px", "ground_range_m", "following", "flight_reason", "cmd_north_m_s", "cmd_east_m_s",
    "cmd_down_m_s", "cmd_yaw_rate_deg_s", "vehicle_reason", "gimbal_pitch_rate_deg_s", "gimbal_yaw_rate_deg_s",
    "gimbal_reason", "vehicle_north_m", "vehicle_east_m", "vehicle_down_m", "vehicle_yaw_deg", "target_north_m",
    "target_east_m", "fault",
)  # fmt: skip


def write_steps_csv(path: Path, steps: Sequence[Step], begin_s: float) -> None:
    """Write all rows; times count from the scenario's time 0, empty cells are not known."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        writer.writerows(_row(step, begin_s) for step in steps)


def _row(step: Step, begin_s: float) -> list[object]:
    sample, decision = step.sample, step.decision
    truth = sample.truth.amodal if sample.truth is not None else None
    error = ground = ""
    if sample.truth is not None and sample.truth.centre_px is not None:
        error = f"{math.dist(sample.truth.centre_px, sample.aim_px):.2f}"
    ground = f"{math.dist(sample.vehicle_pos_ned_m[:2], sample.target_pos_ned_m[:2]):.3f}"
    return [
        step.seen.seq,
        f"{sample.t_s - begin_s:.4f}",
        f"{sample.now_s - begin_s:.4f}",
        sample.status,
        sample.reason,
        f"{decision.confidence:.4f}",
        *_cells(sample.box),
        *_cells(truth),
        f"{sample.visibility:.4f}",
        f"{sample.iou:.4f}",
        error,
        ground,
        int(sample.following),
        decision.flight_reason,
        *(f"{v:.4f}" for v in sample.command_v_ned_m_s),
        f"{math.degrees(sample.command_yaw_rate_rad_s):.4f}",
        sample.command_reason,
        f"{math.degrees(sample.gimbal_pitch_rate_rad_s):.4f}",
        f"{math.degrees(sample.gimbal_yaw_rate_rad_s):.4f}",
        sample.gimbal_reason,
        *(f"{v:.4f}" for v in sample.vehicle_pos_ned_m),
        f"{math.degrees(sample.vehicle_yaw_rad):.3f}",
        *(f"{v:.4f}" for v in sample.target_pos_ned_m[:2]),
        decision.fault or "",
    ]


def _cells(box: Box | None) -> list[str]:
    return [f"{v:.3f}" for v in box.to_xywh()] if box is not None else [""] * 4
