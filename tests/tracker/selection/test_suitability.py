from __future__ import annotations

import math

import numpy as np
import pytest

from tests.tracker.selection.scenes import plain, with_car
from tracker.box import Box
from tracker.selection import Unsuitable, unsuitable

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
