"""The picture of numbered boxes (uavfollow.video.proposals)."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from tests.tracker.selection.scenes import ground
from tracker.box import Box
from tracker.selection import Proposal, Reason
from uavfollow.video.proposals import COLOURS_BGR, draw_proposals, label_places

ALIKE = [Proposal(Box(60 + k, 50 + k, 40 - 4 * k, 30 - 3 * k), 0.5, Reason.OUTLINE) for k in range(6)]


@pytest.mark.parametrize(
    ("size", "drawn"), [((320, 240), (960, 720)), ((120, 160), (720, 960)), ((1280, 720), (1280, 720))]
)
def test_small_pictures_are_enlarged_and_large_ones_are_not(size: tuple[int, int], drawn: tuple[int, int]) -> None:
    image = ground(size=size)
    before = image.copy()
    canvas = draw_proposals(image, ALIKE)
    assert canvas.shape == (drawn[1], drawn[0], 3)
    assert (image == before).all()


def test_boxes_are_drawn_at_their_enlarged_place_with_thin_lines() -> None:
    canvas = draw_proposals(np.zeros((240, 320, 3), np.uint8), [Proposal(Box(160, 120, 80, 60), 0.5, Reason.OUTLINE)])
    along_left_side = canvas[300:420, 360]  # 3 x 120, away from the number above
    assert (np.abs(along_left_side.astype(int) - COLOURS_BGR[0]) < 40).all()
    assert not canvas[300:420, 366:590].any()
    assert not canvas[300:420, :354].any()


def test_boxes_of_a_large_picture_are_drawn_where_they_are() -> None:
    canvas = draw_proposals(np.zeros((720, 1280, 3), np.uint8), [Proposal(Box(640, 360, 80, 60), 0.5, Reason.OUTLINE)])
    assert (np.abs(canvas[345:375, 600].astype(int) - COLOURS_BGR[0]) < 40).all()


@pytest.mark.parametrize("shape", [(720, 960), (120, 90)])
def test_no_number_lies_on_another_and_all_lie_inside(shape: tuple[int, int]) -> None:
    boxes = [(10 + k, 8 + k, 80 - k, 60 - k) for k in range(9)]
    places = label_places(boxes, [(18, 22)] * 9, shape)
    for x1, y1, x2, y2 in places:
        assert 0 <= x1 < x2 <= shape[1]
        assert 0 <= y1 < y2 <= shape[0]
    for a, b in combinations(places, 2):
        assert a[2] < b[0] or b[2] < a[0] or a[3] < b[1] or b[3] < a[1]


def test_a_number_alone_stands_above_its_box() -> None:
    assert label_places([(100, 100, 200, 180)], [(18, 22)], (720, 960)) == [(100, 78, 118, 100)]
