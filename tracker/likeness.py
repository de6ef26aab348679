"""Whether what was found looks like this very target: deep features and colours, by what is usual for it."""

from __future__ import annotations

import math

from tracker.confidence.reference import Reference
from tracker.messages import Candidate, Evidence
from tracker.target_config import TargetConfig

UNKNOWN_LIKENESS = 0.7  # cosine that a target usually has with its first exemplar: 0.6 to 0.9 in a second
MIN_LIKENESS = 0.25  # a target of which less is usual is recognised by chance
FIRST_LIKENESS = 0.15  # before it is known what is usual: what has less is another thing
PRESENT_S = 1.0  # over which the present likeness is a mean
UNKNOWN_COLOUR = 0.8  # similarity of colours that a target usually has in its first second: 0.73 to 0.96


class Likeness:
    """Judges candidates by the reference that the target gave in its first confirmed second.

    Without evidence there is nothing to judge, and every candidate passes.
    """

    def __init__(self, config: TargetConfig, reference: Reference) -> None:
        self._config = config
        self._reference = reference
        self.clear()

    def clear(self) -> None:
        """Forget how alike the target was lately, as for a new one."""
        self._present: float | None = None
        self._t_s = -math.inf

    def seen(self, candidate: Candidate, t_s: float) -> None:
        """The target itself, in a lock, at `t_s`: how alike it is at present."""
        if candidate.evidence is None or candidate.evidence.exemplar is None:
            return
        now = _likeness(candidate.evidence, candidate.evidence.exemplar)
        share = 1.0 - math.exp(-max(t_s - self._t_s, 0.0) / PRESENT_S)
        self._present = now if self._present is None else self._present + share * (now - self._present)
        self._t_s = t_s

    def is_alike(self, candidate: Candidate) -> bool:
        """Whether it looks like this very target: what is taken at another place, or remembered, must."""
        return self.has_colours(candidate) and _reaches(candidate, self._usual(self._config.alike_share))

    def is_found(self, candidate: Candidate) -> bool:
        """Whether it looks so much like this very target that it may end a search: of all that is in a picture, the
        most alike is easily something else.
        """
        return self.has_colours(candidate) and _reaches(candidate, self._usual(self._config.found_share))

    def may_resume(self, candidate: Candidate) -> bool:
        """Whether it looks as the target did lately, before it was out of sight for a moment.

        More is asked than of a lock that goes on: what covers a target is first seen when the target is not.
        """
        present = math.inf if self._present is None else self._config.present_share * self._present
        return _reaches(candidate, min(self._usual(self._config.alike_share), present))

    def is_sustained(self, candidate: Candidate) -> bool:
        """Whether a lock may go on: what covers a target can have good scores, but hardly its look."""
        usual = self._reference.exemplar
        return _reaches(
            candidate, FIRST_LIKENESS if usual is None else self._config.sustain_share * max(usual, MIN_LIKENESS)
        )

    def may_be_kept(self, candidate: Candidate) -> bool:
        """Whether the memory may take it: it was compared with the exemplar or what is kept, and is alike."""
        return was_compared(candidate) and self.is_alike(candidate)

    def _usual(self, share: float) -> float:
        usual = self._reference.exemplar
        return share * (UNKNOWN_LIKENESS if usual is None else max(usual, MIN_LIKENESS))

    def has_colours(self, candidate: Candidate) -> bool:
        """Whether its colours are those of the target, where they are known."""
        if candidate.evidence is None or candidate.evidence.colour is None:
            return True
        usual = self._reference.colour
        return candidate.evidence.colour >= self._config.colour_share * (UNKNOWN_COLOUR if usual is None else usual)


def _reaches(candidate: Candidate, least: float) -> bool:
    """Whether the likeness is at least so much; true where there is none."""
    evidence = candidate.evidence
    return evidence is None or evidence.exemplar is None or _likeness(evidence, evidence.exemplar) >= least


def was_compared(candidate: Candidate) -> bool:
    """Whether its look was compared with the exemplar, if the tracker does such a thing."""
    return candidate.evidence is None or candidate.evidence.exemplar is not None


def exemplar_of(candidate: Candidate) -> float | None:
    """The cosine with the first exemplar; None: not compared."""
    return None if candidate.evidence is None else candidate.evidence.exemplar


def _likeness(evidence: Evidence, exemplar: float) -> float:
    return max(exemplar, -1.0 if evidence.recent is None else evidence.recent)
