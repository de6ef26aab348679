"""Collecting samples for the confidence with a tracker that sees colours: what is labelled what, and what is left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.training.blobs import after, footage, never
from tracker.box import Box
from tracker.confidence.features import FEATURES
from tracker.messages import Candidate, Evidence, Frame, MemorySlot, SearchHint
from tracker.training.confidence.collect import DRIFT_S, PROBE_EVERY, Collector, search_window_px, seen_frames
from tracker.training.confidence.places import absent_place, displaced, other_picture, search_place
from tracker.training.confidence.samples import ON_TARGET_IOU, PROBE_SHARE, Sample, SampleKind, Table
from tracker.training.types import Footage
from tracker.training.validate import FRAMES_PER_S, Tracks

SQUARE_BGR = (40, 200, 240)
SIDE_PX = 12.0


def evidence(good: bool, scale: float) -> Evidence:
    p = 0.9 if good else 0.2
    return Evidence((p, p, p), 0.2 if good else 0.9, 8.0 if good else 2.0, p, None, 0.0, 0.0, scale)


class Seeing:
    """Finds the square in its window, else reports the window's centre; `blind_from`: as of that frame number."""

    def __init__(self, blind_from: int = 10**6) -> None:
        self.blind_from = blind_from
        self.place, self.starts, self.kept, self.updates = (0.0, 0.0), [], [], 0  # type: ignore[var-annotated]
        self.box = Box(0.0, 0.0, SIDE_PX, SIDE_PX)

    def init(self, frame: Frame, box: Box) -> None:
        self.box, self.place = box, (box.cx_px, box.cy_px)
        self.starts.append(frame.seq)

    def update(self, frame: Frame, hint: SearchHint | None = None) -> tuple[Candidate, ...]:
        assert hint is not None
        self.updates += 1
        half = search_window_px(self.box) * hint.scale / 2
        seen = (frame.image_bgr_u8 == SQUARE_BGR).all(axis=2)
        rows, columns = np.nonzero(seen)
        here = (abs(columns + 0.5 - hint.center_px[0]) < half) & (abs(rows + 0.5 - hint.center_px[1]) < half)
        good = bool(here.sum() > 10) and frame.seq < self.blind_from
        self.place = hint.center_px
        if good:
            x, y = columns[here], rows[here]
            self.place = (float(x.min() + x.max() + 1) / 2, float(y.min() + y.max() + 1) / 2)
        elif frame.seq >= self.blind_from:
            self.place = (180.0, 10.0)
        box = replace(self.box, cx_px=self.place[0], cy_px=self.place[1])
        return (Candidate(box, 0.9 if good else 0.2, 0.5, 0.5, evidence(good, hint.scale)),)

    def remember(self, frame: Frame, box: Box, slot: MemorySlot) -> None:
        self.kept.append((frame.seq, box, slot))


class Canvas:
    """A small square that moves right by 1 px a frame in a picture large enough for windows without it."""

    def __init__(self, frames: int, empty: bool = False) -> None:
        self.frames, self.empty = frames, empty

    def __len__(self) -> int:
        return self.frames

    def __getitem__(self, index):  # type: ignore[no-untyped-def]
        image = np.full((160, 240, 3), 40, np.uint8)
        if not self.empty:
            image[74:86, 24 + index : 36 + index] = SQUARE_BGR
        return image


def square(frames: int) -> Footage:
    return Footage("square", tuple(Box(30.0 + k, 80.0, SIDE_PX, SIDE_PX) for k in range(frames)), Canvas(frames))


EMPTY = Footage("empty", (None,) * 3, Canvas(3, empty=True))


def collect(tracker: Seeing, frames: int, tracks: Tracks | None = None, seed: int = 0) -> list[Sample]:
    item = square(frames)
    rng = np.random.default_rng(seed)
    found = Collector(lambda: tracker, tracks or Tracks(), [item, EMPTY], rng, never).samples(item)
    assert found is not None
    return found


def kinds(samples: list[Sample]) -> dict[SampleKind, int]:
    return {kind: sum(s.kind is kind for s in samples) for kind in SampleKind}


def test_every_frame_is_a_sample_and_probes_are_labelled_by_what_is_there() -> None:
    samples = collect(Seeing(), 80)
    count = kinds(samples)
    assert count[SampleKind.TRACK] == 79
    assert count[SampleKind.DRIFT] == 0
    assert count[SampleKind.SEARCH] == count[SampleKind.ABSENT] == 79 // PROBE_EVERY
    for sample in samples:
        good = sample.features[FEATURES.index("head_1")] > 0
        assert sample.on_target == (sample.kind is not SampleKind.ABSENT) == good, sample
        assert sample.features.shape == (len(FEATURES),)


def test_probes_leave_no_trace() -> None:
    """The same track with other probes: the samples of following are the same, and the tracker saw nothing else."""
    tracker = Seeing()
    collect(tracker, 20)
    assert tracker.updates == 19
    first, second = (collect(Seeing(), 60, seed=seed) for seed in (1, 2))
    probed = [s.features for s in first if s.kind is SampleKind.SEARCH]
    assert not np.array_equal(probed, [s.features for s in second if s.kind is SampleKind.SEARCH])
    followed = [[s.features for s in some if s.kind is SampleKind.TRACK] for some in (first, second)]
    assert np.array_equal(*followed)


