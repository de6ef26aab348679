"""The box convention: continuous coordinates, round trips, overlap."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tracker.box import Box

BAD = (math.nan, math.inf, -math.inf)
places = st.floats(-1e4, 1e4)
sizes = st.floats(0.5, 1e4)
boxes = st.builds(Box, places, places, sizes, sizes)


def approx(box: Box) -> object:
    return pytest.approx((box.cx_px, box.cy_px, box.w_px, box.h_px), rel=1e-9, abs=1e-9)


def test_a_row_is_corner_and_size_of_continuous_coordinates():
    box = Box.from_xywh(10, 20, 4, 6)
    assert (box.cx_px, box.cy_px, box.w_px, box.h_px) == (12, 23, 4, 6)
    assert box.to_corners() == (10, 20, 14, 26)


def test_the_whole_image_has_its_centre_at_half_its_size():
    assert Box.from_corners(0, 0, 640, 360) == Box(320, 180, 640, 360)


@given(boxes)
@settings(derandomize=True)
def test_round_trips(box):
    for back in (Box.from_xywh(*box.to_xywh()), Box.from_corners(*box.to_corners())):
        assert (back.cx_px, back.cy_px, back.w_px, back.h_px) == approx(box)


@given(boxes, boxes)
@settings(derandomize=True)
def test_iou_is_symmetric_and_a_share(a, b):
    assert a.iou(b) == pytest.approx(b.iou(a), abs=1e-12)
    assert 0.0 <= a.iou(b) <= 1.0 + 1e-12


@given(boxes, places, places)
@settings(derandomize=True)
def test_iou_does_not_change_with_the_origin(a, dx, dy):
    b = Box(a.cx_px + a.w_px / 4, a.cy_px, a.w_px, a.h_px)
    moved = (Box(c.cx_px + dx, c.cy_px + dy, c.w_px, c.h_px) for c in (a, b))
    assert next(moved).iou(next(moved)) == pytest.approx(a.iou(b), abs=1e-6)


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (Box(5, 5, 10, 10), 1.0),
        (Box(10, 5, 10, 10), 1 / 3),  # half of each
        (Box(5, 5, 5, 5), 1 / 4),  # inside
        (Box(15, 5, 10, 10), 0.0),  # touching edges share no area
        (Box(50, 50, 10, 10), 0.0),
    ],
)
def test_iou_by_hand(other, expected):
    assert Box(5, 5, 10, 10).iou(other) == pytest.approx(expected)


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("field", range(4))
def test_what_is_not_finite_is_not_valid_and_overlaps_nothing(bad, field):
    values = [5.0, 5.0, 10.0, 10.0]
    values[field] = bad
    assert not Box(*values).is_valid
    assert Box(*values).iou(Box(5, 5, 10, 10)) == 0.0
    assert Box(5, 5, 10, 10).iou(Box(*values)) == 0.0


@pytest.mark.parametrize(("w", "h"), [(0, 5), (5, 0), (-1, 5), (5, -1)])
def test_a_box_without_area_is_not_valid(w, h):
    assert not Box(0, 0, w, h).is_valid
