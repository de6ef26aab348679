"""commands.csv: what gimbal and vehicle would be told in each step, and why."""

from __future__ import annotations

import csv
from pathlib import Path

from uavfollow.app import StepRecord

COLUMNS = (
    "frame", "t_s", "range_m", "gimbal_pitch_rate_rad_s", "gimbal_yaw_rate_rad_s", "gimbal_reason", "north_m_s",
    "east_m_s", "down_m_s", "yaw_rate_rad_s", "vehicle_reason", "fault",
)  # fmt: skip


class CommandsCsv:
    """Writes the commands of each step; `range_m` is empty when it is not known."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("w", newline="")
        self._writer = csv.writer(self._file)
        self._writer.writerow(COLUMNS)

    def write(self, record: StepRecord) -> None:
        """Append one row."""
        gimbal, vehicle, away = record.gimbal_command, record.velocity_command, record.range_estimate
        rates = (gimbal.pitch_rate_rad_s, gimbal.yaw_rate_rad_s)
        motion = (*vehicle.v_ned_m_s, vehicle.yaw_rate_rad_s)
        self._writer.writerow(
            [
                record.seq,
                f"{record.t_s:.6f}",
                f"{away.range_m:.3f}" if away.valid else "",
                *(f"{v:.5f}" for v in rates),
                gimbal.reason.value,
                *(f"{v:.4f}" for v in motion),
                vehicle.reason.value,
                record.fault or "",
            ]
        )

    def close(self) -> None:
        """Complete the file."""
        self._file.close()
