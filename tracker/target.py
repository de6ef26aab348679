"""What is known of the target: candidates and the box filter, made into a status with a reason (design section 4).

One step: predict; end by time what is over (`status`); judge the candidates by appearance and motion (`association`);
let the chosen one into the estimate, or say why not; watch for rivals and false locks (`alarms`); wish for memory
(`memory_gates`); plan the next search (`search_plan`). Every limit is a time in seconds, never a number of frames.
LOCKED after a step always means: a candidate entered the estimate in this very step. A step is one processed picture; a
picture without any candidate is a step too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from tracker.admission import Admission, Moment
from tracker.agreement import TIME_EPS_S, AgreeingRun
from tracker.association import Judged, associate, judge_all
from tracker.box import Box
from tracker.collapse import SizeMemory
from tracker.confidence.model import UNFITTED, ConfidenceModel
from tracker.confidence.reference import Reference
from tracker.filter import BoxFilter, FilterConfig, UpdateReason, usable_box
from tracker.likeness import Likeness, exemplar_of, was_compared
from tracker.messages import (
    Array,
    Candidate,
    MemoryWrite,
    SearchHint,
    SearchTile,
    TargetAlarm,
    TargetReason,
    TargetState,
    TargetStatus,
)
from tracker.rivals import RivalTracks
from tracker.search_plan import PlannedSearch, SearchPlan, SearchStage
from tracker.status import ACQUIRING, AT_REST, COASTING, LOCKED, LOST, SEARCHING, Event, StatusMachine
from tracker.target_config import TargetConfig
from tracker.watch import Sight, Watch

__all__ = ["TargetConfig", "TargetTracker"]

ELLIPSE_SIGMAS = 2.0  # the ellipse that must stay inside the search region: 86 % of a plane's Gaussian
MAX_HINT_SCALE = 2.0  # of targets at random places in a window, 90 % were found at scale 1, 49 % at 2, 6 % at 2.8
MAX_NUDGE_S = 1.0  # a hand on a picture that is older moves another one
CONFIDENCE_DECAY_S = 0.5  # confidence of an unseen target falls by e in this time: 5 % at the end of a 1.5 s coast


class TargetTracker:
    """Raises only in `start` and `nudge`; in the loop every trouble becomes a reason."""

    def __init__(
        self,
        config: TargetConfig | None = None,
        filter_config: FilterConfig | None = None,
        confidence: ConfidenceModel | None = None,
    ) -> None:
        self._config = config or TargetConfig()
        self._filter = BoxFilter(filter_config)
        self._model = confidence or UNFITTED
        self._machine = StatusMachine(self._config.status)
        self._rest_reason = TargetReason.NOT_STARTED
        self._t_s: float | None = None
        self._image_size_px: tuple[float, float] | None = None
        self._reference = Reference()
        self._look_of = Likeness(self._config, self._reference)
        self._run = AgreeingRun()
        self._sizes = SizeMemory()
        self._admission = Admission(self._config, self._model, self._reference, self._look_of, self._sizes)
        self._rivals = RivalTracks(filter_config=filter_config)
        self._plan = SearchPlan()
        self._watch = Watch()
        self._chosen: Judged | None = None
        self._outlier: Box | None = None
        self._memory: MemoryWrite | None = None
        self._planned: PlannedSearch | None = None
        self._forget()

    def start(self, box: Box, t_s: float) -> TargetState:
        """Take a new target, selected in the picture of `t_s` (monotonic s). Raises ValueError for bad box or time."""
        self._filter.start(box, t_s)
        self._machine.happen(Event.STARTED, t_s)
        self._t_s = t_s
        self._forget()
        return self._report(TargetReason.SELECTED)

    def nudge(self, box: Box, t_s: float) -> TargetState:
        """The operator moves or resizes the box of a live track, in the picture of `t_s`; a lock goes on.

        What is not LOCKED is selected anew by it. Raises ValueError when nothing is tracked, or box or time are
        unusable; the track then goes on as it was.
        """
        if self._machine.status in AT_REST:
            raise ValueError("there is no track to nudge: select a target first")
        if not usable_box(box):
            raise ValueError(f"box {box} cannot be taken: not finite, or of a size or place no picture holds")
        if self._t_s is not None and not 0.0 <= t_s - self._t_s <= MAX_NUDGE_S:
            raise ValueError(f"nudge at {t_s} s: must be the time of the last picture ({self._t_s} s) or soon after")
        if self._machine.status is not LOCKED:
            return self.start(box, t_s)
        self._filter.predict(t_s)
        self._filter.nudge(box)
        self._t_s = t_s
        self._forget_step()
        self._planned = None
        self._watch.reset(t_s)
        self._rivals.clear()
        self._reference.clear()  # what it looked like was that of another box
        self._look_of.clear()
        self._sizes.clear()
        self._run.clear()
        return self._report(TargetReason.SELECTED)

    def stop(self, t_s: float) -> TargetState:
        """Drop the target. Always works; a time that is not finite or went back is not taken."""
        if math.isfinite(t_s) and (self._t_s is None or t_s > self._t_s):
            self._t_s = t_s
        self._machine.happen(Event.STOPPED, t_s)
        self._rest_reason = TargetReason.STOPPED
        self._forget()
        return self._report(TargetReason.STOPPED)

    def step(self, candidates: Sequence[Candidate], t_s: float, image_size_px: tuple[float, float]) -> TargetState:
        """Take what was found in the picture of `t_s` (monotonic s), of size (width, height).

        A time that went back, or a time or image size that is not finite, holds everything; a LOCKED target is then
        reported as COASTING, for it was not seen in this step, and the state keeps its old `t_s`.
        """
        refusal = self._refusal(t_s, image_size_px)
        if refusal is not None:
            held = self._report(refusal, COASTING if self._machine.status is LOCKED else None)
            return replace(held, chosen=None, memory=None, confidence=0.0)
        self._t_s, self._image_size_px = t_s, image_size_px
        self._forget_step()
        if self._machine.status in AT_REST:
            return self._report(self._rest_reason)
        if self._machine.status is LOCKED:
            self._moves = self._sizes.is_moving(math.inf)
        self._filter.predict(t_s)
        expired = self._machine.expire(t_s, self._moves, self._ellipse_share(self._filter.box, self._filter.cov) > 1.0)
        if self._machine.status is LOST:
            self._rest_reason = TargetReason.GAVE_UP
            self._forget()
            return self._report(TargetReason.GAVE_UP)
        if expired is not None:
            self._plan.reset()
        reason = self._look(candidates, t_s)
        if self._machine.status is SEARCHING:
            self._plan_search(t_s)
        return self._report(reason if expired is None or self._machine.status is LOCKED else expired)

    def hint(self, t_s: float | None = None) -> SearchHint | None:
        """Where to search in the picture of `t_s` (default: at the last step's time); None while IDLE or LOST.

        The centre is held inside the last picture; `scale` widens the search until it holds the 2-sigma ellipse. A
        strong candidate outside the gate is looked at once more in the next picture, in a window of its own. While
        SEARCHING the search plan says where.
        """
        if self._machine.status in AT_REST:
            return None
        box, cov = self._filter.ahead(self._filter.t_s if t_s is None else t_s)
        cov_px2 = (float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1]))
        sized = box if self._chosen is None else self._chosen.candidate.box
        size_px = (sized.w_px, sized.h_px)
        calls = self._config.max_calls
        if self._machine.status is SEARCHING and self._planned is not None:
            plan = self._planned
            return SearchHint(plan.center_px, cov_px2, plan.scale, calls, size_px, plan.tiles)
        cx, cy = box.cx_px, box.cy_px
        if self._image_size_px is not None:
            cx, cy = (min(max(v, 0.0), side) for v, side in zip((cx, cy), self._image_size_px, strict=True))
        scale = min(max(self._ellipse_share(box, cov), 1.0), MAX_HINT_SCALE)
        tiles = () if self._outlier is None else (SearchTile((self._outlier.cx_px, self._outlier.cy_px)),)
        if tiles and calls == 1:
            (cx, cy), tiles = tiles[0].center_px, ()
        return SearchHint((cx, cy), cov_px2, scale, calls, size_px, tiles, self._is_sure())

    def shift(self, dx_px: float, dy_px: float) -> bool:
        """Move the estimate with the picture (ego-motion); False, and nothing moved, when idle or not finite."""
        if self._machine.status in AT_REST or not self._filter.shift(dx_px, dy_px):
            return False
        for part in (self._run, self._sizes, self._rivals, self._plan, self._watch):
            part.shift(dx_px, dy_px)
        if self._outlier is not None:
            self._outlier = _moved(self._outlier, dx_px, dy_px)
        if self._planned is not None:
            self._planned = self._planned.shifted(dx_px, dy_px)
        return True

    def _forget(self) -> None:
        """Nothing of an earlier target."""
        self._confidence, self._used_s = 0.0, 0.0
        self._moves = self._admission.covered = False
        self._forget_step()
        self._planned = None
        self._active: tuple[TargetAlarm, ...] = ()
        self._sizes.places_hold = False
        self._reference.clear()
        self._look_of.clear()
        self._run.clear()
        self._sizes.clear()
        self._rivals.clear()
        self._plan.reset()
        self._watch.reset(0.0 if self._t_s is None else self._t_s)

    def _forget_step(self) -> None:
        """Nothing of the picture before."""
        self._chosen, self._outlier, self._memory = None, None, None

    def _refusal(self, t_s: float, image_size_px: tuple[float, float]) -> TargetReason | None:
        if not math.isfinite(t_s) or not all(math.isfinite(v) and v > 0 for v in image_size_px):
            return TargetReason.NOT_FINITE
        if self._t_s is not None and t_s < self._t_s:
            return TargetReason.TIME_WENT_BACK
        return None

    def _look(self, candidates: Sequence[Candidate], t_s: float) -> TargetReason:
        """Choose among the candidates and move the status by what was seen."""
        judged = judge_all(candidates, self._filter, self._model, self._reference)
        self._rivals.predict(t_s)
        mine = self._rivals.unclaimed(judged, self._filter, self._machine.status in (ACQUIRING, LOCKED))
        best = associate(mine, self._config.association)
        if not judged:
            reason = self._miss(TargetReason.NOT_FINITE if candidates else TargetReason.NO_CANDIDATE, t_s)
        elif best is None:
            reason = self._miss(TargetReason.AMBIGUOUS, t_s)
        elif self._machine.status is SEARCHING:
            reason = self._reacquire(mine, best, t_s)
        else:
            reason = self._take(best, t_s)
        sure = self._machine.status is LOCKED and self._confidence >= self._config.status.drop_confidence
        self._rivals.step(judged, self._chosen, sure)
        return self._observe(candidates, reason, t_s)

    def _reacquire(self, judged: Sequence[Judged], best: Judged, t_s: float) -> TargetReason:
        """Found again is what looks like this target in the same place for `reacquire_s`; `best` fits it best."""
        now = self._moment(t_s)
        self._outlier = next((j.candidate.box for j in judged if self._admission.is_worth_a_look(j)), None)
        found, reason = self._admission.found(judged, now.unseen_s)
        if reason is not TargetReason.SHAPE_COLLAPSE and self._admission.may_move(best, now):
            self._filter.update(best.candidate.box, best.probability)
        if not found:
            return self._miss(reason, t_s)
        best = max(found, key=lambda j: j.total(self._config.association.motion_weight))
        self._run.add(best.candidate.box, t_s)
        self._outlier = best.candidate.box
        if not self._run.lasted(self._config.status.reacquire_s) or not was_compared(best.candidate):
            return TargetReason.CONFIRMING
        self._filter.start(best.candidate.box, t_s)
        self._sizes.clear()
        self._lock(best, best.appearance, Event.CONFIRMED, t_s)
        return TargetReason.REACQUIRED

    def _take(self, best: Judged, t_s: float) -> TargetReason:
        """Let the chosen candidate into the estimate, if it is good enough for the status."""
        now = self._moment(t_s)
        reason = self._admission.refuses(best, now)
        if reason is not None:
            if self._admission.may_move(best, now):
                self._filter.update(best.candidate.box, best.probability)
            return self._miss(reason, t_s)
        long = now.unseen_s > self._config.status.trust_s + TIME_EPS_S
        if now.status is COASTING and long and not self._is_settled(best, t_s):
            return TargetReason.CONFIRMING
        update = self._filter.update(best.candidate.box, best.probability if best.inside else best.appearance)
        if not update.accepted:
            self._outlier = best.candidate.box
            return self._miss(TargetReason.INNOVATION_GATE, t_s)
        relocated = update.reason is UpdateReason.RELOCATED
        return self._seen(best, best.appearance if relocated else best.probability, relocated, t_s)

    def _moment(self, t_s: float) -> Moment:
        return Moment(t_s, self._machine.status, t_s - self._machine.seen_s, self._filter.box)

    def _is_settled(self, best: Judged, t_s: float) -> bool:
        """Whether what is seen may end a long coast: what comes out from behind something need not be what went in."""
        self._run.add(best.candidate.box, t_s)
        self._outlier = best.candidate.box
        return self._run.lasted(self._config.status.resume_s) and was_compared(best.candidate)

    def _seen(self, best: Judged, probability: float, relocated: bool, t_s: float) -> TargetReason:
        """A candidate entered the estimate: what that means for the status."""
        status = self._config.status
        if self._machine.status is ACQUIRING:
            return self._confirm(best, probability, t_s)
        sustains = self._machine.status is LOCKED and probability >= status.drop_confidence
        if sustains or probability >= status.lock_confidence:
            self._lock(best, probability, Event.SEEN, t_s)
            return TargetReason.REACQUIRED if relocated else TargetReason.SEEN
        was = self._machine.status
        self._use(best, probability, t_s)
        if self._machine.weak(t_s) is LOCKED:
            return TargetReason.SEEN
        return self._leave(self._admission.doubt(best)) if was is LOCKED else self._admission.doubt(best)

    def _confirm(self, best: Judged, probability: float, t_s: float) -> TargetReason:
        self._use(best, probability, t_s)
        self._machine.happen(Event.SEEN, t_s)
        if probability < self._config.status.lock_confidence:
            self._run.clear()
            return self._admission.doubt(best)
        self._run.add(best.candidate.box, t_s)
        if not self._run.lasted(self._config.status.confirm_s):
            return TargetReason.CONFIRMING
        self._lock(best, probability, Event.CONFIRMED, t_s)
        return TargetReason.CONFIRMED

    def _lock(self, best: Judged, probability: float, event: Event, t_s: float) -> None:
        self._machine.happen(event, t_s)
        self._use(best, probability, t_s)
        self._run.clear()
        self._sizes.add(self._filter.state(), exemplar_of(best.candidate))
        self._look_of.seen(best.candidate, t_s)
        self._reference.add(best.candidate, t_s)

    def _use(self, best: Judged, probability: float, t_s: float) -> None:
        """A candidate is in the estimate."""
        self._chosen, self._confidence, self._used_s = best, probability, t_s

    def _miss(self, reason: TargetReason, t_s: float) -> TargetReason:
        """Not seen in this step."""
        self._run.clear()
        if self._machine.status is LOCKED:
            self._machine.happen(Event.MISSED, t_s)
            reason = self._leave(reason)
        return reason if self._in_view() else TargetReason.OUT_OF_FRAME

    def _leave(self, reason: TargetReason) -> TargetReason:
        """The lock is over: go on from what the target was before it was covered, at its velocity if it had one."""
        before = self._sizes.before_collapse()
        self._moves = self._sizes.is_moving(before.t_s if before is not None else math.inf)
        self._sizes.clear()
        self._admission.covered = before is not None or reason is TargetReason.SHAPE_COLLAPSE
        if before is not None:
            reason = TargetReason.SHAPE_COLLAPSE
            if self._sizes.places_hold:
                self._filter.rewind(before)
            else:  # the camera's motion is not known: a place in an older picture is no place in this one
                self._filter.resize(before)
        if not self._moves:
            self._filter.halt()
        return reason

    def _observe(self, candidates: Sequence[Candidate], reason: TargetReason, t_s: float) -> TargetReason:
        """Alarms, and what should be remembered of this picture. A false lock ends the lock."""
        assert self._image_size_px is not None
        seen = Sight(
            t_s,
            locked=self._machine.status is LOCKED,
            confidence=self._confidence,
            candidates=candidates,
            chosen=self._chosen,
            estimate=self._filter,
            image_size_px=self._image_size_px,
            ego_known=self._sizes.places_hold,
            alike=self._chosen is None or self._look_of.may_be_kept(self._chosen.candidate),
        )
        self._active, self._memory = self._watch.step(seen)
        if TargetAlarm.FALSE_LOCK in self._active and seen.locked:
            self._machine.happen(Event.FALSE_LOCK, t_s)
            self._plan.reset()
            self._watch.end_of_lock()
            self._rivals.clear()  # what was seen beside a false lock may be the target
            self._chosen, self._confidence = None, 0.0
            return TargetReason.FALSE_LOCK
        return reason

    def _plan_search(self, t_s: float) -> None:
        """Where the next picture is searched; a place where something was seen a moment ago is looked at again."""
        assert self._image_size_px is not None
        f, unseen_s = self._filter, t_s - self._machine.seen_s
        cov_px2 = (float(f.cov[0, 0]), float(f.cov[0, 1]), float(f.cov[1, 1]))
        again = () if self._outlier is None else (SearchTile((self._outlier.cx_px, self._outlier.cy_px)),)
        if again and self._config.max_calls == 1:
            self._planned = PlannedSearch(again[0].center_px, 1.0, (), SearchStage.REGION)
            return
        calls = self._config.max_calls - len(again)
        plan = self._plan.step(f.box, cov_px2, self._image_size_px, unseen_s, calls, t_s)
        if again:
            plan = replace(plan, tiles=(*again, *plan.tiles))
        self._planned = plan

    def _is_sure(self) -> bool:
        """Whether the target is slow and its place well known."""
        c, f = self._config, self._filter
        if self._machine.status is not LOCKED or self._confidence < c.sure_confidence or self._active:
            return False
        size_px = math.sqrt(f.box.w_px * f.box.h_px)
        return math.hypot(*f.vel_px_s) < c.sure_sizes_s * size_px

    def _in_view(self) -> bool:
        box, size = self._filter.box, self._image_size_px
        return size is None or (0.0 <= box.cx_px <= size[0] and 0.0 <= box.cy_px <= size[1])

    def _ellipse_share(self, box: Box, cov: Array) -> float:
        """Half the long axis of the centre's 2-sigma ellipse, as a share of half the search crop."""
        xx, xy, yy = float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1])
        largest_px2 = (xx + yy) / 2 + math.hypot((xx - yy) / 2, xy)
        half_px = self._config.search_half_sizes * math.sqrt(box.w_px * box.h_px)
        return ELLIPSE_SIGMAS * math.sqrt(largest_px2) / half_px

    def _report(self, reason: TargetReason, status: TargetStatus | None = None) -> TargetState:
        """The state as control sees it; confidence is that of the last accepted candidate, decayed with the time."""
        status = self._machine.status if status is None else status
        t_s = 0.0 if self._t_s is None else self._t_s
        if status in AT_REST:
            return TargetState(t_s, status, reason, None, (0.0, 0.0), 0.0, None, 0.0)
        confidence = self._confidence * math.exp(-max(t_s - self._used_s, 0.0) / CONFIDENCE_DECAY_S)
        f, chosen = self._filter, self._chosen.candidate if self._chosen is not None else None
        return TargetState(
            t_s,
            status,
            reason,
            f.box,
            f.vel_px_s,
            f.growth_per_s,
            f.cov,
            confidence,
            self._active,
            chosen,
            self._memory,
        )


def _moved(box: Box, dx_px: float, dy_px: float) -> Box:
    return replace(box, cx_px=box.cx_px + dx_px, cy_px=box.cy_px + dy_px)
