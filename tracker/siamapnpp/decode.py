"""Response maps to boxes and scores, in plain numpy: no state, no network.

Coordinates are those of the search crop relative to its centre, in crop pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from tracker.messages import Array
from tracker.siamapnpp.crop import CONTEXT
from tracker.siamapnpp.settings import CentreTerm, TrackerSettings

ANCHOR_PX = 71.0  # unit of the anchor map: 287 // 4 (the baseline SiamAPN has 143)
STRIDE_PX = 8
MAX_LOG_DELTA = 4.0  # exp(dw) is unbounded; a factor of 55 to the anchor is more than any crop holds
MIN_BOX_PX = 1.0  # a box below one crop pixel is no measurement
EPS = 1e-9
# Boxes of one target scatter by a part of its size around it; the next one of a row of alike things is a size away. On
# 30 training videos half of the strong second peaks (above 0.4 of the first) were the same target's with 0.5 here, none
# with 0.75; with 1.0 a real one was lost.
FOOTPRINT_SIZES = 0.75
MIN_FOOTPRINT_PX = 1.0 * STRIDE_PX  # neighbouring cells see almost the same picture, however small the target is

FloatMap = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class ResponseMaps:
    """Network output of one frame as numpy: cls1 and cls2 (2, M, M), cls3 (1, M, M), loc and anchor (4, M, M).

    `features` (C, M + 5, M + 5) are those of the search crop from layer5, None from engines that do not give them.
    """

    cls1: FloatMap
    cls2: FloatMap
    cls3: FloatMap
    loc: FloatMap
    anchor: FloatMap
    features: FloatMap | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Decoded:
    """One row per cell, row-major: boxes (N,) in crop pixels from the crop centre, scores, and which are usable.

    `ranking` is the official weighted sum (may leave [0, 1] with a raw centre logit); `confidence` in [0, 1];
    `similarity` in [0, 1]; `heads` (3, N) the three classifications in [0, 1]. Cells that are not usable have score 0
    and a unit box.
    """

    cx: Array
    cy: Array
    w: Array
    h: Array
    ranking: Array
    confidence: Array
    similarity: Array
    heads: Array
    usable: npt.NDArray[np.bool_]


@lru_cache(maxsize=8)
def grid(cells: int) -> tuple[Array, Array]:
    """x and y of the cell centres, flattened row-major (y outer): 8 i - 80 for 21 cells."""
    axis = (np.arange(cells) - cells // 2) * float(STRIDE_PX)
    return np.tile(axis, cells), np.repeat(axis, cells)


@lru_cache(maxsize=8)
def hann(cells: int) -> Array:
    """Outer product of two Hann windows, flattened; zero at the border."""
    line = np.hanning(cells)
    return np.outer(line, line).ravel()


def _sigmoid(x: Array) -> Array:
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * x)), dtype=np.float64)


def decode(maps: ResponseMaps, settings: TrackerSettings) -> Decoded:
    """Boxes and scores of every cell. Never raises on bad numbers: such cells are marked as not usable."""
    with np.errstate(all="ignore"):
        cx, cy, w, h = _boxes(maps)
        # Class 1 of a two-way softmax is the sigmoid of the difference.
        p1 = _sigmoid(_diff(maps.cls1))
        p2 = _sigmoid(_diff(maps.cls2))
        logit = maps.cls3[0].ravel().astype(np.float64)
        p3 = _sigmoid(logit)
        w1, w2, w3 = settings.class_weights
        confidence = (w1 * p1 + w2 * p2 + w3 * p3) / (w1 + w2 + w3)
        official = (w1 * p1 + w2 * p2 + w3 * logit) / 3.0
        ranking = official if settings.centre_term is CentreTerm.LOGIT else confidence
        usable = np.isfinite(cx) & np.isfinite(cy) & np.isfinite(w) & np.isfinite(h) & np.isfinite(ranking)
        usable &= np.isfinite(confidence) & (w >= MIN_BOX_PX) & (h >= MIN_BOX_PX)
    return Decoded(
        cx=np.where(usable, cx, 0.0),
        cy=np.where(usable, cy, 0.0),
        w=np.where(usable, w, 1.0),
        h=np.where(usable, h, 1.0),
        ranking=np.where(usable, ranking, 0.0),
        confidence=np.where(usable, confidence, 0.0),
        similarity=np.where(usable, p2, 0.0),
        heads=np.where(usable, np.stack((p1, p2, p3)), 0.0),
        usable=usable,
    )


def _diff(two: FloatMap) -> Array:
    return np.asarray((two[1].astype(np.float64) - two[0].astype(np.float64)).ravel(), dtype=np.float64)


def _boxes(maps: ResponseMaps) -> tuple[Array, Array, Array, Array]:
    left, right, top, bottom = maps.anchor.astype(np.float64).reshape(4, -1) * ANCHOR_PX
    dx, dy, dw, dh = maps.loc.astype(np.float64).reshape(4, -1)
    gx, gy = grid(maps.anchor.shape[-1])
    anchor_w, anchor_h = left + right, top + bottom
    # A negative anchor side would turn into a NaN in the penalty and win the argmax for ever.
    anchor_w = np.where(anchor_w > 0, anchor_w, np.nan)
    anchor_h = np.where(anchor_h > 0, anchor_h, np.nan)
    cx = gx - left + anchor_w / 2 + dx * anchor_w
    cy = gy - top + anchor_h / 2 + dy * anchor_h
    w = anchor_w * np.exp(np.clip(dw, -MAX_LOG_DELTA, MAX_LOG_DELTA))
    h = anchor_h * np.exp(np.clip(dh, -MAX_LOG_DELTA, MAX_LOG_DELTA))
    return cx, cy, w, h


def _change(ratio: Array) -> Array:
    return np.maximum(ratio, 1.0 / (ratio + EPS))


def _padded(w: Array | float, h: Array | float) -> Array:
    context = CONTEXT * (np.asarray(w) + np.asarray(h))
    return np.asarray(np.sqrt((w + context) * (h + context)), dtype=np.float64)


def shape_penalty(decoded: Decoded, target_w: float, target_h: float, penalty_k: float) -> Array:
    """In (0, 1]: 1 where a box has the target's scale and aspect (both in crop pixels), less the more it differs."""
    scale = _change(_padded(decoded.w, decoded.h) / _padded(target_w, target_h))
    aspect = _change((target_w / target_h) / (decoded.w / decoded.h))
    return np.asarray(np.exp(-(scale * aspect - 1.0) * penalty_k), dtype=np.float64)


