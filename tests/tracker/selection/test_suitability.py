from __future__ import annotations

import math

import numpy as np
import pytest

from tests.tracker.selection.scenes import ground, plain, put_car, with_car
from tracker.box import Box
from tracker.messages import ImageU8
from tracker.selection import Unsuitable, unsuitable, warning
from tracker.selection.repetition import repetition
from tracker.selection.suitability import LEAST_DIFFERENCE, MOST_REPETITION
from tracker.selection.surroundings import difference

CAR = Box(150.0, 118.0, 44, 22)


def test_a_car_is_suitable() -> None:
    assert unsuitable(with_car(CAR), CAR) is None


@pytest.mark.parametrize(
    ("box", "reason"),
    [
        (Box(math.nan, 100, 20, 20), Unsuitable.NOT_A_BOX),
        (Box(100, 100, -3, 20), Unsuitable.NOT_A_BOX),
        (Box(100, 100, math.inf, 20), Unsuitable.NOT_A_BOX),
        (Box(150, 118, 7.9, 40), Unsuitable.TOO_SMALL),
        (Box(150, 118, 40, 7.9), Unsuitable.TOO_SMALL),
        (Box(160, 120, 300, 160), Unsuitable.TOO_LARGE),
        (Box(10.5, 118, 20, 20), Unsuitable.AT_EDGE),
        (Box(100, 10.5, 20, 20), Unsuitable.AT_EDGE),
        (Box(309.5, 118, 20, 20), Unsuitable.AT_EDGE),
        (Box(100, 229.5, 20, 20), Unsuitable.AT_EDGE),
        (Box(1e9, 1e9, 20, 20), Unsuitable.AT_EDGE),
    ],
)
def test_refused_with_the_reason(box: Box, reason: Unsuitable) -> None:
    assert unsuitable(with_car(CAR), box) is reason


@pytest.mark.parametrize("box", [Box(150, 118, 8, 8), Box(11, 118, 20, 20), Box(160, 120, 240, 159)])
def test_limits_are_inclusive(box: Box) -> None:
    blocks = np.random.default_rng(1).integers(0, 256, (60, 80, 3)).astype(np.uint8).repeat(4, axis=0).repeat(4, axis=1)
    assert unsuitable(blocks, box) is None


def test_a_plain_sky_is_featureless_and_a_white_ball_on_it_is_not() -> None:
    sky = plain()
    assert unsuitable(sky, Box(150, 118, 40, 40)) is Unsuitable.FEATURELESS
    ball = sky.copy()
    ball[108:128, 140:160] = 235
    assert unsuitable(ball, Box(150, 118, 20, 20)) is None


def test_every_reason_says_what_to_do() -> None:
    for reason in Unsuitable:
        assert len(reason.message) > 40
        assert "\n" not in reason.message


def _noise(low: int, high: int, channels: int = 3) -> ImageU8:
    grain = np.random.default_rng(5).integers(low, high, (240, 320, channels)).astype(np.uint8)
    return np.repeat(grain, 3 // channels, axis=2)


def _squares(side_px: int) -> ImageU8:
    yy, xx = np.mgrid[0:240, 0:320]
    board = ((yy // side_px + xx // side_px) % 2) * 150 + 50
    return np.repeat(board[..., None], 3, axis=2).astype(np.uint8)


@pytest.mark.parametrize("box", [Box(150, 118, 18, 18), Box(150, 118, 60, 24), Box(140, 118, 30, 70)])
@pytest.mark.parametrize(
    "image", [_noise(0, 256), _noise(0, 256, 1), _squares(16), _squares(24)], ids=["colour", "grey", "16", "24"]
)
def test_what_looks_the_same_all_round_is_refused_unless_a_thing_is_put_there(image: ImageU8, box: Box) -> None:
    assert unsuitable(image, box) is Unsuitable.NOT_DISTINCT
    assert unsuitable(put_car(image, box), box) is None


def test_one_square_of_a_board_is_refused() -> None:
    assert unsuitable(_squares(32), Box(144, 112, 32, 32)) is Unsuitable.NOT_DISTINCT


def test_a_box_smaller_than_the_pattern_is_refused_and_one_like_its_two_neighbours_is_not() -> None:
    box = Box(150, 118, 18, 18)
    assert difference(_squares(16), box) > LEAST_DIFFERENCE
    assert unsuitable(_squares(16), box) is Unsuitable.NOT_DISTINCT
    image = ground()
    for dx in (-60, -30, 0, 30, 60):
        image[109:127, 141 + dx : 159 + dx] = _squares(9)[0:18, 0:18]
    assert repetition(image, box) < MOST_REPETITION
    assert unsuitable(image, box) is None


def test_repetition_is_a_share_and_nought_without_a_picture() -> None:
    assert repetition(_squares(16), Box(150, 118, 30, 30)) > 0.98
    assert repetition(_noise(0, 256), Box(150, 118, 30, 30)) < 0.6
    assert repetition(np.full((240, 320, 3), 90, np.uint8), Box(150, 118, 30, 30)) == 0.0
    assert repetition(_squares(16), Box(9000, 9000, 30, 30)) == 0.0
    assert repetition(_squares(16), Box(150, 118, 300, 8)) <= 1.0


def test_a_car_among_cars_is_no_texture() -> None:
    image, box = ground(), Box(160.0, 120.0, 40.0, 22.0)
    for dx in (-80, 0, 80):
        image = put_car(image, Box(160.0 + dx, 120.0, 40.0, 22.0))
    assert unsuitable(image, box) is None


def test_a_box_without_all_its_surroundings_in_the_picture_is_not_judged() -> None:
    image = _squares(16)
    assert difference(image, Box(160, 120, 200, 150)) == 1.0
    assert unsuitable(image, Box(160, 120, 200, 150)) is None
    assert difference(image, Box(25, 25, 40, 40)) == 1.0  # in a corner: three neighbours
    assert unsuitable(image, Box(25, 120, 40, 40)) is Unsuitable.NOT_DISTINCT  # at one side: five


def test_contrast_alone_makes_no_texture_distinct_and_no_thing_alike() -> None:
    image, box = _noise(0, 256), Box(150, 118, 44, 22)
    dim = (image // 2 + 60).astype(np.uint8)
    assert difference(dim, box) == pytest.approx(difference(image, box), abs=0.05)
    car = (put_car(ground(), box) // 2 + 60).astype(np.uint8)
    assert difference(car, box) > 0.5


def test_of_a_weak_target_it_is_warned_and_only_of_one() -> None:
    box = Box(150, 118, 44, 44)
    rng = np.random.default_rng(3)
    warned = {}
    for shift in (0, 4, 120):
        image = rng.integers(0, 128, (240, 320, 3)).astype(np.uint8)
        image[96:140, 128:172] += np.uint8(shift)
        warned[shift] = (unsuitable(image, box), warning(image, box) is not None)
    assert warned == {0: (Unsuitable.NOT_DISTINCT, False), 4: (None, True), 120: (None, False)}
    assert warning(image, Box(math.nan, 1, 2, 3)) is None
