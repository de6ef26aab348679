"""The raw tracker over whole sequences: is a network any better at what it is for?"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

from torch import Tensor, nn

from tracker.benchmark.scores import score
from tracker.box import Box
from tracker.engines.torch_engine import TorchEngine
from tracker.messages import Frame, ImageU8
from tracker.siamapnpp.network import SiamAPNpp
from tracker.siamapnpp.settings import CentreTerm, TrackerSettings
from tracker.siamapnpp.tracker import SiamAPNTracker, check_box
from tracker.training.errors import TrainingError
from tracker.training.recipe import Validation
from tracker.training.types import Footage

SETTINGS = TrackerSettings(centre_term=CentreTerm.SIGMOID)  # as the embedded cards ask for
EDGE_PX = 1e-6  # a box cut exactly at the border may lie beyond it after rounding
FRAMES_PER_S = 30.0  # stamps only: the raw tracker does not look at them


@dataclass(frozen=True, slots=True)
class Tracks:
    """How each sequence is tracked: `starts` times, from frames spread evenly over it, at most `max_frames` each."""

    starts: int = 1
    max_frames: int | None = None

    @classmethod
    def of(cls, validation: Validation) -> Tracks:
        """As a recipe says."""
        return cls(validation.starts, validation.max_frames)

    def stretches(self, length: int) -> list[range]:
        """The frames of each track over a sequence of so many."""
        begins = sorted({k * length // self.starts for k in range(self.starts)})
        return [range(begin, min(length, begin + (self.max_frames or length))) for begin in begins]

    def words(self) -> str:
        """For reports."""
        frames = "all frames" if self.max_frames is None else f"at most {self.max_frames} frames"
        return f"{frames} from each of {self.starts} starts" if self.starts > 1 else frames


@dataclass(frozen=True, slots=True)
class SequenceScore:
    """Honest scores (`tracker/benchmark/scores.py`) of one sequence; None when no frame of it had a target."""

    name: str
    frames: int
    auc: float | None
    p20: float | None


@dataclass(frozen=True, slots=True)
class Validated:
    """The scores after so many pairs and minutes of a run."""

    pairs: int
    minutes: float
    scores: tuple[SequenceScore, ...]

    @property
    def auc(self) -> float:
        """Mean over the sequences that have scores; -1 when none has."""
        mean = mean_score(self.scores)
        return -1.0 if mean is None or mean.auc is None else mean.auc


def validate(
    network: nn.Module,
    footage: Sequence[Footage],
    settings: TrackerSettings,
    tracks: Tracks,
    should_stop: Callable[[], bool],
) -> tuple[SequenceScore, ...] | None:
    """One score per sequence, tracked with a folded copy of `network` on its device; None when it was stopped.

    With several starts a sequence's scores are the means of its tracks. A track starts at the first frame with a usable
    box, cut to the picture; what lies before counts for nothing. A picture that cannot be read is a frame without box.
    """
    device = next(network.parameters()).device.type
    # Every variant has SiamAPNpp's template and search, which is all that the engine calls.
    engine = TorchEngine(cast(SiamAPNpp, network), device=device)
    scores = []
    for item in footage:
        parts = []
        for frames in tracks.stretches(len(item.truth)):
            boxes = follow(SiamAPNTracker(engine, settings), item, frames, should_stop)
            if boxes is None:
                return None
            found = score(boxes, item.truth[frames.stop - len(boxes) : frames.stop])
            parts.append(SequenceScore(item.name, found.frames, found.auc, found.p20))
        mean = mean_score(parts)
        scores.append(SequenceScore(item.name, 0, None, None) if mean is None else replace(mean, name=item.name))
    return tuple(scores)


def follow(
    tracker: SiamAPNTracker, footage: Footage, frames: range, should_stop: Callable[[], bool]
) -> list[Box | None] | None:
    """The tracker's box in every frame from the start of the track on; empty when it cannot start, None if stopped."""
    boxes: list[Box | None] = []
    for index in frames:
        truth = footage.truth[index]
        if should_stop():
            return None
        image = picture_of(footage, index)
        if boxes:
            found = tracker.update(_frame(image, index)) if image is not None else ()
            boxes.append(found[0].box if found else None)
        elif image is not None and (box := start_box(truth, image)) is not None:
            tracker.init(_frame(image, index), box)
            boxes.append(box)
    return boxes


def mean_score(scores: Sequence[SequenceScore]) -> SequenceScore | None:
    """Mean over the sequences that have scores, each counting the same; None when there are none."""
    known = [(s.frames, s.auc, s.p20) for s in scores if s.auc is not None and s.p20 is not None]
    if not known:
        return None
    auc, p20 = (sum(row[i] or 0.0 for row in known) / len(known) for i in (1, 2))
    return SequenceScore("mean", sum(row[0] for row in known), auc, p20)


def evaluation_copy(network: nn.Module, state: Mapping[str, Tensor]) -> nn.Module:
    """A copy with another state, in eval mode: validation never touches the network that learns."""
    result = copy.deepcopy(network)
    result.load_state_dict(dict(state))
    return result.eval()


def picture_of(footage: Footage, index: int) -> ImageU8 | None:
    """A frame of a sequence, None when it cannot be read."""
    try:
        return footage.images[index]
    except TrainingError:
        return None


def _frame(image: ImageU8, index: int) -> Frame:
    return Frame(image, index, index / FRAMES_PER_S, index / FRAMES_PER_S)


def start_box(truth: Box | None, image: ImageU8) -> Box | None:
    """The truth cut to the picture, None when no tracker can start with it."""
    if truth is None or not truth.is_valid:
        return None
    height, width = image.shape[:2]
    x1, y1, x2, y2 = truth.to_corners()
    box = Box.from_corners(max(x1, EDGE_PX), max(y1, EDGE_PX), min(x2, width - EDGE_PX), min(y2, height - EDGE_PX))
    try:
        check_box(box, width, height)
    except ValueError:
        return None
    return box
