"""The network's maps of one window made into candidates in the picture: plain numpy, no state."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from tracker.box import Box
from tracker.messages import Array, Candidate, Evidence
from tracker.siamapnpp.crop import CropGeometry
from tracker.siamapnpp.decode import Decoded, ResponseMaps, decode, footprint, pick, rank, shape_penalty
from tracker.siamapnpp.embedding import of_place
from tracker.siamapnpp.evidence import map_evidence, penalised_score
from tracker.siamapnpp.merge import Found
from tracker.siamapnpp.settings import TrackerSettings
from tracker.siamapnpp.windows import FLOOR_PX, Window

LR_STEP_S = 1 / 30  # the time that the official rate of size smoothing is meant for
STEP_RANGE_S = (1 / 120, 0.5)  # shorter is jitter of stamps; after longer the size is as good as new
# In a wider window the target is too small for its features to be those of an exemplar: ROC AUC of their likeness 0.99
# at scale 1, 0.98 at 1.15, 0.97 at 1.3, 0.91 at 1.6, 0.81 at 2 (15 training videos).
MAX_LOOK_SCALE = 1.15

Likeness = Callable[[Array | None], tuple[float | None, float | None]]


@dataclass(frozen=True, slots=True)
class Situation:
    """What is known before a search: the target's size and the picture's (frame pixels), time since the last one."""

    size_px: tuple[float, float]
    image_size_px: tuple[float, float]
    step_s: float


def candidates_of(
    maps: ResponseMaps, window: Window, now: Situation, settings: TrackerSettings, likeness: Likeness
) -> list[Found]:
    """Candidates of a window, best first; empty when the maps hold nothing finite. Never raises on bad numbers.

    `likeness` compares a look (`tracker/siamapnpp/embedding.py`) with those kept.
    """
    decoded, scale = decode(maps, settings), window.geometry.scale
    size = (now.size_px[0] * scale, now.size_px[1] * scale)
    penalty = shape_penalty(decoded, *size, settings.penalty_k)
    ranked, plain = rank(decoded, penalty, settings), penalised_score(decoded, penalty)
    apart = footprint(*size)
    found = []
    for i in pick(decoded, ranked, apart, settings.max_candidates):
        evidence = map_evidence(decoded, plain, i, apart, size, window.scale)
        # The official rate is penalty * score * size_lr; its score is no probability, so the product is bounded.
        rate = min(max(float(penalty[i]) * float(decoded.ranking[i]) * settings.size_lr, 0.0), 1.0)
        candidate = Candidate(
            box=_box(decoded, i, window.geometry, _over_time(rate, now.step_s, settings), now),
            score=min(max(float(decoded.confidence[i]), 0.0), 1.0),
            peak=float(ranked[i]),
            similarity=float(decoded.similarity[i]),
            evidence=_with_look(evidence, maps, (float(decoded.cx[i]), float(decoded.cy[i])), likeness),
        )
        found.append(Found(candidate, float(plain[i]), (apart[0] / scale, apart[1] / scale)))
    return found


def _with_look(evidence: Evidence, maps: ResponseMaps, place: tuple[float, float], likeness: Likeness) -> Evidence:
    if maps.features is None or evidence.search_scale > MAX_LOOK_SCALE:
        return evidence
    exemplar, recent = likeness(of_place(maps.features, *place))
    return replace(evidence, exemplar=exemplar, recent=recent)


def _over_time(rate: float, step_s: float, settings: TrackerSettings) -> float:
    """The share of the new size that the time since the last picture is worth."""
    if not settings.size_lr_per_s or not math.isfinite(step_s):
        return rate
    step_s = min(max(step_s, STEP_RANGE_S[0]), STEP_RANGE_S[1])
    return float(1.0 - (1.0 - rate) ** (step_s / LR_STEP_S))


def _box(decoded: Decoded, i: int, geometry: CropGeometry, rate: float, now: Situation) -> Box:
    width, height = now.image_size_px
    w = (1.0 - rate) * now.size_px[0] + rate * float(decoded.w[i]) / geometry.scale
    h = (1.0 - rate) * now.size_px[1] + rate * float(decoded.h[i]) / geometry.scale
    return Box(
        cx_px=min(max(geometry.cx_px + float(decoded.cx[i]) / geometry.scale, 0.0), width),
        cy_px=min(max(geometry.cy_px + float(decoded.cy[i]) / geometry.scale, 0.0), height),
        w_px=min(max(w, FLOOR_PX), width),
        h_px=min(max(h, FLOOR_PX), height),
    )
