"""Colours of a box, the memory of them, and what the tracker tells of them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.tracker.siamapnpp.maps import SETTINGS, maps_with
from tests.tracker.siamapnpp.test_tracker_state import ScriptedEngine
from tracker.box import Box
from tracker.messages import Frame, MemorySlot
from tracker.siamapnpp.colour import balance, describe, similarity
from tracker.siamapnpp.memory import MAX_ANCHORS, ExemplarMemory
from tracker.siamapnpp.tracker import SiamAPNTracker

RED, MAROON, BLUE, WHITE, BLACK, ORANGE = (  # BGR
    (30, 28, 176), (60, 30, 70), (120, 62, 38), (222, 225, 225), (32, 30, 30), (30, 120, 208),
)  # fmt: skip
BOX = Box(160.0, 120.0, 60.0, 36.0)
KEPT, OTHER = 0.76, 0.7  # similarity that a target keeps, and that another paint does not reach


def _picture(paint: tuple[int, int, int], box: Box = BOX, seed: int = 0, gain: float = 1.0) -> np.ndarray:
    """A car with windows and wheels in grass, with noise."""
    rng = np.random.default_rng(seed)
    image = np.full((240, 320, 3), (60, 100, 85), np.float64)

    def part(x: tuple[float, float], y: tuple[float, float], colour: tuple[int, int, int]) -> None:
        columns, rows = (
            slice(*(round(c + side * v) for v in span))
            for c, side, span in ((box.cx_px, box.w_px, x), (box.cy_px, box.h_px, y))
        )
        image[rows, columns] = colour

    part((-0.5, 0.5), (-0.5, 0.5), paint)
    part((-0.1, 0.2), (-0.3, 0.1), (60, 50, 45))
    part((-0.4, -0.2), (0.2, 0.5), (25, 25, 25))
    image = image * gain + rng.normal(0, 5, image.shape)
    return np.clip(image, 0, 255).astype(np.uint8)


def _described(image: np.ndarray, box: Box = BOX) -> np.ndarray:
    found = describe(image, box, balance(image))
    assert found is not None
    return found


def test_the_same_colours_are_1_and_no_shared_ones_0() -> None:
    one = _described(_picture(RED))
    assert one @ one == pytest.approx(1.0)
    assert similarity(one, one) == pytest.approx(1.0, abs=1e-6)
    assert similarity(np.eye(3)[0], np.eye(3)[1]) == 0.0
    assert similarity(np.eye(3)[0], np.array((0.36, 0.64, 0.0)) ** 0.5) == pytest.approx(1 - 0.4**0.5)


@pytest.mark.parametrize("paint", [RED, BLUE, WHITE, BLACK, ORANGE])
def test_a_target_keeps_its_colours_and_another_paint_does_not_have_them(paint: tuple[int, int, int]) -> None:
    """At another size and place, with a box that is a little off, mirrored, and in another light."""
    first = _described(_picture(paint))
    small = Box(60.0, 90.0, 20.0, 12.0)
    off = replace(BOX, cx_px=BOX.cx_px + 4, cy_px=BOX.cy_px - 2, w_px=68.0)
    assert similarity(first, _described(_picture(paint, small, seed=1), small)) > KEPT
    assert similarity(first, _described(_picture(paint, seed=2), off)) > KEPT
    assert similarity(first, _described(_picture(paint, seed=3)[:, ::-1], replace(BOX, cx_px=159.0))) > KEPT
    assert similarity(first, _described(_picture(paint, seed=4, gain=0.8))) > KEPT
    for other in {RED, MAROON, BLUE, WHITE, BLACK, ORANGE} - {paint}:
        assert similarity(first, _described(_picture(other, seed=5))) < OTHER


def test_half_of_exposure_and_tint_is_taken_out() -> None:
    image = np.full((64, 64, 3), (40, 80, 160), np.uint8)
    mean = np.array((40, 80, 160)) / 255
    assert balance(image) == pytest.approx((0.45 / mean) ** 0.5)
    assert np.isfinite(balance(np.zeros((64, 64, 3), np.uint8))).all()
    warm = np.clip(_picture(WHITE).astype(np.float64) * (0.85, 0.95, 1.1), 0, 255).astype(np.uint8)
    first, plain = _described(_picture(WHITE)), np.ones(3, np.float32)
    raw = [describe(i, BOX, plain) for i in (_picture(WHITE), warm)]
    assert raw[0] is not None
    assert raw[1] is not None
    assert similarity(first, _described(warm)) > similarity(raw[0], raw[1]) + 0.03


def test_only_the_middle_counts() -> None:
    image, framed = _picture(RED), _picture(RED)
    x1, y1, x2, y2 = (round(v) for v in BOX.to_corners())
    for width, alike in ((4, True), (14, False)):  # an ellipse of 42 x 25 px
        cv2.rectangle(framed, (x1, y1), (x2, y2), (250, 20, 20), 2 * width - 1)
        same = np.array_equal(describe(image, BOX, balance(image)), describe(framed, BOX, balance(image)))
        assert same is alike


def test_a_large_box_is_averaged_and_not_picked_at() -> None:
    """A fine pattern of two colours is their mean, wherever the points of the sample lie."""
    stripes = np.zeros((480, 480, 3), np.uint8)
    stripes[:, ::2], stripes[:, 1::2] = (40, 40, 200), (200, 40, 40)
    plain, factors = np.full_like(stripes, (120, 40, 120)), np.ones(3, np.float32)
    box = Box(240.0, 240.0, 430.0, 430.0)
    found = [describe(image, box, factors) for image in (stripes, plain)]
    assert found[0] is not None
    assert found[1] is not None
    assert similarity(found[0], found[1]) > 0.9


def test_what_is_outside_of_the_picture_does_not_count() -> None:
    image = _picture(RED)
    image[:, :30] = RED
    inside = _described(image, Box(14.0, 100.0, 26.0, 40.0))
    assert similarity(inside, _described(image, Box(2.0, 100.0, 52.0, 40.0))) > 0.98
    assert describe(image, Box(-10.0, 100.0, 52.0, 40.0), balance(image)) is None
    image[:, 0] = (255, 255, 255)  # all that a border drawn on outwards would be of
    assert similarity(inside, _described(image, Box(2.6, 100.0, 30.0, 40.0))) > 0.95


@given(*(st.floats(),) * 4)
def test_any_box_gives_a_unit_vector_or_none(cx: float, cy: float, w: float, h: float) -> None:
    image = np.random.default_rng(0).integers(0, 256, (24, 32, 3), np.uint8)
    found = describe(image, Box(cx, cy, w, h), balance(image))
    assert found is None or found @ found == pytest.approx(1.0)


@given(st.floats(0, 32), st.floats(0, 24), st.floats(1e-3, 64), st.floats(1e-3, 48))
def test_any_box_in_the_picture_gives_a_unit_vector_or_none(cx: float, cy: float, w: float, h: float) -> None:
    image = np.random.default_rng(0).integers(0, 256, (24, 32, 3), np.uint8)
    found = describe(image, Box(cx, cy, w, h), balance(image))
    assert found is None or found @ found == pytest.approx(1.0)
    if max(abs(cx - 16) / 32, abs(cy - 12) / 24) < 0.1:
        assert found is not None


# --- memory


def _axis(k: int) -> np.ndarray:
    return np.eye(8)[k]


def test_the_most_alike_of_the_colours_kept_decides() -> None:
    memory = ExemplarMemory()
    assert memory.colour_likeness(_axis(0)) is None
    memory.start(None, _axis(0))
    assert not memory.has_first, "a look is another thing"
    assert (memory.colour_likeness(_axis(0)), memory.colour_likeness(None)) == (1.0, None)
    memory.keep(None, MemorySlot.RECENT, _axis(1))
    memory.keep(None, MemorySlot.RECENT, _axis(2))
    for k in range(3, 3 + MAX_ANCHORS + 1):
        memory.keep(None, MemorySlot.ANCHOR, _axis(k))
    kept = [memory.colour_likeness(_axis(k)) for k in range(7)]
    assert kept == [1.0, 0.0, 1.0, 0.0, 1.0, 1.0, 1.0], "first and recent stay, the oldest of each other slot goes"
    memory.keep(_axis(1), MemorySlot.RECENT)
    assert memory.colour_likeness(_axis(2)) == 1.0, "no colour came, so none is replaced"
    memory.start(_axis(0), _axis(1))
    assert [memory.colour_likeness(_axis(k)) for k in (0, 1, 2)] == [0.0, 1.0, 0.0]


# --- tracker


def _tracker(hits: dict[tuple[int, int], float]) -> SiamAPNTracker:
    tracker = SiamAPNTracker(ScriptedEngine(maps_with(hits)), SETTINGS)
    tracker.init(Frame(_picture(RED), 0, 0.0, 0.0), BOX)
    return tracker


def _colours(tracker: SiamAPNTracker, image: np.ndarray) -> list[float]:
    found = tracker.update(Frame(image, 1, 0.04, 0.04))
    colours = [None if c.evidence is None else c.evidence.colour for c in found]
    assert None not in colours
    return [c for c in colours if c is not None]


def test_every_candidate_tells_its_colour() -> None:
    colours = _colours(_tracker({(10, 10): 6.0, (10, 19): 5.0}), _picture(RED, seed=1))
    assert len(colours) > 1
    assert colours[0] > 0.85
    assert max(colours[1:]) < 0.5, "there is grass"


def test_another_paint_is_unlike_until_it_is_remembered() -> None:
    tracker = _tracker({(10, 10): 6.0})
    blue = _picture(BLUE, seed=1)
    assert _colours(tracker, blue)[0] < 0.5
    tracker.remember(Frame(blue, 2, 0.08, 0.08), BOX, MemorySlot.RECENT)
    assert _colours(tracker, _picture(BLUE, seed=2))[0] > 0.8
    assert _colours(tracker, _picture(RED, seed=3))[0] > 0.8
    tracker.init(Frame(_picture(WHITE), 3, 0.12, 0.12), BOX)
    assert max(_colours(tracker, _picture(p, seed=4))[0] for p in (RED, BLUE)) < 0.5
