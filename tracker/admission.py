"""Whether a candidate may enter the estimate or end a search, and if not, why not: probability, look, size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tracker.agreement import TIME_EPS_S
from tracker.association import Judged
from tracker.box import Box
from tracker.collapse import COLLAPSE_LN_SIZE, SizeMemory, is_partial
from tracker.confidence.features import Doubt
from tracker.confidence.model import ConfidenceModel
from tracker.confidence.reference import Reference
from tracker.likeness import Likeness, exemplar_of
from tracker.messages import TargetReason, TargetStatus
from tracker.target_config import TargetConfig

SIZE_LN, SIZE_LN_S = 0.5, 0.2  # what is found again differs by a factor of 1.65 at most, by 22 % more each second
COVERED_S = 0.5  # a car at walking pace goes behind an edge in about a second, from the collapse on in half of one
FAR_SIZES = 1.0  # before it is confirmed, a target beyond its own size from where it was selected is perhaps another
WIDE = 1.05  # a window of a larger scale than this shows the target so small that its look is uncertain

REASON_OF = {
    Doubt.LOW_PEAK: TargetReason.LOW_PEAK,
    Doubt.AMBIGUOUS: TargetReason.AMBIGUOUS,
    Doubt.UNLIKE_EXEMPLAR: TargetReason.UNLIKE_EXEMPLAR,
    Doubt.SHAPE_COLLAPSE: TargetReason.SHAPE_COLLAPSE,
    Doubt.INNOVATION_GATE: TargetReason.INNOVATION_GATE,
}


@dataclass(frozen=True, slots=True)
class Moment:
    """When a candidate is judged: monotonic s, the status so far, for how long unseen (s), and the predicted box."""

    t_s: float
    status: TargetStatus
    unseen_s: float
    predicted: Box


class Admission:
    """Never raises in the loop. `covered`: the target was last seen while something came before it."""

    def __init__(
        self, config: TargetConfig, model: ConfidenceModel, reference: Reference, look: Likeness, sizes: SizeMemory
    ) -> None:
        self._config, self._model, self._reference = config, model, reference
        self._look, self._sizes = look, sizes
        self.covered = False

    def refuses(self, best: Judged, now: Moment) -> TargetReason | None:
        """Why the chosen candidate must not enter the estimate; None: it may."""
        c, coasting = self._config, now.status is TargetStatus.COASTING
        if not best.inside and best.appearance < c.status.lock_confidence:
            return TargetReason.INNOVATION_GATE
        if best.inside and best.probability < (c.status.lock_confidence if coasting else c.use_confidence):
            return self.doubt(best)
        if self._is_covering(best, now):
            return TargetReason.SHAPE_COLLAPSE
        return None if self._is_like(best, now) else TargetReason.UNLIKE_EXEMPLAR

    def may_move(self, best: Judged, now: Moment) -> bool:
        """Whether a prediction may be moved by what is too faint to be a sight.

        Never where the camera's motion is told. Where it is not a velocity predicts nothing, and the place of the
        strongest response is a better guess.
        """
        if self._sizes.places_hold or now.status not in (TargetStatus.COASTING, TargetStatus.SEARCHING):
            return False
        return best.inside and not self._is_covering(best, now)

    def found(self, judged: Sequence[Judged], unseen_s: float) -> tuple[list[Judged], TargetReason]:
        """Those that may end a search when they last, and what is to be said: why there is none, or CONFIRMING."""
        sure = [j for j in judged if j.appearance >= self._config.status.lock_confidence]
        if not sure:
            return [], self.doubt(max(judged, key=lambda j: j.appearance))
        alike = [j for j in sure if self._look.is_found(j.candidate)]
        if not alike:
            return [], TargetReason.UNLIKE_EXEMPLAR
        bound = SIZE_LN + SIZE_LN_S * unseen_s
        found = [j for j in alike if abs(j.motion.ln_size) <= bound]
        return found, TargetReason.CONFIRMING if found else TargetReason.SHAPE_COLLAPSE

    def is_worth_a_look(self, judged: Judged) -> bool:
        """Whether something in a wide window, where all is small and uncertain, is looked at in a narrow one."""
        evidence = judged.candidate.evidence
        return (
            evidence is not None and evidence.search_scale > WIDE and judged.appearance >= self._config.use_confidence
        )

    def doubt(self, best: Judged) -> TargetReason:
        """What speaks most against a candidate."""
        if not self._model.fitted or best.candidate.evidence is None:
            return TargetReason.LOW_SCORE
        doubts = self._model.reasons(best.candidate, best.motion, self._reference)
        return REASON_OF[doubts[0]] if doubts else TargetReason.LOW_CONFIDENCE

    def _is_like(self, best: Judged, now: Moment) -> bool:
        """The more by the less was seen of the target of late."""
        far = now.status is TargetStatus.ACQUIRING and best.motion.pos_sizes > FAR_SIZES
        if far or not best.inside:
            return self._look.is_alike(best.candidate)
        if now.status is not TargetStatus.COASTING:
            return self._look.is_sustained(best.candidate)
        long = now.unseen_s > self._config.status.trust_s + TIME_EPS_S
        return self._look.may_resume(best.candidate) and (not long or self._look.has_colours(best.candidate))

    def _is_covering(self, best: Judged, now: Moment) -> bool:
        """Whether what is seen is what is left of a target that something comes before."""
        collapses = self._sizes.collapses(best.candidate.box, now.t_s, exemplar_of(best.candidate))
        return collapses or self._is_partial(best, now)

    def _is_partial(self, best: Judged, now: Moment) -> bool:
        """Whether a target that was being covered is still seen in part only: much smaller than it was before.

        What is seen so for longer than `COVERED_S` has turned, or moved away.
        """
        if now.status is not TargetStatus.COASTING or not self.covered or now.unseen_s > COVERED_S:
            return False
        evidence = best.candidate.evidence
        seen_ln_size = evidence.ln_scale if evidence is not None else 0.0
        return is_partial(best.candidate.box, now.predicted) or seen_ln_size < -COLLAPSE_LN_SIZE
