"""From results to scores: of a sequence, of a tracker over all sequences, by attribute."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from tracker.benchmark.attributes import by_attribute as within_dataset
from tracker.benchmark.long_term import LongTerm, long_term, pooled
from tracker.benchmark.reliability import Reliability, reliability
from tracker.benchmark.scores import Curves, Flags, Mode, centre_errors_px, curves, mean_curves, on_target
from tracker.messages import Array, TargetStatus
from uavfollow.benchmark.job import Job
from uavfollow.benchmark.store import Result
from uavfollow.trackers import TrackerSpec


@dataclass(frozen=True, slots=True, eq=False)
class SequenceScore:
    """One tracker on one sequence. `curves` is None when no frame could be counted.

    `confidence` and `on_target` leave out the first frame, whose box was given. `errors_px` is NaN where there is no
    box or no target. `statuses` is None for a bare tracker, which has none of its own. `whole_frames`: images that the
    data set has of the sequence; `unread_frames`: those of ours that could not be read.
    """

    spec: TrackerSpec
    name: str
    dataset: str
    attributes: frozenset[str]
    frames: int
    whole_frames: int
    unread_frames: int
    seconds: float
    fps: float
    curves: Curves | None
    long_term: LongTerm
    confidence: Array
    on_target: Flags
    errors_px: Array
    statuses: tuple[TargetStatus, ...] | None

    @property
    def speed_frames_per_s(self) -> float | None:
        """Speed of tracker and target, without reading images; None when nothing was measured."""
        return self.frames / self.seconds if self.seconds > 0 else None

    @property
    def is_cut(self) -> bool:
        """Whether this is only the beginning of the sequence."""
        return self.frames < self.whole_frames


@dataclass(frozen=True, slots=True, eq=False)
class TrackerScore:
    """One tracker over several sequences: curves are means of sequences, all else pools their frames."""

    spec: TrackerSpec
    sequences: int
    frames: int
    unread_frames: int
    curves: Curves | None
    long_term: LongTerm
    reliability: Reliability
    speed_frames_per_s: float | None


def score_sequence(job: Job, result: Result, mode: Mode) -> SequenceScore:
    """The scores of a finished job."""
    sequence, rows = job.sequence, result.rows
    boxes = [row.box for row in rows]
    statuses = tuple(row.status for row in rows)
    confidence = [c if c is not None and math.isfinite(c) else 0.0 for c in (row.confidence for row in rows[1:])]
    return SequenceScore(
        spec=job.spec,
        name=job.name,
        dataset=sequence.dataset,
        attributes=sequence.attributes,
        frames=len(rows),
        whole_frames=job.whole_frames,
        unread_frames=result.header.unread,
        seconds=result.header.seconds,
        fps=sequence.fps,
        curves=curves(boxes, sequence.truth, mode),
        long_term=long_term(
            boxes,
            statuses,
            sequence.truth,
            sequence.fps,
            writes=[row.memory.box if row.memory is not None else None for row in rows],
            raw=job.spec.raw,
        ),
        confidence=np.clip(np.asarray(confidence, dtype=np.float64), 0.0, 1.0),
        on_target=on_target(boxes, sequence.truth)[1:],
        errors_px=centre_errors_px(boxes, sequence.truth),
        statuses=None if job.spec.raw else statuses,
    )


def score_tracker(spec: TrackerSpec, scores: Iterable[SequenceScore]) -> TrackerScore:
    """Those of `scores` that are of this tracker, together."""
    own = [score for score in scores if score.spec == spec]
    frames, seconds = sum(score.frames for score in own), sum(score.seconds for score in own)
    said = [score.confidence for score in own]
    true = [score.on_target for score in own]
    return TrackerScore(
        spec=spec,
        sequences=len(own),
        frames=frames,
        unread_frames=sum(score.unread_frames for score in own),
        curves=mean_curves(score.curves for score in own),
        long_term=pooled(score.long_term for score in own),
        reliability=reliability(
            np.concatenate(said) if said else np.zeros(0), np.concatenate(true) if true else np.zeros(0, dtype=bool)
        ),
        speed_frames_per_s=frames / seconds if seconds > 0 else None,
    )


def comparable(scores: Sequence[SequenceScore], specs: Sequence[TrackerSpec]) -> list[SequenceScore]:
    """Scores of the sequences that every tracker finished: means over different sequences compare nothing."""
    finished: dict[str, set[TrackerSpec]] = {}
    for score in scores:
        finished.setdefault(score.name, set()).add(score.spec)
    return [score for score in scores if finished[score.name] >= set(specs)]


def by_attribute(scores: Iterable[SequenceScore]) -> dict[str, tuple[float, float, int]]:
    """AUC, precision and number of sequences for each attribute of one tracker's scores.

    With several data sets it is the mean of their means, as published averages over two of them are made.
    """
    datasets: dict[str, list[SequenceScore]] = {}
    for score in scores:
        datasets.setdefault(score.dataset, []).append(score)
    groups: dict[str, list[tuple[int, Curves]]] = {}
    for own in datasets.values():
        for attribute, found in within_dataset((score.attributes, score.curves) for score in own).items():
            groups.setdefault(attribute, []).append(found)
    return {attribute: _mean_of_means(groups[attribute]) for attribute in sorted(groups)}


def _mean_of_means(found: Sequence[tuple[int, Curves]]) -> tuple[float, float, int]:
    auc, p20 = (float(np.mean([getattr(mean, name) for _, mean in found])) for name in ("auc", "p20"))
    return auc, p20, sum(count for count, _ in found)