def rank(decoded: Decoded, penalty: Array, settings: TrackerSettings) -> Array:
    """Penalised and windowed score of each cell; -inf where it is not usable."""
    window = hann(round(len(decoded.cx) ** 0.5))
    ranked = penalty * decoded.ranking * (1.0 - settings.window) + window * settings.window
    return np.where(decoded.usable, ranked, -np.inf)


def near(decoded: Decoded, cell: int, footprint: tuple[float, float]) -> npt.NDArray[np.bool_]:
    """Which cells' boxes mean the same place as that of `cell`: centres within the footprint (half sizes, crop px)."""
    across = np.abs(decoded.cx - decoded.cx[cell]) < footprint[0]
    return np.asarray(across & (np.abs(decoded.cy - decoded.cy[cell]) < footprint[1]), dtype=np.bool_)


def footprint(target_w: float, target_h: float) -> tuple[float, float]:
    """How far from a peak, across and down in crop pixels, other peaks are still the same target's."""
    return max(FOOTPRINT_SIZES * target_w, MIN_FOOTPRINT_PX), max(FOOTPRINT_SIZES * target_h, MIN_FOOTPRINT_PX)


def pick(decoded: Decoded, ranked: Array, apart: tuple[float, float], count: int) -> list[int]:
    """Indices of the best cells, best first, none in the footprint `apart` of a better one."""
    left = ranked.copy()
    chosen: list[int] = []
    while len(chosen) < count:
        best = int(left.argmax())
        if not np.isfinite(left[best]):
            break
        chosen.append(best)
        left[near(decoded, best, apart)] = -np.inf
    return chosen
