"""How good is a model: the raw tracker over sequences with truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch

from tracker.training.recipe import Validation
from tracker.training.types import Footage
from tracker.training.validate import SequenceScore, Tracks, mean_score, validate
from uavfollow.errors import InputError
from uavfollow.interrupts import orderly_end
from uavfollow.progress import ProgressLine
from uavfollow.training.tools import network_of

NO_SCORE = "-"


@dataclass(frozen=True, slots=True)
class Judgement:
    """Scores of a model per sequence, and how they were tracked."""

    model: str
    tracks: Tracks
    scores: tuple[SequenceScore, ...]

    def lines(self) -> list[str]:
        """A table for the terminal; its last row is the mean over the sequences."""
        mean = mean_score(self.scores)
        rows = [*self.scores, *([mean] if mean else [])]
        width = max(len(row.name) for row in rows)
        head = f"model {self.model}, raw tracker, {self.tracks.words()}"
        return [head, *(f"{row.name:{width}}  {row.frames:6d} frames  {_scores(row)}" for row in rows)]

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        mean = mean_score(self.scores)
        return {
            "model": self.model,
            "starts": self.tracks.starts,
            "max_frames": self.tracks.max_frames,
            "sequences": {s.name: {"frames": s.frames, "auc": s.auc, "p20": s.p20} for s in self.scores},
            "mean": None if mean is None else {"auc": mean.auc, "p20": mean.p20},
        }


def judged(
    model: str,
    footage: Sequence[Footage],
    rules: Validation,
    starts: int | None,
    max_frames: int | None,
    threads: int | None,
) -> Judgement:
    """Track `footage` with a model, as `rules` say unless other numbers are given. Raises InputError, WeightsError."""
    if not footage:
        raise InputError("no sequence to track: name some, or add sources to the recipe's validation")
    if threads is not None:
        torch.set_num_threads(threads)
    network, settings = network_of(model)
    tracks = Tracks(starts or rules.starts, max_frames or rules.max_frames)
    total = sum(len(frames) for item in footage for frames in tracks.stretches(len(item.truth)))
    line, done = ProgressLine(), 0

    def count() -> bool:  # asked before every frame
        nonlocal done
        done += 1
        if line.due_s() is not None:
            line.write(f"{done}/{total} frames")
        return False

    try:
        with orderly_end():
            scores = validate(network, footage, settings, tracks, count)
    finally:
        line.close()
    assert scores is not None
    return Judgement(model, tracks, scores)


def _scores(row: SequenceScore) -> str:
    auc, p20 = (NO_SCORE if v is None else f"{v:.3f}" for v in (row.auc, row.p20))
    return f"AUC {auc}  P20 {p20}"
