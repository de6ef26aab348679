"""Crops lie where the labels say; effects spoil the picture and never the label."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.training.augment_scene import (
    FILL,
    NOTHING,
    ellipse,
    extent,
    only,
    placed,
    plan_of,
    textured,
    with_search,
)
from tracker.box import Box
from tracker.siamapnpp.crop import EXEMPLAR_PX, CropGeometry, crop_square, exemplar_side_px
from tracker.training.augment import ranges
from tracker.training.augment.geometry import deformation
from tracker.training.augment.kernels import motion_kernels
from tracker.training.augment.plan import Placement
from tracker.training.augment.render import render_pair
from tracker.training.recipe import Augmentation, Jitter
from tracker.training.types import View

S = 223
BOX = Box(250.0, 180.0, 60.0, 44.0)
SEARCH_EFFECTS = ["motion_blur", "blur", "low_resolution", "noise", "fog", "jpeg", "occlusion", "lookalike"]
BOXES = [
    BOX,
    Box(250.3, 180.7, 33.1, 61.7),
    Box(20.0, 360.0, 90.0, 50.0),  # over the border
    Box(260.0, 190.0, 320.0, 260.0),  # shrinks by more than 2
    Box(100.25, 90.5, 5.0, 6.0),
    Box(-300.0, 90.0, 40.0, 40.0),  # nothing of it is in the picture
]


def _undisturbed(view: View, out_px: int) -> np.ndarray:
    side = exemplar_side_px(view.box.w_px, view.box.h_px) * out_px / EXEMPLAR_PX
    return crop_square(view.image_bgr_u8, CropGeometry(view.box.cx_px, view.box.cy_px, side, out_px), view.fill_bgr)


def _search(view: View, plan: object, size: int = S) -> tuple[np.ndarray, np.ndarray]:
    _, search, box = render_pair(view, view, plan, 0, size, 1)  # type: ignore[arg-type]
    return search, np.array(box)


@pytest.mark.parametrize("box", BOXES)
@pytest.mark.parametrize("search_px", [223, 287])
def test_without_jitter_the_crops_are_the_trackers(box: Box, search_px: int) -> None:
    view = textured(box)
    exemplar, search, label = render_pair(view, view, plan_of(NOTHING), 0, search_px, 1)
    assert np.abs(exemplar.astype(int) - _undisturbed(view, EXEMPLAR_PX)).mean() < 0.05
    assert np.abs(search.astype(int) - _undisturbed(view, search_px)).mean() < 0.05
    scale = EXEMPLAR_PX / exemplar_side_px(box.w_px, box.h_px)
    half = box.w_px * scale / 2, box.h_px * scale / 2
    assert label == pytest.approx((-half[0], -half[1], *half))


@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize(
    ("box", "placement"),
    [
        (Box(300.0, 280.0, 90.0, 60.0), placed()),
        (Box(300.3, 280.6, 90.0, 60.0), placed(shift=(21.3, -14.8))),
        (Box(300.0, 280.0, 90.0, 60.0), placed(scale=0.4)),
        (Box(300.0, 280.0, 90.0, 60.0), placed(scale=-0.4, aspect=0.3)),
        (Box(300.0, 280.0, 50.0, 110.0), placed(angle=math.radians(30))),
        (Box(320.0, 290.0, 110.0, 40.0), placed(shift=(-20.0, 9.5), scale=0.2, aspect=-0.15, angle=math.radians(-40))),
        (Box(350.0, 300.0, 330.0, 260.0), placed(shift=(7.25, 3.5), scale=-0.3, angle=math.radians(10))),  # shrunk
    ],
)
def test_the_label_is_the_hull_of_the_ellipse_in_the_box(box: Box, placement: object, flip: bool) -> None:
    plan = with_search(plan_of(NOTHING), placement, flip)  # type: ignore[arg-type]
    crop, label = _search(ellipse(box), plan)
    assert extent(crop) == pytest.approx(label, abs=0.6)
    assert (label[:2] + label[2:]) / 2 == pytest.approx(plan.search.shift_px[0])


def test_scale_and_aspect_are_the_plans() -> None:
    _, label = _search(textured(BOX), with_search(plan_of(NOTHING), placed(scale=0.3, aspect=0.1)))
    _, still = _search(textured(BOX), plan_of(NOTHING))
    ratio = (label[2:] - label[:2]) / (still[2:] - still[:2])
    assert ratio == pytest.approx([math.exp(0.4), math.exp(0.2)])


def test_a_turn_keeps_lengths_and_right_angles() -> None:
    angles = np.radians([30.0, -77.0, 5.0])
    zero = np.zeros(3)
    turn = deformation(Placement(np.zeros((3, 2)), zero, zero, angles), np.array([False, True, False]))
    assert turn @ turn.transpose(0, 2, 1) == pytest.approx(np.tile(np.eye(2), (3, 1, 1)))
    assert np.linalg.det(turn) == pytest.approx([1.0, -1.0, 1.0])
    assert turn[:, 1, 1] == pytest.approx(np.cos(angles))


def test_a_turn_goes_from_x_to_y() -> None:
    box = Box(300.0, 280.0, 120.0, 30.0)
    crop, _ = _search(ellipse(box), with_search(plan_of(NOTHING), placed(angle=math.radians(30))))
    y, x = np.nonzero(crop[..., 0] > 127)
    assert np.cov(x, y)[0, 1] > 0  # down on the right


def test_a_flip_mirrors_the_crop_and_the_label() -> None:
    view = textured(Box(203.0, 171.5, 75.0, 40.0))
    crop, label = _search(view, with_search(plan_of(NOTHING), placed((17, -9), 0.2, 0.1, 0.3)))
    mirrored, other = _search(view, with_search(plan_of(NOTHING), placed((-17, -9), 0.2, 0.1, -0.3), flip=True))
    assert np.abs(crop[:, ::-1].astype(int) - mirrored).mean() < 0.1
    assert other == pytest.approx([-label[2], label[1], -label[0], label[3]])


def test_a_flip_is_for_both_crops() -> None:
    view = textured(BOX)
    plain, flipped = (render_pair(view, view, plan_of(a), 0, S, 1) for a in (NOTHING, only("flip")))
    for i in (0, 1):
        assert np.abs(plain[i][:, ::-1].astype(int) - flipped[i]).mean() < 0.1


def test_outside_is_the_fill_colour() -> None:
    crop, _ = _search(textured(Box(-300.0, 90.0, 40.0, 40.0)), plan_of(NOTHING))
    assert (crop == np.array(FILL, np.uint8)).all()


def test_a_strong_reduction_averages_instead_of_skipping_pixels() -> None:
    board = 255 * (np.indices((800, 800)).sum(axis=0) % 2).astype(np.uint8)
    view = View(np.repeat(board[:, :, None], 3, axis=2), Box(400.0, 400.0, 260.0, 260.0), FILL)
    crop, _ = _search(view, with_search(plan_of(NOTHING), placed(angle=0.2)))
    middle = crop[70:150, 70:150].astype(float)
    assert middle.mean() == pytest.approx(127.5, abs=2)
    assert middle.std() < 3


@pytest.mark.parametrize("effect", SEARCH_EFFECTS)
def test_search_effects_change_the_search_crop_and_nothing_else(effect: str) -> None:
    view = textured(BOX)
    plain = render_pair(view, view, plan_of(NOTHING), 0, S, 1)
    spoiled = render_pair(view, view, plan_of(only(effect)), 0, S, 1)
    assert np.array_equal(plain[0], spoiled[0])
    assert np.abs(plain[1].astype(int) - spoiled[1]).mean() > 0.3
    assert plain[2] == spoiled[2]


@pytest.mark.parametrize("effect", ["colour", "gamma", "gray"])
def test_colours_change_both_crops_and_not_the_label(effect: str) -> None:
    view = textured(BOX)
    plain = render_pair(view, view, plan_of(NOTHING), 0, S, 1)
    spoiled = render_pair(view, view, plan_of(only(effect), seed=5), 0, S, 1)
    assert all(np.abs(plain[i].astype(int) - spoiled[i]).mean() > 2 for i in (0, 1))
    assert plain[2] == spoiled[2]
    if effect == "gray":
        assert all((np.ptp(spoiled[i].astype(int), axis=2) == 0).all() for i in (0, 1))


def test_a_low_resolution_exemplar_is_smooth_and_leaves_the_search_crop() -> None:
    view = textured(Box(250.0, 180.0, 110.0, 90.0))
    plain = render_pair(view, view, plan_of(NOTHING), 0, S, 1)
    spoiled = render_pair(view, view, plan_of(only("exemplar_low_resolution")), 0, S, 1)
    assert np.array_equal(plain[1], spoiled[1])
    rough, smooth = (np.abs(np.diff(x.astype(int), 2, axis=1)).mean() for x in (plain[0], spoiled[0]))
    assert smooth < 0.8 * rough


def test_motion_blur_smears_along_its_direction_only() -> None:
    image = np.zeros((375, 500, 3), np.uint8)
    image[180, 250] = 255
    plan = plan_of(only("motion_blur"))
    one = {"motion_px": np.array([10.0]), "motion_angle_rad": np.array([0.0])}
    plan = replace(plan, degradation=replace(plan.degradation, **one))
    side = EXEMPLAR_PX / 2  # a box of this side is rendered at scale 1
    crop, _ = _search(View(image, Box(250.5, 180.5, side, side), (0.0, 0.0, 0.0)), plan)
    y, x = np.nonzero(crop[..., 0])
    assert set(y) == {S // 2}
    assert x.min() + x.max() == 2 * (S // 2)
    assert np.ptp(x) == 10
    assert crop[..., 0].astype(int).sum() == pytest.approx(255, rel=0.05)


@pytest.mark.parametrize("angle", [0.0, 0.5, math.pi / 2, 2.5])
def test_a_streak_is_thin_and_points_where_the_plan_says(angle: float) -> None:
    kernel = motion_kernels(np.array([12.0]), np.array([angle]))[0].astype(float)
    assert kernel.sum() == pytest.approx(1.0)
    y, x = np.indices(kernel.shape) - kernel.shape[0] // 2
    spread = np.array([[np.sum(kernel * a * b) for a in (x, y)] for b in (x, y)])
    small, large = np.linalg.eigh(spread)[0]
    assert math.sqrt(large) == pytest.approx(12 / math.sqrt(12), rel=0.08)  # a uniform line of 12 px
    assert math.sqrt(small) < 0.6
    direction = np.linalg.eigh(spread)[1][:, 1]
    assert abs(direction @ [math.cos(angle), math.sin(angle)]) == pytest.approx(1.0, abs=0.01)


def test_fog_lightens_and_flattens_and_noise_has_its_strength() -> None:
    view = textured(BOX)
    plain, foggy = (_search(view, plan_of(a))[0].astype(float) for a in (NOTHING, only("fog")))
    assert foggy.mean() > plain.mean()
    assert foggy.std() < 0.85 * plain.std()
    plan = plan_of(only("noise"))
    noise = _search(view, plan)[0] - plain
    assert noise.std() == pytest.approx(plan.degradation.noise_sigma[0], rel=0.03)
    assert abs(noise.mean()) < 0.1


@pytest.mark.parametrize("row", range(12))
def test_an_occluder_covers_a_part_of_the_target_by_pixels_of_the_crop(row: int) -> None:
    view, plan = textured(BOX), plan_of(only("occlusion"), count=12)
    plain = _search(view, plan_of(NOTHING))[0]
    _, crop, label = render_pair(view, view, plan, row, S, 1)
    y, x = np.nonzero((crop != plain).any(axis=2))
    size = np.array(label[2:]) - np.array(label[:2])
    out = ranges.OCCLUSION_OUT * ranges.OCCLUSION[1] * size + 1
    assert x.min() >= S / 2 + label[0] - out[0]
    assert x.max() <= S / 2 + label[2] + out[0]
    assert y.min() >= S / 2 + label[1] - out[1]
    assert y.max() <= S / 2 + label[3] + out[1]
    assert 0.03 * size.prod() < len(x) < 0.37 * size.prod()
    patch = crop[y.min() : y.max() + 1, x.min() : x.max() + 1]
    windows = np.lib.stride_tricks.sliding_window_view(plain[..., 0], patch.shape[:2])
    start = np.argwhere(windows[:, :, 0, 0] == patch[0, 0, 0])
    assert any(np.array_equal(windows[a, b], patch[..., 0]) for a, b in start)


def test_a_lookalike_shows_the_target_elsewhere() -> None:
    white = ellipse(Box(300.0, 280.0, 50.0, 40.0))
    view = View(white.image_bgr_u8 // 2, white.box, white.fill_bgr)
    plan, bare = (plan_of(a, Jitter(shift_px=30, log_scale=0.3), count=20) for a in (only("lookalike"), NOTHING))
    seen = 0
    for row in range(20):
        _, crop, label = render_pair(view, view, plan, row, S, 1)
        _, plain, same = render_pair(view, view, bare, row, S, 1)
        x1, y1, x2, y2 = (round(v + S / 2) for v in label)
        size = (x2 - x1) * (y2 - y1)
        changed = (crop != plain).any(axis=2)
        assert label == same
        assert changed[y1:y2, x1:x2].sum() <= 0.12 * size  # the soft edge is a little larger than the copy's box
        copy = (crop.max(axis=2) > 60) & (plain.max(axis=2) == 0)
        seen += copy.sum() > 0.15 * size  # three quarters of it may lie outside
        assert copy.sum() < 1.8 * size
    assert seen >= 16  # a large target in the middle leaves no room


def test_no_lookalike_where_the_target_leaves_no_room() -> None:
    view = textured(BOX)
    big = placed(scale=1.5)
    plain, crop = (_search(view, with_search(plan_of(a), big))[0] for a in (NOTHING, only("lookalike")))
    assert np.array_equal(plain, crop)


def test_same_seed_same_bytes_another_seed_other_noise() -> None:
    view, plan = textured(BOX), plan_of(only("noise"), Jitter(), 4)
    one, two, three = (render_pair(view, view, plan, 2, S, seed)[1] for seed in (1, 1, 2))
    assert np.array_equal(one, two)
    assert not np.array_equal(one, three)
    alone = render_pair(view, view, plan.rows(np.array([2])), 0, S, 1)[1]
    assert np.array_equal(one, alone)


def test_the_picture_is_left_alone_and_any_row_of_the_default_is_finite() -> None:
    view = textured(Box(30.0, 340.0, 70.0, 130.0))
    before = view.image_bgr_u8.copy()
    plan = plan_of(Augmentation(lookalike=1, occlusion=1), Jitter(), 40)
    for row in range(40):
        exemplar, search, label = render_pair(view, view, plan, row, S, 1)
        assert exemplar.shape == (EXEMPLAR_PX, EXEMPLAR_PX, 3)
        assert search.shape == (S, S, 3)
        assert search.dtype == np.uint8
        assert np.isfinite(label).all()
        assert label[0] < label[2]
        assert label[1] < label[3]
    assert np.array_equal(before, view.image_bgr_u8)
