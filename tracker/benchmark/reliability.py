"""Does the confidence mean what it says: does it rank (ROC AUC), and is it a probability (calibration)?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tracker.benchmark.scores import Flags
from tracker.messages import Array

BINS = 10  # as calibration is commonly shown; fewer frames in a bin would make its share a guess


@dataclass(frozen=True, slots=True)
class Bin:
    """Frames whose confidence is in [low, high) (the last one: with its end), and how many of them were on target."""

    low: float
    high: float
    count: int
    mean_confidence: float | None
    on_target_share: float | None


@dataclass(frozen=True, slots=True)
class Reliability:
    """`roc_auc`: chance that a frame on target has more confidence than one that is not (ties count half); None when
    one of the two kinds is missing. `ece`: mean distance of the bins' shares from their confidence, by frames.
    `brier`: mean squared distance of the confidence from the outcome. Both are None without frames.
    """

    frames: int
    on_target_share: float | None
    roc_auc: float | None
    bins: tuple[Bin, ...]
    ece: float | None
    brier: float | None


def reliability(confidence: Sequence[float] | Array, on_target: Sequence[bool] | Flags) -> Reliability:
    """How good a probability of being on target the confidence is. One of each for every frame, pooled as wished.

    Raises ValueError when the lengths differ or a confidence is not in [0, 1].
    """
    said = np.asarray(confidence, dtype=np.float64).reshape(-1)
    true = np.asarray(on_target, dtype=bool).reshape(-1)
    if said.size != true.size:
        raise ValueError(f"{said.size} confidences against {true.size} outcomes: they must be as many")
    wrong = ~((said >= 0.0) & (said <= 1.0))
    if wrong.any():
        i = int(np.argmax(wrong))
        raise ValueError(f"confidence {said[i]} of frame {i}: must be in [0, 1]")
    bins = _bins(said, true)
    if not said.size:
        return Reliability(0, None, None, bins, None, None)
    return Reliability(
        frames=said.size,
        on_target_share=float(true.mean()),
        roc_auc=roc_auc(said, true),
        bins=bins,
        ece=_ece(bins, said.size),
        brier=float(np.mean((said - true) ** 2)),
    )


def roc_auc(score: Array, true: Flags) -> float | None:
    """Chance that a true case has a higher score than a false one, ties half; None when one kind is missing.

    By ranks (Mann-Whitney), which is the area under the ROC curve.
    """
    positives = int(true.sum())
    negatives = int(true.size) - positives
    if not positives or not negatives:
        return None
    _, place, count = np.unique(score, return_inverse=True, return_counts=True)
    last = np.cumsum(count)
    rank = (last - (count - 1) / 2.0)[place.reshape(-1)]  # equal scores share the mean of their ranks
    return float((rank[true].sum() - positives * (positives + 1) / 2.0) / (positives * negatives))


def _bins(said: Array, true: Flags) -> tuple[Bin, ...]:
    edges = np.linspace(0.0, 1.0, BINS + 1)
    place = np.clip(np.searchsorted(edges, said, side="right") - 1, 0, BINS - 1)
    return tuple(_bin(float(edges[k]), float(edges[k + 1]), said[place == k], true[place == k]) for k in range(BINS))


def _bin(low: float, high: float, said: Array, true: Flags) -> Bin:
    if not said.size:
        return Bin(low, high, 0, None, None)
    return Bin(low, high, int(said.size), float(said.mean()), float(true.mean()))


def _ece(bins: Sequence[Bin], frames: int) -> float:
    gaps = [
        b.count * abs(b.mean_confidence - b.on_target_share)
        for b in bins
        if b.mean_confidence is not None and b.on_target_share is not None
    ]
    return float(sum(gaps) / frames)
