"""The two maps as boxes and scores, and the published crop."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from tracker.nanotrack.crop import crop_pixels
from tracker.nanotrack.decode import apart, decode, rank
from tracker.siamapnpp.crop import CropGeometry

FILL = (10.0, 20.4, 30.6)


def _maps() -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((2, 15, 15), np.float32), np.full((4, 15, 15), 20, np.float32)


def test_a_cell_is_a_place_and_its_sides_are_left_top_right_bottom() -> None:
    classes, sides = _maps()
    classes[1, 2, 10] = 2.0
    sides[:, 2, 10] = [10, 20, 50, 40]
    decoded = decode(classes, sides)
    cell = 2 * 15 + 10
    assert (decoded.cx[cell], decoded.cy[cell]) == (3 * 16 + 20, -5 * 16 + 10)  # column 10 is right, row 2 above
    assert (decoded.w[cell], decoded.h[cell]) == (60, 60)
    assert decoded.confidence[cell] == pytest.approx(1 / (1 + math.exp(-2.0)))
    assert decoded.confidence[0] == pytest.approx(0.5)
    assert decoded.heads.shape == (1, 225)


def test_huge_logits_do_not_overflow_and_bad_cells_do_not_count() -> None:
    classes, sides = _maps()
    classes[1, 0, 0], classes[0, 0, 1] = 1e30, 1e30
    sides[2, 0, 2], classes[1, 0, 3] = np.nan, np.inf
    sides[0, 0, 4] = -90.0  # inside out
    decoded = decode(classes, sides)
    assert decoded.confidence[:2].tolist() == [1.0, 0.0]
    assert not decoded.usable[2]
    assert decoded.w[4] == 1.0
    ranked = rank(decoded, np.ones(225), 0.4)
    assert ranked[2] == -math.inf
    assert np.isfinite(ranked[[0, 1, 4]]).all()


def test_the_window_prefers_the_middle() -> None:
    decoded = decode(*_maps())
    assert int(rank(decoded, np.ones(225), 0.4).argmax()) == 112


def test_peaks_are_at_least_a_cell_apart() -> None:
    assert min(apart(4.0, 4.0)) >= 16.0
    assert apart(100.0, 40.0)[0] > apart(100.0, 40.0)[1]


@pytest.mark.parametrize("centre", [(100.3, 80.7), (3.2, 70.0), (158.0, 2.0), (250.0, 60.0), (-90.0, -40.0)])
def test_the_crop_is_that_of_a_padded_frame(centre: tuple[float, float]) -> None:
    image = np.random.default_rng(1).integers(0, 256, (120, 160, 3), np.uint8)
    side, pad = 45.4, 200
    padded = cv2.copyMakeBorder(image, pad, pad, pad, pad, cv2.BORDER_CONSTANT, value=FILL)
    left, top = (round(c - side / 2) + pad for c in centre)
    expected = cv2.resize(padded[top : top + 45, left : left + 45], (127, 127))
    assert np.array_equal(crop_pixels(image, CropGeometry(*centre, side, 127), FILL), expected)
