"""What a training run says on standard error while it goes."""

from __future__ import annotations

import sys

from tracker.training.progress import Progress
from uavfollow.progress import ProgressLine

TOTAL = "total"  # the loss that is learned, by its name among the losses
MINUTE_S, MINUTES_PER_HOUR = 60.0, 60


class TrainProgress:
    """A line with stage, pairs, speed, loss and remaining time; notes stay. Says nothing when `quiet`."""

    def __init__(self, quiet: bool = False) -> None:
        self._quiet = quiet or sys.stderr is None
        self._line = ProgressLine()
        self._loss: float | None = None

    def show(self, progress: Progress) -> None:
        """Say how far it is, when it is time to; a note at once."""
        if self._quiet:
            return
        self._loss = progress.losses.get(TOTAL, self._loss)
        if self._line.due_s() is not None or progress.note:
            self._line.write(told(progress, self._loss))

    def close(self) -> None:
        """Clear the line."""
        self._line.close()


def told(progress: Progress, loss: float | None) -> str:
    """The line's text."""
    planned = f"/{progress.pairs_planned}" if progress.pairs_planned is not None else ""
    parts = [f"stage {progress.stage}/{progress.stages}", f"{progress.pairs}{planned} pairs"]
    if progress.pairs_per_s is not None:
        parts.append(f"{progress.pairs_per_s:.1f} pairs/s")
    if loss is not None:
        parts.append(f"loss {loss:.3f}")
    if progress.remaining_s is not None:
        parts.append(f"{duration(progress.remaining_s)} left")
    if progress.note:
        parts.append(progress.note)
    return "  ".join(parts)


def duration(seconds: float) -> str:
    """`40 s`, `12 min`, `3 h 20 min`."""
    if round(seconds) < MINUTE_S:
        return f"{seconds:.0f} s"
    minutes = round(seconds / MINUTE_S)
    hours, rest = divmod(minutes, MINUTES_PER_HOUR)
    return f"{hours} h {rest} min" if hours else f"{minutes} min"
