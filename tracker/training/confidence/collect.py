"""Samples for the confidence: a tracker follows, drifts and is probed over sequences with truth.

Following is as in flight: the box filter predicts, the tracker searches there, what the gate accepts moves the filter.
Now and then the same picture is searched again, without any trace left in tracker or filter: in a window where the
target is not, and in one somewhere around it, as a coast of up to two seconds would have it. Both judge the motion by
the filter's own prediction of that time, so an innovation means the same as in flight.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from tracker.box import Box
from tracker.confidence.features import Motion, features
from tracker.confidence.reference import Reference
from tracker.filter import BoxFilter
from tracker.messages import Candidate, Frame, ImageU8, MemorySlot, RemembersExemplars, SearchHint, Tracker
from tracker.siamapnpp.crop import EXEMPLAR_PX, exemplar_side_px
from tracker.training.confidence.places import absent_place, displaced, other_picture, search_place
from tracker.training.confidence.samples import ON_TARGET_IOU, Sample, SampleKind
from tracker.training.types import Footage
from tracker.training.validate import FRAMES_PER_S, Tracks, picture_of, start_box

SEARCH_PX = 287  # the usual search crop beside an exemplar of EXEMPLAR_PX
PROBE_EVERY = 4  # frames between probes: neighbours in time tell the same
EVERY = (1, 3)  # tracks in turn see every frame or every third one: an innovation must mean the same at both rates
DRIFT_S = 3.0  # what the tracker does longer off the target is always the same
SURE_SCORE = 0.55  # what counts as confirmed before there is a confidence: `TargetConfig.lock_score`
REMEMBER_S = 1.0  # between exemplars kept while sure
COAST_MAX_S = 2.0  # the time that a probe lets the prediction run ahead: a coast and some searching
SCALES = (1.0, 1.0, 1.5, 2.0)  # of a probe's window, drawn evenly: most searches are of normal size


@dataclass(frozen=True, slots=True, eq=False)
class Collector:
    """How to collect: `make_tracker` gives a tracker for each track, `others` are pictures without its target."""

    make_tracker: Callable[[], Tracker]
    tracks: Tracks
    others: Sequence[Footage]
    rng: np.random.Generator
    should_stop: Callable[[], bool]

    def samples(self, footage: Footage) -> list[Sample] | None:
        """Of one sequence; None when it was stopped."""
        result: list[Sample] = []
        for frames in seen_frames(self.tracks, len(footage.truth)):
            found = self._track(footage, frames)
            if found is None:
                return None
            result += found
        return result

    def _track(self, footage: Footage, frames: range) -> list[Sample] | None:
        followed = _Followed(self.make_tracker())
        result: list[Sample] = []
        for step, index in enumerate(frames):
            if self.should_stop():
                return None
            image = picture_of(footage, index)
            if image is None:
                continue
            frame = Frame(image, index, index / FRAMES_PER_S, index / FRAMES_PER_S)
            truth = footage.truth[index]
            if not followed.started:
                box = start_box(truth, image)
                if box is not None:
                    followed.start(frame, box)
                continue
            if step % PROBE_EVERY == 0:
                result += self._probes(footage, followed, frame, truth)
            seen = followed.step(frame, truth)
            if seen is not None:
                result.append(_sample(footage.name, seen, followed.kind, truth, followed.reference))
        return result

    def _probes(self, footage: Footage, followed: _Followed, frame: Frame, truth: Box | None) -> Iterator[Sample]:
        """Both kinds, before the picture is searched in earnest; the second only where the target is."""
        coast_s, scale = float(self.rng.uniform(0.0, COAST_MAX_S)), float(self.rng.choice(SCALES))
        prior = followed.ahead(frame.t_capture_s, coast_s)
        absent = self._absent(footage, frame.image_bgr_u8, truth, prior.box, scale)
        seen = followed.probe(frame, absent, prior, scale) if absent is not None else None
        if seen is not None:
            yield _sample(footage.name, seen, SampleKind.ABSENT, None, followed.reference)
        if truth is None or not truth.is_valid or followed.kind is SampleKind.DRIFT:
            return
        # The picture is moved so that the target lies where the prediction's own uncertainty may have it.
        window_px = search_window_px(prior.box) * scale
        dx, dy = search_place(self.rng, prior.cov, window_px)
        place = (truth.cx_px + dx, truth.cy_px + dy)
        moved, (ox, oy) = displaced(frame.image_bgr_u8, (prior.box.cx_px, prior.box.cy_px), place)
        seen = followed.probe(frame, moved, prior, scale)
        if seen is not None:
            there = Box(truth.cx_px + ox, truth.cy_px + oy, truth.w_px, truth.h_px)
            yield _sample(footage.name, seen, SampleKind.SEARCH, there, followed.reference)

    def _absent(self, footage: Footage, image: ImageU8, truth: Box | None, prior: Box, scale: float) -> ImageU8 | None:
        """A picture in which something else is where the prediction is: of this frame or another sequence."""
        window_px, centre = search_window_px(prior) * scale, (prior.cx_px, prior.cy_px)
        height, width = image.shape[:2]
        place = absent_place(self.rng, truth, centre, window_px, (width, height))
        others = [other for other in self.others if other.name != footage.name]
        if place is not None and (not others or self.rng.random() < 0.5):
            return displaced(image, centre, place)[0]
        return other_picture(self.rng, others, centre, (width, height)) if others else None


@dataclass(slots=True)
class _Seen:
    candidate: Candidate
    motion: Motion | None


@dataclass(slots=True)
class _Followed:
    """A tracker and its filter on one track."""

    tracker: Tracker
    filter: BoxFilter = field(default_factory=BoxFilter)
    reference: Reference = field(default_factory=Reference)
    started: bool = False
    kind: SampleKind = SampleKind.TRACK
    _lost_s: float | None = None
    _kept_s: float = 0.0

    def start(self, frame: Frame, box: Box) -> None:
        self.tracker.init(frame, box)
        self.filter.start(box, frame.t_capture_s)
        self.reference.clear()
        self.started, self.kind, self._lost_s, self._kept_s = True, SampleKind.TRACK, None, frame.t_capture_s

    def step(self, frame: Frame, truth: Box | None) -> _Seen | None:
        """The best candidate of a picture; ends the track when it was off the target for too long."""
        t_s = frame.t_capture_s
        self.filter.predict(t_s)
        found = self.tracker.update(frame, _hint(self.filter))
        if not found or found[0].evidence is None:
            return None
        best = found[0]
        seen = _Seen(best, Motion.of(self.filter, best.box, best.score))
        self._judge(_on_target(best.box, truth), t_s)
        accepted = self.filter.update(best.box, best.score).accepted
        if accepted and best.score >= SURE_SCORE:
            self.reference.add(best, t_s)
            self._remember(frame, best.box)
        return seen

    def ahead(self, t_s: float, coast_s: float) -> BoxFilter:
        """A copy of the filter as it would be after a coast."""
        prior = copy.deepcopy(self.filter)
        prior.predict(t_s + coast_s)
        return prior

    def probe(self, frame: Frame, image: ImageU8, prior: BoxFilter, scale: float) -> _Seen | None:
        """The best candidate of another picture at the predicted place; tracker and filter stay as they are."""
        other = Frame(image, frame.seq, frame.t_capture_s, frame.t_receive_s)
        found = copy.copy(self.tracker).update(other, _hint(prior, scale, (prior.box.w_px, prior.box.h_px)))
        if not found or found[0].evidence is None:
            return None
        return _Seen(found[0], Motion.of(prior, found[0].box, found[0].score))

    def _judge(self, on_target: bool, t_s: float) -> None:
        if on_target:
            self.kind, self._lost_s = SampleKind.TRACK, None
            return
        self._lost_s = t_s if self._lost_s is None else self._lost_s
        self.kind = SampleKind.DRIFT
        self.started = t_s - self._lost_s < DRIFT_S

    def _remember(self, frame: Frame, box: Box) -> None:
        if frame.t_capture_s - self._kept_s < REMEMBER_S or not isinstance(self.tracker, RemembersExemplars):
            return
        self._kept_s = frame.t_capture_s
        try:
            self.tracker.remember(frame, box, MemorySlot.RECENT)
        except ValueError:
            return  # partly outside of the picture: nothing to be kept


def seen_frames(tracks: Tracks, length: int) -> list[range]:
    """The frames of each track over a sequence of so many: as many as told, in turn at each rate of EVERY."""
    stretches = enumerate(tracks.stretches(length))
    steps = [(frames, EVERY[number % len(EVERY)]) for number, frames in stretches]
    return [range(f.start, min(length, f.start + len(f) * every), every) for f, every in steps]


def search_window_px(box: Box) -> float:
    """Side of the normal search window of a target."""
    return exemplar_side_px(box.w_px, box.h_px) * SEARCH_PX / EXEMPLAR_PX


def _hint(prior: BoxFilter, scale: float = 1.0, size_px: tuple[float, float] | None = None) -> SearchHint:
    box, cov = prior.box, prior.cov
    spread = (float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1]))
    return SearchHint((box.cx_px, box.cy_px), spread, scale, size_px=size_px)


def _sample(name: str, seen: _Seen, kind: SampleKind, truth: Box | None, reference: Reference) -> Sample:
    values = features(seen.candidate, seen.motion, reference)
    return Sample(name, kind, values, seen.candidate.score, _on_target(seen.candidate.box, truth))


def _on_target(box: Box, truth: Box | None) -> bool:
    return truth is not None and box.iou(truth) >= ON_TARGET_IOU
