"""One list of candidates out of those of several windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from tracker.messages import Candidate
from tracker.siamapnpp.evidence import MAX_SECOND

NARROW_SHARE = 0.6  # of the rank: what a narrow window shows as well is seen better there than in a wide one


@dataclass(frozen=True, slots=True)
class Found:
    """A candidate, its rank that can be compared between windows, and its footprint (half sizes, frame pixels)."""

    candidate: Candidate
    rank: float
    footprint_px: tuple[float, float]


def merge(windows: Sequence[Sequence[Found]], count: int) -> tuple[Candidate, ...]:
    """The best `count` of all windows' candidates, best first, none in the footprint of a better one.

    Those of a single window keep its order, in which its middle counts more. Where there are several their middles mean
    nothing, so the plain rank decides; `second` is then over all of them.
    """
    if len(windows) == 1:
        return tuple(one.candidate for one in windows[0][:count])
    kept: list[Found] = []
    for one in sorted((one for found in windows for one in found), key=_rank, reverse=True):
        better = next((i for i, other in enumerate(kept) if _same_place(other, one)), None)
        if better is None:
            kept.append(one)
        elif _scale(one) < _scale(kept[better]) and one.rank >= NARROW_SHARE * kept[better].rank:
            kept[better] = one
    return tuple(_with_second(one, kept) for one in kept[:count])


def _with_second(one: Found, kept: Sequence[Found]) -> Candidate:
    evidence = one.candidate.evidence
    other = max((o.rank for o in kept if o is not one), default=0.0)
    if evidence is None or other <= evidence.second * one.rank:
        return one.candidate
    second = min(other / one.rank, MAX_SECOND) if one.rank > 0 else MAX_SECOND
    return replace(one.candidate, evidence=replace(evidence, second=second))


def _same_place(a: Found, b: Found) -> bool:
    """The coarser of the two windows decides: it cannot tell apart what the finer could."""
    reach_x, reach_y = (max(pair) for pair in zip(a.footprint_px, b.footprint_px, strict=True))
    p, q = a.candidate.box, b.candidate.box
    return abs(p.cx_px - q.cx_px) < reach_x and abs(p.cy_px - q.cy_px) < reach_y


def _scale(found: Found) -> float:
    evidence = found.candidate.evidence
    return evidence.search_scale if evidence is not None else 1.0


def _rank(found: Found) -> float:
    return found.rank
