"""NanoTrack around its networks: conventions, hints, evidence, and that nothing makes its state go bad."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.tracker.nanotrack.fakes import CELLS, HEIGHT_PX, WIDTH_PX, ColourSession, frame, picture
from tracker.box import Box
from tracker.messages import SearchHint, SearchTile
from tracker.nanotrack.crop import crop_pixels
from tracker.nanotrack.settings import NanoSettings
from tracker.nanotrack.tracker import NanoTracker
from tracker.siamapnpp.crop import CropGeometry, crop_square

COV = (4.0, 0.0, 4.0)
START = (200.0, 180.0)


def _started(session: ColourSession | None = None, **changes: float) -> tuple[NanoTracker, ColourSession]:
    session = session or ColourSession()
    tracker = NanoTracker(session, NanoSettings(**changes))  # type: ignore[arg-type]
    tracker.init(frame(picture(START)), Box(*START, 32, 32))
    return tracker, session


def test_it_follows_a_moving_patch() -> None:
    tracker, _ = _started()
    for k in range(1, 15):
        cx, cy = START[0] + 6 * k, START[1] - 4 * k
        best = tracker.update(frame(picture((cx, cy)), k))[0]
        assert math.hypot(best.box.cx_px - cx, best.box.cy_px - cy) < 5.0
        assert best.box.iou(Box(cx, cy, 32, 32)) > 0.6
        assert best.score > 0.6


def test_a_mirrored_picture_gives_the_mirrored_box() -> None:
    boxes = []
    for flip in (False, True):
        session = ColourSession()
        left, right = (24.0, 44.0) if not flip else (44.0, 24.0)
        session.sides[0], session.sides[2] = left, right
        tracker = NanoTracker(session)
        images = [picture(START), picture((START[0] + 24, START[1] - 8))]
        images = [np.ascontiguousarray(image[:, ::-1]) if flip else image for image in images]
        tracker.init(frame(images[0]), Box(WIDTH_PX - START[0] if flip else START[0], START[1], 32, 32))
        boxes.append(tracker.update(frame(images[1], 1))[0].box)
    assert boxes[0].cx_px == pytest.approx(WIDTH_PX - boxes[1].cx_px, abs=1.0)
    assert boxes[0].cy_px == pytest.approx(boxes[1].cy_px, abs=0.1)
    assert boxes[0].w_px == pytest.approx(boxes[1].w_px, rel=0.01)
    assert boxes[0].cx_px > START[0] + 24  # more of the box lies to the right of its cell


def test_the_size_moves_by_penalty_times_score_times_rate() -> None:
    session = ColourSession()
    session.sides[:] = 127 / 2  # twice the target in both directions
    tracker, _ = _started(session, penalty_k=0.5, size_lr=0.4)
    best = tracker.update(frame(picture(START), 1))[0]
    # Twice the scale and no change of aspect: the penalty is exp(-(2 - 1) k).
    rate = math.exp(-0.5) * best.score * 0.4
    assert best.box.w_px == pytest.approx(32 + rate * 32, rel=1e-3)
    assert best.evidence is not None
    assert best.evidence.ln_scale == pytest.approx(math.log(2), abs=1e-3)
    assert best.evidence.ln_aspect == pytest.approx(0.0, abs=1e-6)


def test_a_hint_moves_the_window() -> None:
    far = (START[0] + 90, START[1])  # beyond the edge of the window around the last place
    tracker, session = _started()
    assert tracker.update(frame(picture(far), 1))[0].score < 0.5
    tracker, session = _started()
    best = tracker.update(frame(picture(far), 1), SearchHint((far[0] - 10, far[1]), COV))[0]
    assert best.score > 0.6
    assert best.box.cx_px == pytest.approx(far[0], abs=4.0)
    assert session.crops[-1].shape == (255, 255, 3)


def test_the_place_of_a_hint_is_kept_against_a_better_looking_one() -> None:
    tracker, session = _started()
    tracker.update(frame(picture(START), 1), SearchHint((START[0] + 40, START[1]), COV))
    tracker.update(frame(picture(START), 2))
    square = CropGeometry(START[0] + 40, START[1], 64 * 255 / 127, 255)
    assert np.array_equal(session.crops[-1], crop_pixels(picture(START), square, _mean(picture(START))))


def test_the_normal_window_is_cut_as_published_and_a_wider_one_as_ours() -> None:
    image = np.random.default_rng(0).integers(0, 256, (HEIGHT_PX, WIDTH_PX, 3), np.uint8)
    for scale, crop in ((1.0, crop_pixels), (2.0, crop_square)):
        session = ColourSession()
        tracker = NanoTracker(session)
        tracker.init(frame(image), Box(200.3, 180.4, 30, 34))
        tracker.update(frame(image, 1), SearchHint((200.3, 180.4), COV, scale))
        square = CropGeometry(200.3, 180.4, scale * math.sqrt(62.0 * 66.0) * 255 / 127, 255)
        assert np.array_equal(session.crops[-1], crop(image, square, _mean(image)))


def _mean(image: np.ndarray) -> tuple[float, float, float]:
    blue, green, red = image.reshape(-1, 3).mean(0)
    return float(blue), float(green), float(red)


def test_a_wider_window_sees_further_and_measures_the_same_size() -> None:
    far = (START[0] + 80, START[1])
    session = ColourSession()
    session.sides[:], session.square_px = 127 / 8, 31  # in a window of twice the size the target is half as large
    tracker, _ = _started(session)
    best = tracker.update(frame(picture(far), 1), SearchHint(START, COV, scale=2.0))[0]
    assert best.score > 0.8
    assert best.box.cx_px == pytest.approx(far[0], abs=8.0)
    assert best.box.w_px == pytest.approx(32, rel=0.05)
    assert best.evidence is not None
    assert best.evidence.search_scale == 2.0


def test_the_size_of_a_hint_is_taken_over() -> None:
    tracker, _ = _started()
    tracker.update(frame(picture(START), 1), SearchHint(START, COV, size_px=(64.0, 64.0)))
    best = tracker.update(frame(picture(START), 2), SearchHint(START, COV))[0]
    assert best.box.w_px > 55


def test_tiles_are_searched_as_far_as_the_calls_reach() -> None:
    far = (400.0, 60.0)
    hint = SearchHint(START, COV, max_calls=2, tiles=(SearchTile((395.0, 64.0)), SearchTile((60.0, 300.0))))
    tracker, session = _started()
    calls = len(session.crops)
    best = tracker.update(frame(picture(far), 1), hint)[0]
    assert len(session.crops) == calls + 2
    assert best.score > 0.6
    assert best.box.cx_px == pytest.approx(far[0], abs=5.0)
    assert best.box.cy_px == pytest.approx(far[1], abs=5.0)


def test_a_look_alike_is_a_second_candidate_and_shows_in_the_evidence() -> None:
    tracker, _ = _started()
    alone = tracker.update(frame(picture(START), 1))[0]
    both = tracker.update(frame(picture(START, (START[0] + 48, START[1])), 2))
    assert alone.evidence is not None
    assert both[0].evidence is not None
    assert alone.evidence.second < 0.5 < 0.9 < both[0].evidence.second
    assert both[0].box.cx_px == pytest.approx(START[0], abs=4.0)
    assert both[1].box.cx_px == pytest.approx(START[0] + 48, abs=6.0)
    assert both[1].score > 0.9
    assert alone.evidence.heads == (alone.score,)
    assert alone.evidence.sharpness > both[0].evidence.sharpness
    assert alone.evidence.exemplar is None
    assert alone.evidence.recent is None


def test_nothing_finite_gives_nothing_and_is_survived() -> None:
    tracker, session = _started()
    session.spoil = math.nan
    assert tracker.update(frame(picture(START), 1)) == ()
    session.spoil = None
    assert tracker.update(frame(picture(START), 2))[0].score > 0.9


def test_what_cannot_be_started_is_refused() -> None:
    with pytest.raises(RuntimeError, match="init"):
        NanoTracker(ColourSession()).update(frame(picture(START)))
    for box, reason in (
        (Box(math.nan, 10, 20, 20), "finite"),
        (Box(100, 100, 2, 20), "at least 4"),
        (Box(5, 100, 20, 20), "outside"),
    ):
        with pytest.raises(ValueError, match=reason):
            NanoTracker(ColourSession()).init(frame(picture(START)), box)


@pytest.mark.parametrize("name", ["penalty_k", "window", "size_lr", "floor_px", "max_candidates"])
def test_settings_have_ranges(name: str) -> None:
    with pytest.raises(ValueError, match=name):
        NanoSettings(**{name: -1})  # type: ignore[arg-type]


anything = st.floats(width=32) | st.sampled_from([math.nan, math.inf, -1e30, 1e30, 0.0])


@settings(max_examples=60)
@given(
    seed=st.integers(0, 9), a=anything, b=anything, x=st.floats(), y=st.floats(), scale=st.floats(), size=st.floats()
)
def test_no_numbers_make_a_bad_box(
    seed: int, a: float, b: float, x: float, y: float, scale: float, size: float
) -> None:
    rng = np.random.default_rng(seed)
    tracker, session = _started()
    session.sides = (rng.normal(size=(4, CELLS, CELLS)) * 60).astype(np.float32)
    session.sides[rng.random((4, CELLS, CELLS)) < 0.3] = a
    session.head = _spoiled(session.head, rng, b)  # type: ignore[method-assign]
    for k in range(1, 4):
        hint = SearchHint((x, y), COV, scale, 2, (size, size), (SearchTile((y, x), scale),))
        for candidate in tracker.update(frame(picture(START), k), hint if k % 2 else None):
            assert candidate.box.is_valid
            assert 0 <= candidate.box.cx_px <= WIDTH_PX
            assert 0 <= candidate.box.cy_px <= HEIGHT_PX
            assert candidate.box.w_px <= WIDTH_PX
            assert 0 <= candidate.score <= 1
            evidence = candidate.evidence
            assert evidence is not None
            numbers = (*evidence.heads, evidence.second, evidence.sharpness, evidence.ln_scale, evidence.ln_aspect)
            assert all(math.isfinite(v) for v in (*numbers, candidate.peak))


def _spoiled(head, rng: np.random.Generator, value: float):
    def spoiled(exemplar: np.ndarray, search: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        classes, sides = head(exemplar, search)
        classes[rng.random(classes.shape) < 0.3] = value
        return classes, sides

    return spoiled
