"""What a run says while it goes and when it ends, and the running means behind it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from torch import Tensor

from tracker.training.types import Skipped
from tracker.training.validate import Validated

SPEED_MEMORY_S = 20.0  # the speed follows a change of load within this time


@dataclass(frozen=True, slots=True)
class Progress:
    """One report. `stage` counts from 1; `losses` are means since the last report; None: not known (yet)."""

    stage: int
    stages: int
    pairs: int
    pairs_planned: int | None
    pairs_per_s: float | None
    losses: dict[str, float]
    rate: float
    remaining_s: float | None
    note: str


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a run ended. `finished`: all stages done, else it was stopped and can be resumed.

    `pairs` and `seconds` over all sessions of the run; `skipped_steps` whose loss or gradient was no use; `unused`:
    data that could not be used; `files` written at the end (empty on other processes than the first); `notes`: what
    else went wrong without ending the run.
    """

    finished: bool
    pairs: int
    seconds: float
    skipped_steps: int
    unused: Skipped
    validations: tuple[Validated, ...]
    files: tuple[Path, ...]
    notes: tuple[str, ...] = ()


class Means:
    """Means of losses since they were last taken. Adds on the device: nothing waits for it until then."""

    def __init__(self) -> None:
        self._sums: dict[str, Tensor] = {}
        self._count = 0

    def add(self, losses: dict[str, Tensor]) -> None:
        """One step's losses, scalars."""
        for name, value in losses.items():
            self._sums[name] = self._sums[name] + value if name in self._sums else value
        self._count += 1

    def take(self) -> dict[str, float]:
        """The means by name, empty when nothing was added; begins anew."""
        means = {name: float(value) / self._count for name, value in self._sums.items()}
        self._sums, self._count = {}, 0
        return means


class Speed:
    """Pairs per second, forgetting what was long ago."""

    def __init__(self) -> None:
        self._pairs = 0.0
        self._seconds = 0.0

    def add(self, pairs: int, seconds: float) -> None:
        """A step of so many pairs that took so long."""
        keep = math.exp(-max(seconds, 0.0) / SPEED_MEMORY_S)
        self._pairs = self._pairs * keep + pairs
        self._seconds = self._seconds * keep + max(seconds, 0.0)

    @property
    def pairs_per_s(self) -> float | None:
        """None before anything took any time."""
        return self._pairs / self._seconds if self._seconds > 0 else None
