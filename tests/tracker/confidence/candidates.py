"""Candidates for the tests of the confidence."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from tracker.box import Box
from tracker.messages import Candidate, Evidence

BOX = Box(100.0, 80.0, 30.0, 20.0)
EVIDENCE = Evidence((0.9, 0.8, 0.7), 0.4, 8.0, 0.9, 0.8, 0.1, -0.2)


def candidate(score: float = 0.8, **evidence: Any) -> Candidate:
    """A good one, with changes to its evidence."""
    return Candidate(BOX, score, 0.7, 0.8, replace(EVIDENCE, **evidence))


def bare(score: float) -> Candidate:
    """Of a tracker that gives no evidence."""
    return Candidate(BOX, score, 0.7, 0.8)
