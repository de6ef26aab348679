"""What moves against the ground: class-free proposals from pictures of a moving camera.

Each picture is compared with two older ones, brought to it by the ground's motion (corners and optical flow, or what
the gyroscopes say). What differs from both moved: a place that was left differs only from the older of the two. Parts
that differ are joined to regions; regions that go on for some time become proposals, the steadiest first.

No clock and no network; about 10 ms a picture of one core at a working width of 480 px.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from tracker.box import Box
from tracker.messages import Array, ImageU8
from tracker.selection.ego_shift import Grey, estimate_motion, moved_points
from tracker.selection.ranking import Proposal, Reason, distinct

WORK_WIDTH_PX = 480  # wider pictures are made smaller: a proposal needs no sub-pixel border
BASELINE_S = 0.12  # between the pictures compared: what moves 10 px/s then moves by a pixel
KEEP_S = 0.6  # older pictures have drifted away from the chain of motions
LEAST_DIFFERENCE = 8.0  # grey levels beyond what a misfit of one pixel explains
NOISE_FACTOR = 5.0  # times the median difference: a noisy camera must not fill the list
PEAK_FACTOR = 1.75  # times that limit must be reached somewhere in a region: faint parts only belong to strong ones
CLOSE_SHARE = 0.02  # of the width: gaps inside of one thing (a roof of one colour) up to this are bridged
LEAST_SIDE_PX = 5  # of the working picture
LARGEST_SHARE = 0.25  # of the picture: larger "movers" are a ground that was not followed
MAX_DIFFERENT_SHARE = 0.35  # of the picture: then nothing of it is believed
MAX_REGIONS = 40
STEADY_S = 0.3  # a region seen for so long is a thing, not a flash
FORGET_S = 0.4  # a thing unseen for so long is no longer proposed
SIZE_BLEND_S = 0.15  # time constant by which the box follows the region: its outline flickers
LEAST_SCORE = 0.05  # below: faint, or gone already
JOIN_SIZES = 0.8  # a region this near to where a thing was, in its sizes, is that thing


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """A picture kept; `to_now` brings its pixels into the newest picture."""

    t_s: float
    grey: Grey
    to_now: Array


@dataclass(frozen=True, slots=True)
class _Mover:
    """A thing followed over pictures; `box` in working pixels."""

    box: Box
    first_s: float
    last_s: float
    seen: int
    steps: int
    strength: float


class MotionProposals:
    """Pictures in, proposals out; `step` in the order of time."""

    def __init__(self) -> None:
        self._kept: deque[_Seen] = deque()
        self._movers: list[_Mover] = []
        self._scale = 1.0
        self._shape = (0, 0)

    def step(
        self, image_bgr_u8: ImageU8, t_s: float, motion: Array | tuple[float, float] | None = None
    ) -> tuple[Proposal, ...]:
        """What moves in the picture of `t_s` (monotonic s), best first; empty for the first picture.

        `motion` is how the ground moved since the last picture, in px of the pictures: a shift (dx, dy), or a
        homography (3, 3) from the last picture to this one; None: it is estimated. Where it cannot be, for a picture
        of another size, or a time that is not finite or not later, everything starts afresh from this picture.
        """
        grey, scale = _working(image_bgr_u8)
        usable = math.isfinite(t_s) and grey.shape == self._shape and bool(self._kept) and t_s > self._kept[-1].t_s
        step = self._ground(grey, motion, scale) if usable else None
        if step is None:
            self._kept.clear()
            self._movers = []
            self._scale, self._shape = scale, grey.shape[:2]
            if math.isfinite(t_s):
                self._kept.append(_Seen(t_s, grey, np.eye(3)))
            return ()
        self._advance(step, t_s)
        regions = self._regions(grey, t_s)
        self._kept.append(_Seen(t_s, grey, np.eye(3)))
        self._join(regions, t_s)
        return self._proposals(t_s)

    def _ground(self, grey: Grey, motion: Array | tuple[float, float] | None, scale: float) -> Array | None:
        if motion is None:
            return estimate_motion(self._kept[-1].grey, grey)
        given = np.asarray(motion, dtype=np.float64)
        if not np.isfinite(given).all() or given.shape not in ((2,), (3, 3)):
            return estimate_motion(self._kept[-1].grey, grey)
        if given.shape == (2,):
            return np.array([[1.0, 0.0, given[0] * scale], [0.0, 1.0, given[1] * scale], [0.0, 0.0, 1.0]])
        resize = np.diag([scale, scale, 1.0])
        return np.asarray(resize @ given @ np.linalg.inv(resize))

    def _advance(self, step: Array, t_s: float) -> None:
        """Bring what is kept into the newest picture, and drop what is too old."""
        self._kept = deque(replace(s, to_now=step @ s.to_now) for s in self._kept if t_s - s.t_s <= KEEP_S)
        moved = []
        for mover in self._movers:
            centre = moved_points(step, np.array([[mover.box.cx_px, mover.box.cy_px]]))[0]
            if np.isfinite(centre).all():
                box = replace(mover.box, cx_px=float(centre[0]), cy_px=float(centre[1]))
                moved.append(replace(mover, box=box, steps=mover.steps + 1))
        self._movers = moved

    def _references(self, t_s: float) -> list[_Seen]:
        """The pictures nearest to one and to two baselines ago; one alone while there is no other."""
        found = [_nearest(self._kept, t_s - age) for age in (BASELINE_S, 2 * BASELINE_S)]
        return found[:1] if found[0] is found[1] else found

    def _regions(self, grey: Grey, t_s: float) -> list[tuple[Box, float]]:
        """Boxes in working pixels of what differs, with the mean difference."""
        differences = [_difference(grey, old) for old in self._references(t_s)] if self._kept else []
        if not differences:
            return []
        least = np.minimum.reduce(differences)
        limit = max(LEAST_DIFFERENCE, NOISE_FACTOR * float(np.median(least)))
        mask = (least > limit).astype(np.uint8)
        if mask.mean() > MAX_DIFFERENT_SHARE:
            return []
        side = 2 * max(1, round(CLOSE_SHARE * grey.shape[1])) + 1
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
        joined = cv2.morphologyEx(cv2.dilate(mask, np.ones((3, 3), np.uint8)), cv2.MORPH_CLOSE, kernel)
        return _boxes_of(np.asarray(joined, dtype=np.uint8), mask, least, PEAK_FACTOR * limit)

    def _join(self, regions: list[tuple[Box, float]], t_s: float) -> None:
        """Give each region to the thing it continues, the best overlap first; the rest are new things."""
        pairs = sorted(
            ((_affinity(m.box, box), i, k) for i, m in enumerate(self._movers) for k, (box, _) in enumerate(regions)),
            reverse=True,
        )
        taken: dict[int, int] = {}
        for affinity, i, k in pairs:
            if affinity > 0 and i not in taken and k not in taken.values():
                taken[i] = k
        kept = [
            _continued(m, *regions[taken[i]], t_s) if i in taken else m
            for i, m in enumerate(self._movers)
            if i in taken or t_s - m.last_s < FORGET_S
        ]
        new = [
            _Mover(box, t_s, t_s, 1, 1, strength)
            for k, (box, strength) in enumerate(regions)
            if k not in taken.values()
        ]
        self._movers = kept + new

    def _proposals(self, t_s: float) -> tuple[Proposal, ...]:
        found = []
        for m in self._movers:
            steady = min((m.last_s - m.first_s) / STEADY_S, 1.0)
            seen = m.seen / m.steps
            strength = m.strength / (m.strength + 2 * LEAST_DIFFERENCE)
            fresh = max(1.0 - (t_s - m.last_s) / FORGET_S, 0.0)
            score = (0.25 + 0.75 * steady) * seen * strength * fresh
            box = self._held(m.box)
            if box is not None and m.seen > 1 and score >= LEAST_SCORE:
                found.append(Proposal(box, min(score, 1.0), Reason.MOVING))
        return distinct(sorted(found, key=lambda p: -p.score))

    def _held(self, box: Box) -> Box | None:
        """In px of the pictures, held inside; None when nothing of it is left."""
        height, width = self._shape
        # OpenCV's pixel centres are whole numbers, ours lie half a pixel further; regions are whole pixels anyway.
        x1, y1, x2, y2 = box.to_corners()
        inside = (max(x1, 0.0), max(y1, 0.0), min(x2, float(width)), min(y2, float(height)))
        if inside[2] - inside[0] < 1 or inside[3] - inside[1] < 1:
            return None
        return Box.from_corners(*(v / self._scale for v in inside))


def _nearest(kept: Iterable[_Seen], t_s: float) -> _Seen:
    return min(kept, key=lambda seen: abs(seen.t_s - t_s))


def _working(image: ImageU8) -> tuple[Grey, float]:
    width = image.shape[1]
    scale = min(1.0, WORK_WIDTH_PX / width)
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    if scale < 1.0:
        grey = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), 1.0), dtype=np.uint8), scale


def _difference(grey: Grey, old: _Seen) -> npt.NDArray[np.float32]:
    """By how much each pixel leaves the range of the old picture's 3 x 3 pixels there: a misfit of one is no motion."""
    size = (grey.shape[1], grey.shape[0])
    kernel = np.ones((3, 3), np.uint8)
    bright = cv2.warpPerspective(cv2.dilate(old.grey, kernel), old.to_now, size, borderMode=cv2.BORDER_CONSTANT)
    dark = cv2.warpPerspective(cv2.erode(old.grey, kernel), old.to_now, size, borderMode=cv2.BORDER_CONSTANT)
    seen = cv2.warpPerspective(np.full_like(grey, 255), old.to_now, size, borderMode=cv2.BORDER_CONSTANT)
    seen = cv2.erode(seen, np.ones((7, 7), np.uint8))
    over = np.maximum(cv2.subtract(grey, bright), cv2.subtract(dark, grey))  # saturating at 0
    return np.where(seen == 255, over, 0).astype(np.float32)


