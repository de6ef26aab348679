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
# Of the score. On 40 training clicks it gained 0.03 of overlap for the first three and nothing sure for the first (0.53
# to 0.55), for 0.5 s of a core: so the command line does without.
NETWORK_SHARE = 0.3


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
    """The proposals in the order of their scores mixed with a scorer's; those it does not judge keep theirs."""
    said = scorer.score(image_bgr_u8, [p.box for p in proposals])
    mixed = [
        p if value is None else replace(p, score=(1 - NETWORK_SHARE) * p.score + NETWORK_SHARE * value)
        for p, value in zip(proposals, said, strict=True)
    ]
    return tuple(sorted(mixed, key=lambda p: -p.score))


def holds(whole: Box, part: Box) -> bool:
    """Whether the middle of `part` lies in `whole`: it is then a part of it, or the same."""
    x1, y1, x2, y2 = whole.to_corners()
    return x1 <= part.cx_px <= x2 and y1 <= part.cy_px <= y2
