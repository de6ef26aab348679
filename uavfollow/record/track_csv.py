"""track.csv: one row per frame."""

from __future__ import annotations

import csv
from pathlib import Path

from tracker.messages import TargetState

COLUMNS = ("frame", "t_s", "x", "y", "w", "h", "confidence", "status", "reason")


class TrackCsv:
    """Writes the estimate of each frame; x, y, w, h are empty when no box is reported."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("w", newline="")
        self._writer = csv.writer(self._file)
        self._writer.writerow(COLUMNS)

    def write(self, frame: int, target: TargetState) -> None:
        """Append one row."""
        box = [f"{v:.3f}" for v in target.box.to_xywh()] if target.box is not None else [""] * 4
        tail = [f"{target.confidence:.4f}", target.status.value, target.reason.value]
        self._writer.writerow([frame, f"{target.t_s:.6f}", *box, *tail])

    def close(self) -> None:
        """Complete the file."""
        self._file.close()
