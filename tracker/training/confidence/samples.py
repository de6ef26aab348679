"""What the confidence is fitted on: features of a best candidate, and whether it was the target."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
import numpy.typing as npt

from tracker.confidence.features import FEATURES, INDICATORS
from tracker.messages import Array

ON_TARGET_IOU = 0.2  # with less overlap a box is of something else, or of a part that tells nothing
PROBE_SHARE = 0.5  # of the weight: what is searched for on purpose counts as much as what happens while tracking


class SampleKind(str, Enum):
    """How a sample came about."""

    TRACK = "track"  # while following
    DRIFT = "drift"  # while following something else
    ABSENT = "absent"  # a probe of a window without the target
    SEARCH = "search"  # a probe of a window somewhere around the target, as after an occlusion


PROBES = (SampleKind.ABSENT, SampleKind.SEARCH)


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """One search: whose sequence, features (len(FEATURES),), the tracker's own score, is it the target."""

    sequence: str
    kind: SampleKind
    features: Array
    score: float
    on_target: bool


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """N samples: features (N, len(FEATURES)), score (N,), on_target (N,), probe (N,), sequence and weight (N,).

    Every sequence has the same weight; in each, probes have PROBE_SHARE of it. The weights sum to N.
    """

    features: Array
    score: Array
    on_target: npt.NDArray[np.bool_]
    probe: npt.NDArray[np.bool_]
    sequence: npt.NDArray[np.str_]
    weight: Array

    @classmethod
    def of(cls, samples: Sequence[Sample]) -> Table:
        """From samples."""
        sequence = np.array([s.sequence for s in samples], dtype=np.str_)
        probe = np.array([s.kind in PROBES for s in samples], dtype=bool)
        features = np.array([s.features for s in samples]).reshape(-1, len(FEATURES))
        return cls(
            features=features,
            score=np.array([s.score for s in samples], dtype=np.float64),
            on_target=np.array([s.on_target for s in samples], dtype=bool),
            probe=probe,
            sequence=sequence,
            weight=_weights(sequence, probe),
        )

    def __len__(self) -> int:
        """Samples."""
        return len(self.score)

    @property
    def sequences(self) -> tuple[str, ...]:
        """Their names, sorted."""
        return tuple(str(name) for name in np.unique(self.sequence))

    def only(self, rows: npt.NDArray[np.bool_]) -> Table:
        """The rows of a mask (N,), weighted anew."""
        sequence, probe = self.sequence[rows], self.probe[rows]
        weight = _weights(sequence, probe)
        return Table(self.features[rows], self.score[rows], self.on_target[rows], probe, sequence, weight)

    def without_motion(self) -> Table:
        """The same samples judged by appearance alone, as when several candidates are compared."""
        features = self.features.copy()
        features[:, [i for i, name in enumerate(FEATURES) if INDICATORS.get(name, name) == "has_motion"]] = 0.0
        return replace(self, features=features)

    def rows_of(self, sequences: Iterable[str]) -> npt.NDArray[np.bool_]:
        """Mask (N,) of the samples of these sequences."""
        return np.asarray(np.isin(self.sequence, list(sequences)), dtype=bool)


def _weights(sequence: npt.NDArray[np.str_], probe: npt.NDArray[np.bool_]) -> Array:
    weight = np.zeros(len(sequence))
    names = np.unique(sequence)
    for name in names:
        mine = sequence == name
        parts = [(mine & ~probe, 1.0 - PROBE_SHARE), (mine & probe, PROBE_SHARE)]
        there = [(rows, share) for rows, share in parts if rows.any()]
        total = sum(share for _, share in there)
        for rows, share in there:
            weight[rows] = share / total / rows.sum() * len(sequence) / len(names)
    return weight
