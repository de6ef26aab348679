"""The geometry camera's measurement errors: from what is true in a picture to what a tracker would have said of it.

No pixels: candidates come from the truth by parameters, so a run takes seconds. A tracker's faults that the rest of
the application must live with are all here: bias and noise of the box, a box that shrinks to the visible part, a score
that falls with visibility, pictures without a find, clutter, and a look-alike taken for the target.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from sitl.scene import ObjectTruth
from tracker.box import Box

# Sum of sines with unit sigma: three are enough to look random over a run of a minute.
_WANDER_SINES = 3
_MICROSECOND = 1e-6


@dataclass(frozen=True, slots=True)
class MeasuredBox:
    """A find: box in continuous pixels, score from 0 to 1."""

    box: Box
    score: float


@dataclass(frozen=True, slots=True)
class MeasurementParams:
    """Sizes of the errors; shares are of the target's width and height. Raises ValueError naming field and range.

    The defaults are those of a good tracker on a target of some 60 px: success AUC about 0.75 while in sight.
    """

    whole_above: float = 0.85  # from this visibility on the box is that of the whole silhouette
    found_above: float = 0.25  # below this visibility the target is not recognised
    bias_share: float = 0.03  # sigma of a constant offset: where the clicked box sat on the target
    bias_size_share: float = 0.04  # sigma of a constant error of size, for the same reason
    white_share: float = 0.02  # a pixel at 50 px: the stride of the network is 8 px, interpolated
    white_size_share: float = 0.03
    wander_share: float = 0.03  # slow drift of the box over the target as it turns
    wander_size_share: float = 0.05
    wander_time_s: float = 1.5
    score_whole: float = 0.88  # of a target in full sight
    score_least: float = 0.42  # of one that is only just recognised: about the application's threshold to drop
    score_sigma: float = 0.04
    drop_share: float = 0.01  # pictures with nothing found though it is there
    search_half_sizes: float = 2.26  # reach of the search: half a crop of 287/127 of an exemplar of two sizes
    look_alike_score: float = 0.62  # of a look-alike in full sight: enough to lock on, less than the target itself
    look_alike_sigma: float = 0.12
    other_score: float = 0.2  # of a thing of another colour or kind
    clutter_share: float = 0.5  # pictures in which a hidden target's place shows something faintly like it
    clutter_score: float = 0.25
    clutter_sigma: float = 0.08

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            high = _HIGHEST.get(field.name, 1.0)
            low = _LOWEST.get(field.name, 0.0)
            if not low <= value <= high:
                raise ValueError(f"MeasurementParams.{field.name} = {value}: must lie in [{low:g}, {high:g}]")
        if self.found_above >= self.whole_above:
            raise ValueError("MeasurementParams.found_above: must be below whole_above")


_HIGHEST = {"wander_time_s": 60.0, "search_half_sizes": 50.0}
_LOWEST = {"wander_time_s": 0.05, "search_half_sizes": 0.5, "found_above": 0.01}

PERFECT = MeasurementParams(
    bias_share=0.0, bias_size_share=0.0, white_share=0.0, white_size_share=0.0, wander_share=0.0, wander_size_share=0.0,
    score_sigma=0.0, drop_share=0.0, look_alike_sigma=0.0, clutter_share=0.0, clutter_sigma=0.0,
)  # fmt: skip


class MeasurementModel:
    """Candidates of one run. A pure function of `seed` and the time of the picture: no call changes another.

    `look_alikes`: names of the objects that look like the target. `mirrored`: every error to the right is one to the
    left, as in a mirrored scenario.
    """

    def __init__(
        self,
        params: MeasurementParams | None = None,
        seed: int = 0,
        look_alikes: frozenset[str] = frozenset(),
        mirrored: bool = False,
    ) -> None:
        self._params = params or MeasurementParams()
        self._seed = seed
        self._look_alikes = look_alikes
        self._side = -1.0 if mirrored else 1.0
        rng = np.random.default_rng((seed, 0))
        self._bias = rng.standard_normal(4)
        spread = rng.uniform(0.5, 2.0, (4, _WANDER_SINES))
        self._omega = spread / self._params.wander_time_s
        self._phase = rng.uniform(0.0, math.tau, (4, _WANDER_SINES))

    def candidates(
        self,
        truths: Mapping[str, ObjectTruth],
        target: str,
        t_s: float,
        image_size_px: tuple[float, float],
        searched_px: Sequence[tuple[float, float]] = (),
    ) -> tuple[MeasuredBox, ...]:
        """What is found in the picture of `t_s` (s), best first; at most the target, one more thing and clutter.

        `searched_px`: centres of the windows that the tracker searches; empty: where the target is. Nothing is found
        beyond `search_half_sizes` of them, or with its centre outside of the picture; a wide window reaches no further
        than a narrow one. Raises KeyError for a target that is not in `truths`, ValueError for a time that is not
        finite.
        """
        if not math.isfinite(t_s):
            raise ValueError(f"t_s = {t_s}: must be finite")
        rng = np.random.default_rng((self._seed, 1, round(t_s / _MICROSECOND) % 2**63))
        # All drawn, whatever is used: what one thing does must not change the chance of another.
        normal, uniform = rng.standard_normal(10), rng.uniform(0.0, 1.0, 4)
        truth = truths[target]
        if truth.amodal is None or not truth.amodal.is_valid:
            return ()
        region = _Region(
            searched_px or ((truth.amodal.cx_px, truth.amodal.cy_px),), truth.amodal, self._params, image_size_px
        )
        found: list[MeasuredBox] = []
        own = self._of_target(truth, t_s, normal, uniform)
        if own is not None and region.holds(own.box):
            found.append(own)
        other = self._of_others(truths, target, region, normal)
        if other is not None:
            found.append(other)
        if own is None:
            found.extend(self._clutter(region, normal, uniform))
        return tuple(sorted(found, key=lambda m: -m.score))

    def _of_target(self, truth: ObjectTruth, t_s: float, normal: np.ndarray, uniform: np.ndarray) -> MeasuredBox | None:
        p = self._params
        seen = min(truth.visibility, 1.0 - truth.truncation)
        if seen < p.found_above or truth.visible is None or uniform[0] < p.drop_share:
            return None
        assert truth.amodal is not None
        whole = min(1.0, (seen - p.found_above) / (p.whole_above - p.found_above))
        box = _blend(truth.visible, truth.amodal, whole)
        score = p.score_least + (p.score_whole - p.score_least) * whole + p.score_sigma * float(normal[4])
        return MeasuredBox(self._disturbed(box, t_s, normal), _unit(score))

    def _disturbed(self, box: Box, t_s: float, normal: np.ndarray) -> Box:
        """The box with bias, slow wander and white noise."""
        p = self._params
        wander = np.sin(self._omega * t_s + self._phase).sum(axis=1) * math.sqrt(2.0 / _WANDER_SINES)
        place = p.bias_share * self._bias[:2] + p.wander_share * wander[:2] + p.white_share * normal[:2]
        size = p.bias_size_share * self._bias[2:] + p.wander_size_share * wander[2:] + p.white_size_share * normal[2:4]
        return Box(
            box.cx_px + self._side * float(place[0]) * box.w_px,
            box.cy_px + float(place[1]) * box.h_px,
            box.w_px * math.exp(float(size[0])),
            box.h_px * math.exp(float(size[1])),
        )

    def _of_others(
        self, truths: Mapping[str, ObjectTruth], target: str, region: _Region, normal: np.ndarray
    ) -> MeasuredBox | None:
        """The other thing in the search region that looks most like the target."""
        p = self._params
        best: MeasuredBox | None = None
        for name in sorted(truths):
            truth = truths[name]
            if name == target or truth.visible is None or truth.visibility < p.found_above:
                continue
            if not (region.holds(truth.visible) and region.fits(truth.visible)):
                continue
            likeness = p.look_alike_score if name in self._look_alikes else p.other_score
            score = _unit(likeness * min(1.0, truth.visibility / p.whole_above) + p.look_alike_sigma * float(normal[5]))
            if best is None or score > best.score:
                best = MeasuredBox(truth.visible, score)
        return best

    def _clutter(self, region: _Region, normal: np.ndarray, uniform: np.ndarray) -> list[MeasuredBox]:
        """Where the target should be, something faintly like it, anywhere in the search region."""
        p = self._params
        right, below = self._side * float(2.0 * uniform[2] - 1.0), float(2.0 * uniform[3] - 1.0)
        box = region.place(right, below, math.exp(0.2 * float(normal[6])))
        score = _unit(p.clutter_score + p.clutter_sigma * float(normal[7]))
        return [MeasuredBox(box, score)] if uniform[1] < p.clutter_share and region.holds(box) else []


class _Region:
    """Where is looked for a target of a given size."""

    def __init__(
        self,
        centres_px: Sequence[tuple[float, float]],
        size: Box,
        params: MeasurementParams,
        image_size_px: tuple[float, float],
    ) -> None:
        self._centres, self._size, self._image = centres_px, size, image_size_px
        self._half_px = params.search_half_sizes * math.sqrt(size.w_px * size.h_px)

    def holds(self, box: Box) -> bool:
        """Whether the centre of the box is in one of the windows and in the picture."""
        near = any(max(abs(box.cx_px - x), abs(box.cy_px - y)) <= self._half_px for x, y in self._centres)
        return near and 0.0 <= box.cx_px <= self._image[0] and 0.0 <= box.cy_px <= self._image[1]

    def fits(self, box: Box) -> bool:
        """Whether its size is within half and twice that of the target: others are beyond the network's scales."""
        ratio = math.sqrt(box.w_px * box.h_px / (self._size.w_px * self._size.h_px))
        return 0.5 <= ratio <= 2.0

    def place(self, right: float, below: float, growth: float) -> Box:
        """A box of the target's size times `growth`, at shares from -1 to 1 of the first window."""
        return Box(
            self._centres[0][0] + right * self._half_px,
            self._centres[0][1] + below * self._half_px,
            self._size.w_px * growth,
            self._size.h_px * growth,
        )


def _blend(a: Box, b: Box, share_b: float) -> Box:
    share_a = 1.0 - share_b
    return Box(
        share_a * a.cx_px + share_b * b.cx_px,
        share_a * a.cy_px + share_b * b.cy_px,
        share_a * a.w_px + share_b * b.w_px,
        share_a * a.h_px + share_b * b.h_px,
    )


def _unit(value: float) -> float:
    return min(1.0, max(0.0, value))
