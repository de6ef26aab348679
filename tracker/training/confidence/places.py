"""Pictures moved so that something else, or the target a little off, is where a tracker looks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tracker.box import Box
from tracker.messages import Array, ImageU8
from tracker.training.errors import TrainingError
from tracker.training.sources.pictures import mean_colour
from tracker.training.types import Footage

MAX_WINDOWS = 3.0  # further from the target the background is another one
TRIES = 16  # random places; a picture that the target nearly fills has no good one
EDGE_SHARE = 0.4  # of the window: nearer to its border the Hann window leaves nothing of a target

Point = tuple[float, float]


def displaced(image: ImageU8, at: Point, place: Point, size: tuple[int, int] | None = None) -> tuple[ImageU8, Point]:
    """A picture of `size` (width, height; default: the same) that shows at `at` what `image` shows at `place`.

    Moved by whole pixels, so nothing is resampled; what lies outside of the image is its mean colour. Also returns by
    how much it was moved, (px, px).
    """
    width, height = size or (image.shape[1], image.shape[0])
    ox, oy = round(at[0] - place[0]), round(at[1] - place[1])
    canvas = np.empty((height, width, 3), np.uint8)
    canvas[:] = np.array(mean_colour(image)).round().astype(np.uint8)
    x0, x1 = max(0, ox), min(width, ox + image.shape[1])
    y0, y1 = max(0, oy), min(height, oy + image.shape[0])
    if x0 < x1 and y0 < y1:
        canvas[y0:y1, x0:x1] = image[y0 - oy : y1 - oy, x0 - ox : x1 - ox]
    return canvas, (float(ox), float(oy))


def absent_place(
    rng: np.random.Generator, truth: Box | None, near: Point, window_px: float, size: tuple[int, int]
) -> Point | None:
    """A place in the picture of `size` whose window holds nothing of the target; None when none was found.

    Without a target in the picture any place within MAX_WINDOWS of `near` will do.
    """
    there = truth is not None and truth.is_valid
    centre = (truth.cx_px, truth.cy_px) if truth is not None and there else near
    half_px = (max(truth.w_px, truth.h_px) if truth is not None and there else 0.0) / 2 + window_px / 2
    for _ in range(TRIES):
        place = (float(rng.uniform(0, size[0])), float(rng.uniform(0, size[1])))
        apart_px = max(abs(place[0] - centre[0]), abs(place[1] - centre[1]))
        if apart_px <= MAX_WINDOWS * window_px and (not there or apart_px > half_px):
            return place
    return None


def search_place(rng: np.random.Generator, cov: Array, window_px: float) -> Point:
    """How far off a prediction is, drawn from its covariance (4, 4), within EDGE_SHARE of the window, px."""
    dx, dy = rng.multivariate_normal(np.zeros(2), cov[:2, :2], method="cholesky")
    far = max(abs(dx), abs(dy)) / (EDGE_SHARE * window_px)
    shrink = float(rng.uniform()) / far if far > 1.0 else 1.0
    return float(dx) * shrink, float(dy) * shrink


def other_picture(
    rng: np.random.Generator, others: Sequence[Footage], at: Point, size: tuple[int, int]
) -> ImageU8 | None:
    """A picture of `size` with some place of some other sequence at `at`; None when it cannot be read."""
    other = others[int(rng.integers(len(others)))]
    try:
        image = other.images[int(rng.integers(len(other.truth)))]
    except TrainingError:
        return None
    place = (float(rng.uniform(0, image.shape[1])), float(rng.uniform(0, image.shape[0])))
    return displaced(image, at, place, size)[0]
