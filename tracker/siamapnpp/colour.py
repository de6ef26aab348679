"""The colours in the middle of a box: a soft histogram over Lab, which the network's deep features hardly see.

Two cars of one make in two paints have features that are nearly the same; their colours are not. Plain numpy and
OpenCV, no state. What was tried, and with what result, stands at the constants.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from tracker.box import Box
from tracker.messages import Array, ImageU8

CENTRAL = 0.7  # of width and height, as an ellipse that counts most in its middle: hardly any background in it
SIDE_PX = 12  # of the sample: 24 tells no more (within a point everywhere) and takes longer
# Soft bins: Gaussians 0.9 bins wide, so that a change of tone that is no change of paint moves no count to a strange
# bin. With 9 bins of chroma 2 to 5 points fewer of other things are told apart at the same share of targets kept.
LIGHT_BINS, LIGHT_TOP = 5, 110.0
CHROMA_BINS, CHROMA_TOP = 11, 60.0
BIN_SIGMA = 0.9
LEAST_MEMBERSHIP = 1e-4  # products of three smaller ones are denormal floats, ten times as slow
# Half of the picture's exposure and tint is taken out: each channel times the root of the ratio of GREY to its mean.
# Where exposure varies by 12 % and the channels by 4 %, and 97 % of targets are kept, that rejects 92 % of simulated
# cars in other paints; taking nothing out 75 %; all of it 90 %, and 4 points less where a target comes back in one
# light.
GREY = 0.45
BALANCE = 0.5
MIN_MEAN = 0.02  # a black picture has no tint
ROW_STEP = 8  # a mean over every eighth row differs by less than a grey level, at an eighth of the time
MIN_INSIDE = 0.5  # share of the sample's weight inside the picture; below, too little of the box is seen

Weights = npt.NDArray[np.float32]


def balance(image_bgr_u8: ImageU8) -> Weights:
    """Factors (3,) of blue, green and red by which a picture's colours are made comparable with another's."""
    mean = np.array(cv2.mean(image_bgr_u8[::ROW_STEP])[:3]) / 255.0
    return np.asarray((GREY / np.maximum(mean, MIN_MEAN)) ** BALANCE, dtype=np.float32)


def describe(image_bgr_u8: ImageU8, box: Box, factors: Weights) -> Array | None:
    """Unit vector (5 * 11 * 11,), roots of the shares of (L, a, b); `factors` are those of `balance`.

    `box` is in frame pixels. None when it is not finite, has no size, or half of its middle is outside the picture.
    """
    x0, y0 = box.cx_px - CENTRAL * box.w_px / 2, box.cy_px - CENTRAL * box.h_px / 2
    w, h = CENTRAL * box.w_px, CENTRAL * box.h_px
    if not all(math.isfinite(v) for v in (x0, y0, w, h)) or w <= 0 or h <= 0:
        return None
    weights = _weights(image_bgr_u8.shape, x0, y0, w, h)
    if weights is None:
        return None
    sample = _sample(image_bgr_u8, x0, y0, w, h).reshape(1, -1, 3)[:, _CHOSEN] * (factors / np.float32(255.0))
    lab = cv2.cvtColor(np.minimum(sample, np.float32(1.0)), cv2.COLOR_BGR2Lab)[0]
    # What is beyond the tables belongs to their last bins.
    at = np.minimum(np.maximum(lab - _FIRST, 0.0), _LAST).astype(np.intp)
    light, a, b = _LIGHTS[at[:, 0]] * weights, _CHROMAS[at[:, 1]], _CHROMAS[at[:, 2]]
    joint = (light[:, :, None] * a[:, None, :]).reshape(len(light), -1).T @ b
    shares = joint.astype(np.float64).ravel()
    return np.asarray(np.sqrt(shares / shares.sum()), dtype=np.float64)


def similarity(one: Array, other: Array) -> float:
    """In [0, 1]: 1 - Hellinger distance of two descriptors. 1: the same colours in the same shares."""
    overlap = min(float(one @ other), 1.0)
    return 1.0 - math.sqrt(max(1.0 - overlap, 0.0))


def _weights(shape: tuple[int, ...], x0: float, y0: float, w: float, h: float) -> Weights | None:
    """(n, 1): what each chosen point of the sample counts, 0 outside of the picture; None: too little is inside."""
    if x0 >= 0.0 and y0 >= 0.0 and x0 + w <= shape[1] and y0 + h <= shape[0]:
        return _WEIGHTS
    down, right = (
        (at >= 0.0) & (at <= limit) for at, limit in ((y0 + h * _POINTS, shape[0]), (x0 + w * _POINTS, shape[1]))
    )
    held = _WEIGHTS * np.outer(down, right).ravel()[_CHOSEN, None]
    return held if float(held.sum()) >= MIN_INSIDE * float(_WEIGHTS.sum()) else None


def _sample(image: ImageU8, x0: float, y0: float, w: float, h: float) -> ImageU8:
    """(SIDE, SIDE, 3) of the rectangle, each of its sides stretched or averaged down by itself."""
    step_x, step_y = w / SIDE_PX, h / SIDE_PX
    fold_x, fold_y = max(int(step_x), 1), max(int(step_y), 1)  # leaves less than 2x for the bilinear step
    source, left, top = image, 0, 0
    if fold_x > 1 or fold_y > 1:
        left, top = max(0, math.floor(x0) - fold_x), max(0, math.floor(y0) - fold_y)
        columns = (min(image.shape[1], math.ceil(x0 + w) + fold_x) - left) // fold_x
        rows = (min(image.shape[0], math.ceil(y0 + h) + fold_y) - top) // fold_y
        part = image[top : top + rows * fold_y, left : left + columns * fold_x]
        source = np.asarray(cv2.resize(part, (columns, rows), interpolation=cv2.INTER_AREA), dtype=np.uint8)
    matrix = np.array(
        [
            [step_x / fold_x, 0.0, (x0 - left + 0.5 * step_x) / fold_x - 0.5],
            [0.0, step_y / fold_y, (y0 - top + 0.5 * step_y) / fold_y - 0.5],
        ]
    )
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    out = cv2.warpAffine(source, matrix, (SIDE_PX, SIDE_PX), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(out, dtype=np.uint8)


def _table(first: float, last: float, bins: int) -> Weights:
    """(values, bins) for every whole value from `first` to `last`; rows sum to 1."""
    centres = np.linspace(first, last, bins)
    sigma = BIN_SIGMA * (centres[1] - centres[0])
    bells = np.exp(-0.5 * ((np.arange(first, last + 1)[:, None] - centres) / sigma) ** 2)
    bells[bells < LEAST_MEMBERSHIP] = 0.0
    return np.asarray(bells / bells.sum(axis=1, keepdims=True), dtype=np.float32)


_POINTS = (np.arange(SIDE_PX) + 0.5) / SIDE_PX
_KERNEL = np.maximum(1.0 - (2 * _POINTS[:, None] - 1) ** 2 - (2 * _POINTS - 1) ** 2, 0.0).ravel()
_CHOSEN = np.flatnonzero(_KERNEL)
_WEIGHTS: Weights = _KERNEL[_CHOSEN, None].astype(np.float32)
_LIGHTS = _table(0.0, LIGHT_TOP, LIGHT_BINS)
_CHROMAS = _table(-CHROMA_TOP, CHROMA_TOP, CHROMA_BINS)
_FIRST: Weights = np.array((0.0, -CHROMA_TOP, -CHROMA_TOP), dtype=np.float32) - np.float32(0.5)  # rounds
_LAST: Weights = np.array((len(_LIGHTS), len(_CHROMAS), len(_CHROMAS)), dtype=np.float32) - np.float32(1.0)
