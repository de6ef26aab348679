"""Proposals: boxes to pick from, distinct, best first, each with a score and the reason it is there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

from tracker.box import Box
from tracker.messages import ImageU8
from tracker.selection.network import Scorer

SAME_IOU = 0.6  # boxes that overlap more are one proposal: a person sees no difference
MAX_PROPOSALS = 6  # boxes of one click: more a person does not tell apart
MAX_LISTED = 9  # of a list of everything: numbers of one digit
# Overlap to be expected of a box that both the cues and a scorer judged: a straight line. Fitted to 40 clicks into 20
# sequences; of 66 into 22 others the first box overlaps the truth by more than 0.5 in 0.67, without a scorer in 0.47.
CUES_SHARE, NETWORK_SHARE, BASE = 1.12, 0.82, -0.49


class Reason(str, Enum):
    """Where a proposal comes from."""

    OUTLINE = "outline"  # a box whose border fits edges and colours
    SEGMENT = "segment"  # what has the colours of the place clicked on
    MOVING = "moving"  # it moves against the ground
    SALIENT = "salient"  # it differs from its surroundings


@dataclass(frozen=True, slots=True)
class Proposal:
    """A box that may be what was meant. `score` in [0, 1] compares proposals of one list."""

    box: Box
    score: float
    reason: Reason


def distinct(
    ranked: Sequence[Proposal], same_iou: float = SAME_IOU, at_most: int = MAX_PROPOSALS
) -> tuple[Proposal, ...]:
    """The first of each group of overlapping proposals, in the order given."""
    kept: list[Proposal] = []
    for proposal in ranked:
        if all(proposal.box.iou(other.box) < same_iou for other in kept):
            kept.append(proposal)
            if len(kept) == at_most:
                break
    return tuple(kept)


def rejudged(image_bgr_u8: ImageU8, proposals: Sequence[Proposal], scorer: Scorer) -> tuple[Proposal, ...]:
    """The proposals in the order of cues and a scorer together; one that it does not judge has only the cues."""
    said = scorer.score(image_bgr_u8, [p.box for p in proposals])
    values = [
        CUES_SHARE * p.score + NETWORK_SHARE * (value or 0.0) + BASE for p, value in zip(proposals, said, strict=True)
    ]
    order = sorted(range(len(values)), key=lambda k: -values[k])
    return tuple(replace(proposals[k], score=min(max(values[k], 0.0), 1.0)) for k in order)


def holds(whole: Box, part: Box) -> bool:
    """Whether the middle of `part` lies in `whole`: it is then a part of it, or the same."""
    x1, y1, x2, y2 = whole.to_corners()
    return x1 <= part.cx_px <= x2 and y1 <= part.cy_px <= y2
