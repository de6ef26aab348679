from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.tracker.selection.scenes import ground, plain, put_car, with_car
from tracker.box import Box
from tracker.selection import Reason, propose
from tracker.selection.click import FEATURES, gather, iou
from tracker.selection.contrast import CUES, ContrastCues
from tracker.selection.objectness import WEIGHTS, objectness
from tracker.selection.patch import cut_patch
from tracker.selection.segment import segment


@pytest.mark.parametrize(("w", "h"), [(20, 12), (24, 60), (90, 50)])
@pytest.mark.parametrize(("dx", "dy"), [(0.0, 0.0), (0.1, -0.1)])
def test_one_click_on_a_car_gives_its_box(w: float, h: float, dx: float, dy: float) -> None:
    car = Box(150.0, 118.0, w, h)
    found = propose(with_car(car), (car.cx_px + dx * w, car.cy_px + dy * h))
    assert max(p.box.iou(car) for p in found[:3]) > 0.7
    assert found[0].box.iou(car) > 0.5


def test_the_click_decides_which_of_two_cars() -> None:
    left, right = Box(80.0, 120.0, 44, 22), Box(240.0, 60.0, 44, 22)
    image = put_car(with_car(left), right)
    for car in (left, right):
        assert propose(image, (car.cx_px, car.cy_px))[0].box.iou(car) > 0.5


def test_proposals_are_ranked_distinct_and_inside() -> None:
    found = propose(with_car(Box(150.0, 118.0, 44, 22)), (150.0, 118.0))
    scores = [p.score for p in found]
    assert 3 <= len(found) <= 6
    assert scores == sorted(scores, reverse=True)
    assert all(0 <= s <= 1 for s in scores)
    assert {p.reason for p in found} <= {Reason.SEGMENT, Reason.OUTLINE}
    for k, p in enumerate(found):
        x1, y1, x2, y2 = p.box.to_corners()
        assert min(x1, y1) >= -1e-9
        assert x2 <= 320 + 1e-9
        assert y2 <= 240 + 1e-9
        assert all(p.box.iou(other.box) < 0.6 for other in found[:k])


def test_a_clear_thing_scores_higher_than_bare_ground() -> None:
    car = propose(with_car(Box(150.0, 118.0, 44, 22)), (150.0, 118.0))[0].score
    assert car > propose(ground(), (150.0, 118.0))[0].score
    assert car > propose(plain(), (150.0, 118.0))[0].score


@pytest.mark.parametrize("point", [(math.nan, 5.0), (math.inf, 5.0), (-1.0, 5.0), (320.0, 5.0), (5.0, 240.0)])
def test_a_click_that_is_no_place_in_the_picture_gives_nothing(point: tuple[float, float]) -> None:
    assert propose(ground(), point) == ()


@settings(max_examples=8, deadline=None, derandomize=True)
@given(st.integers(1, 64), st.integers(1, 64), st.floats(0, 0.999), st.floats(0, 0.999))
def test_no_picture_and_no_click_raises(width: int, height: int, u: float, v: float) -> None:
    image = np.random.default_rng(width * 100 + height).integers(0, 256, (height, width, 3)).astype(np.uint8)
    for p in propose(image, (u * width, v * height)):
        assert p.box.is_valid
        assert math.isfinite(p.score)


def test_mirrored_pictures_give_mirrored_boxes() -> None:
    car = Box(130.0, 118.0, 44, 22)
    image = with_car(car)
    found = propose(image, (132.0, 118.0))[0].box
    other = propose(np.ascontiguousarray(image[:, ::-1]), (320 - 132.0, 118.0))[0].box
    mirrored = Box(320 - other.cx_px, other.cy_px, other.w_px, other.h_px)
    assert found.iou(mirrored) > 0.8


def test_cues_are_best_for_the_true_box() -> None:
    car = Box(160.0, 120.0, 44, 22)
    patch = cut_patch(with_car(car), (160.0, 120.0), 110.0, 64)
    assert patch is not None
    boxes = [car, Box(160.0, 120.0, 22, 11), Box(160.0, 120.0, 76, 50), Box(176.0, 120.0, 44, 22)]
    cues = ContrastCues(patch).of(patch.to_patch(np.array([b.to_corners() for b in boxes])))
    for name in ("edge_mean", "edge_least", "quiet", "whole"):
        column = cues[:, CUES.index(name)]
        assert column[0] == column.max()
    assert cues[0, CUES.index("colour")] > cues[1, CUES.index("colour")]
    assert np.isfinite(cues).all()


def test_every_feature_has_a_weight_and_better_boxes_score_higher() -> None:
    assert set(FEATURES) == set(WEIGHTS)
    car = Box(150.0, 118.0, 44, 22)
    pool = gather(with_car(car), (150.0, 118.0))
    scores = objectness(pool.features, FEATURES)
    overlap = iou(pool.boxes, np.array([car.to_corners()]))[:, 0]
    assert pool.features.shape == (len(pool.boxes), len(FEATURES))
    assert overlap[np.argsort(-scores)[:20]].mean() > overlap.mean() + 0.2
    with pytest.raises(KeyError):
        objectness(pool.features, ("unknown",) * len(FEATURES))


def test_overlap_of_corners_is_that_of_boxes() -> None:
    a, b = Box(10.0, 10.0, 8.0, 6.0), Box(12.0, 11.0, 8.0, 6.0)
    assert iou(np.array([a.to_corners()]), np.array([b.to_corners()]))[0, 0] == pytest.approx(a.iou(b))


def test_the_thing_under_the_click_is_segmented() -> None:
    car = Box(160.0, 120.0, 44, 22)
    patch = cut_patch(with_car(car), (160.0, 120.0), 110.0, 64)
    assert patch is not None
    scale = patch.scale
    found = segment(patch, (55.0 * scale, 55.0 * scale), 31.0 * scale)
    assert found is not None
    assert Box.from_corners(*patch.to_frame(found[None])[0]).iou(car) > 0.75


def test_boxes_of_a_click_near_the_corner_are_held_inside_and_not_mostly_outside() -> None:
    boxes = gather(with_car(Box(150.0, 118.0, 44, 22)), (6.0, 5.0)).boxes
    assert len(boxes) > 20
    assert boxes.min() >= 0
    # One of which less than 0.7 lay inside would have its middle at 6,5 or nearer to it, and be much larger.
    middles = (boxes[:, :2] + boxes[:, 2:]) / 2
    assert (middles[:, 0] < 30).all()
    assert (middles[:, 1] < 30).all()
