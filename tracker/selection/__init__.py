"""Choosing a target: boxes for a click, things that move, and whether a box can be tracked at all."""

from tracker.selection.click import propose
from tracker.selection.motion import MotionProposals
from tracker.selection.network import Scorer, SelfConsistency
from tracker.selection.ranking import Proposal, Reason, distinct
from tracker.selection.salience import salient
from tracker.selection.suitability import Unsuitable, unsuitable, warning

__all__ = [
    "MotionProposals", "Proposal", "Reason", "Scorer", "SelfConsistency", "Unsuitable", "distinct", "propose",
    "salient", "unsuitable", "warning",
]  # fmt: skip