def _boxes_of(
    joined: npt.NDArray[np.uint8], mask: npt.NDArray[np.uint8], least: npt.NDArray[np.float32], peak: float
) -> list[tuple[Box, float]]:
    """Bounding boxes of the parts that differ inside of each joined region that reaches `peak`."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(joined, connectivity=8)
    order = sorted(range(1, count), key=lambda i: -int(stats[i, cv2.CC_STAT_AREA]))[:MAX_REGIONS]
    found = []
    for i in order:
        x, y, w, h = (int(v) for v in stats[i, :4])
        part = (labels[y : y + h, x : x + w] == i) & (mask[y : y + h, x : x + w] > 0)
        rows, columns = np.flatnonzero(part.any(axis=1)), np.flatnonzero(part.any(axis=0))
        inside = least[y : y + h, x : x + w][part]
        if not rows.size or inside.max() < peak:
            continue
        box = Box.from_corners(
            float(x + columns[0]), float(y + rows[0]), float(x + columns[-1] + 1), float(y + rows[-1] + 1)
        )
        if min(box.w_px, box.h_px) < LEAST_SIDE_PX or box.w_px * box.h_px > LARGEST_SHARE * mask.size:
            continue
        found.append((box, float(inside.mean())))
    return found


def _affinity(thing: Box, region: Box) -> float:
    """Above 0 where a region may continue a thing; larger is better."""
    size = math.sqrt(max(thing.w_px * thing.h_px, region.w_px * region.h_px))
    away = math.hypot(thing.cx_px - region.cx_px, thing.cy_px - region.cy_px) / size
    return thing.iou(region) + max(JOIN_SIZES - away, 0.0)


def _continued(mover: _Mover, box: Box, strength: float, t_s: float) -> _Mover:
    share = 1.0 - math.exp(-(t_s - mover.last_s) / SIZE_BLEND_S)
    w = mover.box.w_px + share * (box.w_px - mover.box.w_px)
    h = mover.box.h_px + share * (box.h_px - mover.box.h_px)
    blended = Box(box.cx_px, box.cy_px, w, h)
    return _Mover(
        blended, mover.first_s, t_s, mover.seen + 1, mover.steps,
        mover.strength + share * (strength - mover.strength),
    )  # fmt: skip
