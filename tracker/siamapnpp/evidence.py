"""What the response maps say of a chosen cell beside its score: plain numpy on decoded maps, no state, no network."""

from __future__ import annotations

import math

import numpy as np

from tracker.messages import Array, Evidence
from tracker.siamapnpp.decode import EPS, Decoded, near

MAX_SECOND = 10.0  # the other peak's share; more says no more, and a chosen score near 0 would make it endless
# Added to the deviation of scores in [0, 1]: about what bf16 rounds, so that a map which is flat outside of the
# footprint (every easy target's) gives some number up to 100 and not noise up to infinity.
BASE_DEVIATION = 0.01
MAX_LN = 8.0  # e^8: larger changes of size or shape than any crop can show


def map_evidence(
    decoded: Decoded,
    penalised: Array,
    cell: int,
    footprint: tuple[float, float],
    size_px: tuple[float, float],
    search_scale: float,
) -> Evidence:
    """Evidence of one cell; every number is finite and bounded.

    `penalised` (N,) is the score in [0, 1] times the shape penalty, without the window: the window would hide a
    look-alike at the edge of the crop. `footprint` and the size searched with, `size_px`, are in crop pixels.
    """
    outside = decoded.usable & ~near(decoded, cell, footprint)
    peak, rest = float(penalised[cell]), penalised[outside]
    second = sharpness = 0.0
    if rest.size:
        second = min(float(rest.max()) / max(peak, EPS), MAX_SECOND)
        sharpness = (peak - float(rest.mean())) / (float(rest.std()) + BASE_DEVIATION)
    w, h = float(decoded.w[cell]), float(decoded.h[cell])
    return Evidence(
        heads=tuple(float(p) for p in decoded.heads[:, cell]),
        second=max(second, 0.0),
        sharpness=sharpness,
        exemplar=None,
        recent=None,
        ln_scale=_ln(math.sqrt(w * h / (size_px[0] * size_px[1]))),
        ln_aspect=_ln((w / h) / (size_px[0] / size_px[1])),
        search_scale=search_scale,
    )


def penalised_score(decoded: Decoded, penalty: Array) -> Array:
    """(N,) in [0, 1]: the score damped by the change of shape; 0 where a cell is not usable."""
    return np.asarray(np.clip(decoded.confidence * penalty, 0.0, 1.0) * decoded.usable, dtype=np.float64)


def _ln(ratio: float) -> float:
    return min(max(math.log(max(ratio, EPS)), -MAX_LN), MAX_LN)
