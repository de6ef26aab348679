"""What a benchmark came to: all that its tables, plots and files are made of."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from tracker.benchmark.scores import Mode
from uavfollow.benchmark.scoring import SequenceScore, TrackerScore, comparable, score_tracker
from uavfollow.trackers import TrackerSpec


@dataclass(frozen=True)
class Failure:
    """What could not be tracked or read: `where` is a sequence with its tracker, a file, or a path of the user."""

    where: str
    message: str

    def __str__(self) -> str:
        return f"{self.where}: {self.message}"


@dataclass(frozen=True)
class Report:
    """`engines` are those of the trackers, in the order in which they are shown. `reused`: results that lay there.

    `max_frames` and `fps` are what the user asked for, None: the whole sequences at the data set's own rate.
    `further`: trackers whose results lie in the same folder, but which this command did not name.
    """

    mode: Mode
    engines: dict[TrackerSpec, str]
    cpu: str
    scores: tuple[SequenceScore, ...]
    failures: tuple[Failure, ...]
    reused: int
    max_frames: int | None = None
    fps: float | None = None
    further: tuple[str, ...] = ()

    @property
    def specs(self) -> tuple[TrackerSpec, ...]:
        """The trackers."""
        return tuple(self.engines)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The sequences that at least one tracker finished."""
        return tuple(dict.fromkeys(score.name for score in self.scores))

    @cached_property
    def compared(self) -> tuple[SequenceScore, ...]:
        """Scores of the sequences that every tracker finished: what means are made of."""
        return tuple(comparable(self.scores, self.specs))

    @cached_property
    def totals(self) -> tuple[TrackerScore, ...]:
        """Each tracker over what is compared."""
        return tuple(score_tracker(spec, self.compared) for spec in self.specs)

    def total_of(self, dataset: str) -> tuple[TrackerScore, ...]:
        """Each tracker over what is compared of one data set."""
        own = [score for score in self.compared if score.dataset == dataset]
        return tuple(score_tracker(spec, own) for spec in self.specs)

    @property
    def datasets(self) -> tuple[str, ...]:
        """Data sets of what is compared."""
        return tuple(dict.fromkeys(score.dataset for score in self.compared))

    def score_of(self, spec: TrackerSpec, name: str) -> SequenceScore | None:
        """One tracker on one sequence, None where it failed."""
        return next((s for s in self.scores if s.name == name and s.spec == spec), None)
