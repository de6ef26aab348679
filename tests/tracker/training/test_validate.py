"""Validation inside training, and the budget of a recipe."""

from __future__ import annotations

import dataclasses

import pytest
import torch

from tests.tracker.training.blobs import TINY, Pictures, after, footage, never, recipe, stage, tiny_network
from tracker.box import Box
from tracker.messages import Candidate, Frame, ImageU8
from tracker.siamapnpp.fold import fold
from tracker.siamapnpp.variants import make_network
from tracker.training.budget import planned_pairs, rescale
from tracker.training.errors import TrainingError
from tracker.training.frozen import freeze
from tracker.training.recipe import Stage
from tracker.training.types import Footage
from tracker.training.validate import (
    SETTINGS,
    SequenceScore,
    Tracks,
    Validated,
    evaluation_copy,
    follow,
    mean_score,
    validate,
)


class Perfect:
    """Knows the square's way; takes down what it was started with and shown."""

    def __init__(self) -> None:
        self.box: Box | None = None
        self.seen: list[int] = []

    def init(self, frame: Frame, box: Box) -> None:
        self.box = box
        self.seen.append(frame.seq)

    def update(self, frame: Frame) -> tuple[Candidate, ...]:
        self.seen.append(frame.seq)
        return (Candidate(Box(45.0 + 3 * frame.seq, 55.0, 30.0, 30.0), 1.0, 1.0, 1.0),)


def test_the_track_begins_at_the_first_usable_box_cut_to_the_picture() -> None:
    item = footage(frames=4)
    outside = Box(300.0, 55.0, 30.0, 30.0)
    partly = Box.from_corners(-20.0, 40.0, 60.0, 70.0)
    item = dataclasses.replace(item, truth=(None, outside, partly, item.truth[3]))
    tracker = Perfect()
    boxes = follow(tracker, item, range(len(item.truth)), never)  # type: ignore[arg-type]
    assert boxes is not None
    assert len(boxes) == 2
    assert tracker.seen == [2, 3]
    assert tracker.box is not None
    assert tracker.box.to_corners() == pytest.approx((0.0, 40.0, 60.0, 70.0), abs=1e-5)


def test_a_picture_that_cannot_be_read_is_a_frame_without_a_box() -> None:
    tracker = Perfect()
    boxes = follow(tracker, footage(frames=5, broken=frozenset({0, 3})), range(5), never)  # type: ignore[arg-type]
    assert boxes is not None
    assert [b is None for b in boxes] == [False, False, True, False]
    assert tracker.seen == [1, 2, 4]


def test_scores_of_a_network_on_sequences_and_their_bound() -> None:
    items = [footage("first", 5), footage("second", 5, frozenset({2}))]
    network = tiny_network().eval()
    before = {k: v.clone() for k, v in network.state_dict().items()}
    scores = validate(network, items, SETTINGS, Tracks(max_frames=4), never)
    assert scores is not None
    assert [(s.name, s.frames) for s in scores] == [("first", 4), ("second", 4)]
    assert all(s.auc is not None and 0 < s.auc <= 20 / 21 for s in scores)  # the first frame's box is the truth
    assert isinstance(items[0].images, Pictures)
    assert items[0].images.read == 4
    assert all(torch.equal(v, before[k]) for k, v in network.state_dict().items())


@pytest.mark.parametrize("variant", ["siamapn", "apn_df", "self_aan", "aan"])
@pytest.mark.parametrize("frozen_layers", [0, 2])
def test_every_variant_can_be_scored_as_it_is_trained(variant: str, frozen_layers: int) -> None:
    """A frozen network is folded once more, and gives the maps of the plain one."""
    torch.manual_seed(0)
    network = make_network(TINY, variant)
    other = evaluation_copy(network, network.state_dict())
    freeze(network, frozen_layers)
    copied = evaluation_copy(network.train(), other.state_dict())
    crops = torch.rand(1, 3, 127, 127) * 255, torch.rand(1, 3, 223, 223) * 255
    with torch.no_grad():
        wanted, got = other(*crops), fold(copied)(*crops)  # type: ignore[arg-type]
    for a, b in zip(wanted, got, strict=True):
        assert torch.allclose(a, b, atol=1e-3)
    assert validate(copied, [footage(frames=2)], SETTINGS, Tracks(), never) is not None
    assert network.training