def test_innovations_of_searches_are_those_of_a_coast() -> None:
    samples = collect(Seeing(), 80)
    nis = {kind: [s.features[FEATURES.index("nis")] for s in samples if s.kind is kind] for kind in SampleKind}
    apart = [s.features[FEATURES.index("innovation")] for s in samples if s.kind is SampleKind.SEARCH]
    assert np.median(apart) > 0.5, "the target is far off the prediction"
    assert np.percentile(nis[SampleKind.SEARCH], 90) < np.log1p(30), "but as its covariance says"
    assert {s.features[FEATURES.index("search_scale")] > 0 for s in samples if s.kind is SampleKind.SEARCH} == {
        True,
        False,
    }


def test_the_reference_is_taken_while_following() -> None:
    ready = [s.features[FEATURES.index("has_reference")] for s in collect(Seeing(), 60) if s.kind is SampleKind.TRACK]
    assert ready[: int(FRAMES_PER_S) - 1] == [0.0] * (int(FRAMES_PER_S) - 1)
    assert ready[-1] == 1.0


def test_a_tracker_that_lost_the_target_goes_on_for_a_while_and_is_started_again() -> None:
    tracker = Seeing(blind_from=20)
    samples = collect(tracker, 130)
    lost = [s for s in samples if s.kind is SampleKind.DRIFT]
    assert not any(s.on_target for s in lost)
    assert tracker.starts[:2] == [0, 20 + round(DRIFT_S * FRAMES_PER_S) + 1]
    assert not any(s.kind is SampleKind.SEARCH for s in samples[samples.index(lost[0]) : samples.index(lost[80])])


def test_exemplars_are_kept_while_sure() -> None:
    tracker = Seeing(blind_from=70)
    collect(tracker, 110)
    assert [seq for seq, _, _ in tracker.kept] == [30, 60]
    assert {slot for _, _, slot in tracker.kept} == {MemorySlot.RECENT}


def test_several_starts_unreadable_frames_and_a_stop() -> None:
    tracker = Seeing()
    collect(tracker, 40, Tracks(starts=2, max_frames=10))
    assert tracker.starts == [0, 20]
    assert seen_frames(Tracks(starts=2, max_frames=10), 40) == [range(10), range(20, 40, 3)]
    broken = footage(frames=5, broken=frozenset({0, 2}))
    assert len([s for s in _samples(broken) if s.kind is SampleKind.TRACK]) == 2
    assert Collector(Seeing, Tracks(), [], np.random.default_rng(0), after(3)).samples(square(9)) is None


def _samples(item: Footage) -> list[Sample]:
    return Collector(Seeing, Tracks(), [item], np.random.default_rng(0), never).samples(item) or []


def test_a_displaced_picture_shows_the_place_and_the_mean_colour_outside() -> None:
    image = np.full((20, 30, 3), 100, np.uint8)
    image[5, 7] = 200
    moved, offset = displaced(image, (20.0, 10.0), (7.0, 5.0))
    assert offset == (13.0, 5.0)
    assert moved.shape == image.shape
    assert (moved[10, 20] == 200).all()
    assert abs(int(moved[0, 0, 0]) - 100) <= 1
    far, _ = displaced(image, (20.0, 10.0), (500.0, 5.0), (8, 6))
    assert far.shape == (6, 8, 3)
    assert np.ptp(far) == 0


def test_an_absent_place_keeps_the_target_out_of_the_window() -> None:
    rng, truth = np.random.default_rng(3), Box(100.0, 60.0, 20.0, 10.0)
    places = [absent_place(rng, truth, (0.0, 0.0), 40.0, (240, 160)) for _ in range(50)]
    there = [p for p in places if p is not None]
    assert len(there) > 40
    assert all(max(abs(x - 100), abs(y - 60)) > 30 for x, y in there)
    assert absent_place(rng, truth, (0.0, 0.0), 400.0, (240, 160)) is None
    assert absent_place(rng, None, (100.0, 60.0), 400.0, (240, 160)) is not None


def test_a_search_place_is_within_the_window_and_as_wide_as_the_covariance() -> None:
    rng = np.random.default_rng(4)
    near = np.array([search_place(rng, np.diag([25.0, 4.0, 0, 0]), 200.0) for _ in range(400)])
    assert near.std(axis=0) == pytest.approx([5.0, 2.0], rel=0.15)
    far = np.array([search_place(rng, np.diag([1e6, 1e6, 0, 0]), 100.0) for _ in range(100)])
    assert np.abs(far).max() <= 40.0 + 1e-9


def test_another_picture_that_cannot_be_read_is_none() -> None:
    broken = footage(frames=1, broken=frozenset({0}))
    assert other_picture(np.random.default_rng(0), [broken], (5.0, 5.0), (8, 6)) is None


def test_every_sequence_and_the_probes_weigh_as_told() -> None:
    def some(name: str, kind: SampleKind, count: int) -> list[Sample]:
        return [Sample(name, kind, np.zeros(len(FEATURES)), 0.5, True)] * count

    table = Table.of(
        some("a", SampleKind.TRACK, 6) + some("a", SampleKind.ABSENT, 2) + some("a", SampleKind.SEARCH, 1)
        + some("b", SampleKind.DRIFT, 1)
    )  # fmt: skip
    assert table.weight.sum() == pytest.approx(len(table))
    a = table.rows_of(["a"])
    assert table.weight[a].sum() == pytest.approx(table.weight[~a].sum())
    assert table.weight[a & table.probe].sum() / table.weight[a].sum() == pytest.approx(PROBE_SHARE)
    alone = table.only(a)
    assert alone.sequences == ("a",)
    assert alone.weight.sum() == pytest.approx(9)
    assert 0 < ON_TARGET_IOU < 1
