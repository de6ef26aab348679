"""Tells how a run goes: progress now and then, rows of the curve, and how long it will take."""

from __future__ import annotations

from collections.abc import Callable

from torch import Tensor

from tracker.training.budget import planned_pairs, steps_of
from tracker.training.checkpoint import Position
from tracker.training.curves import Curves
from tracker.training.progress import Means, Progress, Speed
from tracker.training.recipe import Recipe

REPORT_S = 1.0  # a progress line more often cannot be read
ROW_S = 5.0  # between rows of the curve at first; later a share of the run, so that long runs have some 2,000 rows
ROW_SHARE = 1 / 500


class Reporter:
    """Looks at `position`, which the loop moves on. Without `report` (another process tells) it does nothing."""

    def __init__(
        self, recipe: Recipe, curves: Curves, position: Position, report: Callable[[Progress], None] | None
    ) -> None:
        self._recipe, self._curves, self._position, self._report = recipe, curves, position, report
        self._reported, self._row, self._speed = Means(), Means(), Speed()
        self._rate = 0.0
        self._told_s = position.total_s - REPORT_S
        self._row_s = position.total_s

    def step(self, losses: dict[str, Tensor] | None, rate: float, seconds: float) -> None:
        """A step was done at learning rate `rate` in so many seconds; `losses` is None when it was skipped."""
        self._rate = rate
        if self._report is None:
            return
        self._speed.add(self._recipe.stages[self._position.stage].batch, seconds)
        if losses is not None:
            self._reported.add(losses)
            self._row.add(losses)
        total_s = self._position.total_s
        if total_s - self._told_s >= REPORT_S:
            self.say("")
        if total_s - self._row_s >= max(ROW_S, ROW_SHARE * total_s):
            self.row()

    def say(self, note: str) -> None:
        """Report at once."""
        if self._report is None:
            return
        at, stages = self._position, self._recipe.stages
        self._told_s = at.total_s
        self._report(
            Progress(
                stage=min(at.stage + 1, len(stages)),
                stages=len(stages),
                pairs=at.pairs,
                pairs_planned=planned_pairs(stages),
                pairs_per_s=self._speed.pairs_per_s,
                losses=self._reported.take(),
                rate=self._rate,
                remaining_s=self._remaining_s(),
                note=note,
            )
        )

    def row(self) -> None:
        """Write the means since the last row, if there are any."""
        at = self._position
        losses = self._row.take()
        self._row_s = at.total_s
        if not losses:
            return
        speed = self._speed.pairs_per_s
        common = {
            "pairs": at.pairs,
            "minutes": f"{at.total_s / 60:.2f}",
            "stage": min(at.stage + 1, len(self._recipe.stages)),
            "rate": f"{self._rate:.4g}",
            "pairs_per_s": "" if speed is None else f"{speed:.2f}",
            "skipped": at.skipped_steps,
        }
        self._curves.add(common, losses)

    def _remaining_s(self) -> float | None:
        """Of the stages; what is counted in pairs goes on at the speed of now."""
        at, speed, seconds = self._position, self._speed.pairs_per_s, 0.0
        for index, stage in enumerate(self._recipe.stages[at.stage :]):
            steps = steps_of(stage)
            if steps is None:
                seconds += 60.0 * (stage.minutes or 0.0) - (at.stage_s if index == 0 else 0.0)
            elif speed is None:
                return None
            else:
                seconds += (steps - (at.step if index == 0 else 0)) * stage.batch / speed
        return max(seconds, 0.0)