def test_a_missing_box_is_a_miss() -> None:
    item = footage(frames=4, broken=frozenset({1, 2, 3}))
    scores = validate(tiny_network(), [item], SETTINGS, Tracks(), never)
    assert scores is not None
    assert scores[0].p20 == pytest.approx(0.25)


def test_validation_stops_at_once_and_then_has_no_score() -> None:
    item = footage(frames=6)
    assert validate(tiny_network(), [item], SETTINGS, Tracks(), after(2)) is None
    assert isinstance(item.images, Pictures)
    assert item.images.read == 2


def test_several_starts_are_spread_over_the_sequence_and_averaged() -> None:
    assert Tracks(3, 4).stretches(9) == [range(4), range(3, 7), range(6, 9)]
    assert Tracks(5).stretches(3) == [range(3), range(1, 3), range(2, 3)], "no start twice"
    item = footage(frames=4, broken=frozenset({1}))
    scores = validate(tiny_network(), [item], SETTINGS, Tracks(starts=2, max_frames=2), never)
    assert scores is not None
    assert scores[0].frames == 4
    halves = [validate(tiny_network(), [part], SETTINGS, Tracks(), never) for part in (_part(item, 0), _part(item, 2))]
    singles = [part[0].p20 for part in halves if part is not None]
    assert scores[0].p20 == pytest.approx(sum(p or 0.0 for p in singles) / 2)
    assert 0.5 <= (scores[0].p20 or 0.0) <= 0.75, "of the first half the second frame is missed"


def _part(item: Footage, first: int) -> Footage:
    return Footage("part", item.truth[first : first + 2], _Shifted(item, first))  # type: ignore[arg-type]


class _Shifted:
    """Two pictures of a sequence as a sequence of its own."""

    def __init__(self, item: Footage, first: int) -> None:
        self._item, self._first = item, first

    def __len__(self) -> int:
        return 2

    def __getitem__(self, index: int) -> ImageU8:
        return self._item.images[self._first + index]


def test_the_mean_leaves_out_what_has_no_score() -> None:
    scores = (SequenceScore("a", 4, 0.2, 0.5), SequenceScore("b", 0, None, None), SequenceScore("c", 6, 0.6, 1.0))
    assert mean_score(scores) == SequenceScore("mean", 10, pytest.approx(0.4), pytest.approx(0.75))  # type: ignore[arg-type]
    assert mean_score(scores[1:2]) is None
    assert Validated(1, 1.0, scores[1:2]).auc < 0 < Validated(1, 1.0, scores).auc


def test_a_recipe_in_minutes_keeps_its_proportions() -> None:
    given = recipe(Stage(minutes=30, warmup_pairs=1000), Stage(minutes=10))
    got = rescale(given, minutes=4.0)
    assert [s.minutes for s in got.stages] == [pytest.approx(3.0), pytest.approx(1.0)]
    assert got.stages[0].warmup_pairs == 100
    assert [s.pairs for s in rescale(given, pairs=4000).stages] == [3000, 1000]
    assert rescale(given) is given


def test_a_recipe_in_pairs_keeps_its_proportions() -> None:
    given = recipe(stage(6000, warmup_pairs=2000), stage(2000, search_px=287))
    got = rescale(given, pairs=800)
    assert [s.pairs for s in got.stages] == [600, 200]
    assert got.stages[0].warmup_pairs == 60
    assert planned_pairs(got.stages) == 800
    in_time = rescale(given, minutes=10.0)
    ratio = (127**2 + 287**2) / (127**2 + 223**2) / 3
    assert in_time.stages[1].minutes / in_time.stages[0].minutes == pytest.approx(ratio)  # type: ignore[operator]
    assert sum(s.minutes or 0 for s in in_time.stages) == pytest.approx(10.0)
    assert planned_pairs(in_time.stages) is None


@pytest.mark.parametrize(
    "wanted", [{"minutes": 0.0}, {"minutes": float("nan")}, {"pairs": -5}, {"minutes": 1, "pairs": 1}]
)
def test_lengths_that_make_no_sense(wanted: dict[str, float]) -> None:
    with pytest.raises(TrainingError):
        rescale(recipe(stage(100)), **wanted)  # type: ignore[arg-type]


def test_mixed_units_have_no_proportions() -> None:
    with pytest.raises(TrainingError, match="in pairs and some in minutes"):
        rescale(recipe(stage(100), Stage(minutes=1.0)), minutes=3.0)
