"""Whether what was found looks like this very target: deep features and colours, by what is usual for it."""

from __future__ import annotations

from tracker.confidence.reference import Reference
from tracker.messages import Candidate, Evidence
from tracker.target_config import TargetConfig

UNKNOWN_LIKENESS = 0.7  # cosine that a target usually has with its first exemplar: 0.6 to 0.9 in a second
MIN_LIKENESS = 0.25  # a target of which less is usual is recognised by chance
FIRST_LIKENESS = 0.15  # before it is known what is usual: what has less is another thing
UNKNOWN_COLOUR = 0.8  # similarity of colours that a target usually has in its first second: 0.73 to 0.96


class Likeness:
    """Judges candidates by the reference that the target gave in its first confirmed second.

    Without evidence there is nothing to judge, and every candidate passes.
    """

    def __init__(self, config: TargetConfig, reference: Reference) -> None:
        self._config = config
        self._reference = reference

    def is_alike(self, candidate: Candidate) -> bool:
        """Whether it looks like this very target: what is found again must."""
        evidence = candidate.evidence
        if not self.has_colours(candidate):
            return False
        if evidence is None or evidence.exemplar is None:
            return True
        usual = self._reference.exemplar
        least = self._config.alike_share * (UNKNOWN_LIKENESS if usual is None else max(usual, MIN_LIKENESS))
        return _likeness(evidence, evidence.exemplar) >= least

    def is_sustained(self, candidate: Candidate) -> bool:
        """Whether a lock may go on: what covers a target can have good scores, but hardly its look."""
        evidence, usual = candidate.evidence, self._reference.exemplar
        if evidence is None or evidence.exemplar is None:
            return True
        least = FIRST_LIKENESS if usual is None else self._config.sustain_share * max(usual, MIN_LIKENESS)
        return _likeness(evidence, evidence.exemplar) >= least

    def may_be_kept(self, candidate: Candidate) -> bool:
        """Whether the memory may take it: it was compared with the exemplar, goes on from it, and has its colours."""
        return was_compared(candidate) and self.is_sustained(candidate) and self.has_colours(candidate)

    def has_colours(self, candidate: Candidate) -> bool:
        """Whether its colours are those of the target, where they are known."""
        if candidate.evidence is None or candidate.evidence.colour is None:
            return True
        usual = self._reference.colour
        return candidate.evidence.colour >= self._config.colour_share * (UNKNOWN_COLOUR if usual is None else usual)


def was_compared(candidate: Candidate) -> bool:
    """Whether its look was compared with the exemplar, if the tracker does such a thing."""
    return candidate.evidence is None or candidate.evidence.exemplar is not None


def _likeness(evidence: Evidence, exemplar: float) -> float:
    """The better of the cosines with the first exemplar and with the rest of the memory."""
    return max(exemplar, -1.0 if evidence.recent is None else evidence.recent)
