"""SiamAPN++ as a tracker: exemplar once, then a search crop per frame around the last place or the filter's hint."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np

from tracker.box import Box
from tracker.engines import Engine
from tracker.messages import Array, Candidate, Frame, ImageU8, MemorySlot, SearchHint
from tracker.siamapnpp.candidates import Situation, candidates_of
from tracker.siamapnpp.colour import Weights, balance, describe
from tracker.siamapnpp.crop import EXEMPLAR_PX, CropGeometry, crop_square, exemplar_side_px
from tracker.siamapnpp.embedding import of_exemplar
from tracker.siamapnpp.memory import ExemplarMemory
from tracker.siamapnpp.merge import Found, merge
from tracker.siamapnpp.settings import TrackerSettings
from tracker.siamapnpp.windows import Window, hinted_size, places, windows

MIN_TARGET_PX = 4.0  # a smaller box fills less than one cell of the exemplar's features
ECONOMY_PX = 223  # 13 x 13 cells: the centre may move by three quarters of a target from one picture to the next


class SiamAPNTracker:
    """Implements `tracker.messages.Tracker` and `RemembersExemplars` on any engine.

    State: centre, size, first frame's mean colour, time of the last frame, looks and colours of the target.
    """

    def __init__(self, engine: Engine, settings: TrackerSettings) -> None:
        self._engine = engine
        self._settings = settings
        self._memory = ExemplarMemory()
        self._centre_px = (0.0, 0.0)
        self._size_px = (0.0, 0.0)
        self._fill_bgr = (0.0, 0.0, 0.0)
        self._t_s = 0.0
        self._started = False

    def init(self, frame: Frame, box: Box) -> None:
        """Take the exemplar. Raises ValueError when the box is not valid, below 4 px or outside the frame."""
        image = _checked(frame.image_bgr_u8)
        check_box(box, image.shape[1], image.shape[0])
        blue, green, red, _ = cv2.mean(image)
        self._fill_bgr = (blue, green, red)
        self._centre_px, self._size_px = (box.cx_px, box.cy_px), (box.w_px, box.h_px)
        features = self._engine.set_exemplar(self._exemplar_crop(box, image))
        look = None if features is None else of_exemplar(features)
        self._memory.start(look, describe(image, box, balance(image)))
        self._t_s = frame.t_capture_s
        self._started = True

    def update(self, frame: Frame, hint: SearchHint | None = None) -> tuple[Candidate, ...]:
        """Candidates in this frame, best first; empty when the network's output holds nothing finite.

        With a hint the search window is centred there and scaled by it, and its size is taken over; further windows are
        searched as it says, and the candidates of all become one list. Without one the window stays at the last place.
        Raises RuntimeError before `init`, ValueError when the picture is not a BGR uint8 image.
        """
        if not self._started:
            raise RuntimeError("update() before init(): the tracker has no exemplar yet")
        image = _checked(frame.image_bgr_u8)
        self._size_px = hinted_size(hint) or self._size_px
        image_size_px = (float(image.shape[1]), float(image.shape[0]))
        now = Situation(self._size_px, image_size_px, frame.t_capture_s - self._t_s)
        sure_px = ECONOMY_PX if self._settings.economy else None
        planned = windows(hint, self._centre_px, self._size_px, self._settings.search_px, sure_px)
        found = [self._search(image, window, now) for window in planned]
        self._t_s = frame.t_capture_s
        self._follow(planned[0], found[0], places(hint))
        candidates = merge(found, self._settings.max_candidates)
        looks, factors = self._settings.embed_candidates, balance(image)
        looked_at = (*(self._looked_at(c, image) for c in candidates[:looks]), *candidates[looks:])
        return tuple(self._with_colour(c, image, factors) for c in looked_at)

    def remember(self, frame: Frame, box: Box, slot: MemorySlot) -> None:
        """Keep how the box of this frame looks. Raises ValueError as `init` does, RuntimeError before it."""
        if not self._started:
            raise RuntimeError("remember() before init(): there is no target yet")
        image = _checked(frame.image_bgr_u8)
        check_box(box, image.shape[1], image.shape[0])
        self._memory.keep(self._look(box, image), slot, describe(image, box, balance(image)))

    def _search(self, image: ImageU8, window: Window, now: Situation) -> list[Found]:
        """One call of the network: its candidates, best first."""
        maps = self._engine.search(crop_square(image, window.geometry, self._fill_bgr))
        return candidates_of(maps, window, now, self._settings, self._memory.likeness)

    def _follow(self, window: Window, found: list[Found], hinted: bool) -> None:
        """Where to search next when nothing else is said. A hint knows the place better than the best candidate."""
        if found:
            best = found[0].candidate.box
            self._centre_px, self._size_px = (best.cx_px, best.cy_px), (best.w_px, best.h_px)
        if hinted:
            self._centre_px = (window.geometry.cx_px, window.geometry.cy_px)

    def _looked_at(self, candidate: Candidate, image: ImageU8) -> Candidate:
        """With its likeness to the memory: one small call of the network where the search did not show it."""
        evidence = candidate.evidence
        if evidence is None or evidence.exemplar is not None or not self._memory.has_first:
            return candidate
        exemplar, recent = self._memory.likeness(self._look(candidate.box, image))
        return replace(candidate, evidence=replace(evidence, exemplar=exemplar, recent=recent))

    def _with_colour(self, candidate: Candidate, image: ImageU8, factors: Weights) -> Candidate:
        evidence = candidate.evidence
        if evidence is None:
            return candidate
        colour = self._memory.colour_likeness(describe(image, candidate.box, factors))
        return replace(candidate, evidence=replace(evidence, colour=colour))

    def _look(self, box: Box, image: ImageU8) -> Array | None:
        features = self._engine.embed(self._exemplar_crop(box, image))
        return None if features is None else of_exemplar(features)

    def _exemplar_crop(self, box: Box, image: ImageU8) -> ImageU8:
        side = exemplar_side_px(box.w_px, box.h_px)
        return crop_square(image, CropGeometry(box.cx_px, box.cy_px, side, EXEMPLAR_PX), self._fill_bgr)


def check_box(box: Box, width_px: int, height_px: int) -> None:
    """Raise ValueError, saying why, when a box cannot start a track in a frame of this size."""
    if not all(math.isfinite(v) for v in (box.cx_px, box.cy_px, box.w_px, box.h_px)):
        raise ValueError("box has a value that is not a finite number")
    if box.w_px < MIN_TARGET_PX or box.h_px < MIN_TARGET_PX:
        raise ValueError(f"box is {box.w_px:g} x {box.h_px:g} px; each side must be at least {MIN_TARGET_PX:g} px")
    x1, y1, x2, y2 = box.to_corners()
    if x1 < 0 or y1 < 0 or x2 > width_px or y2 > height_px:
        raise ValueError(
            f"box {x1:g},{y1:g} to {x2:g},{y2:g} lies outside the frame of {width_px} x {height_px} px (even partly)"
        )


def _checked(image: ImageU8) -> ImageU8:
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or min(image.shape[:2]) < 1:
        raise ValueError(f"a frame must be a BGR uint8 image of shape (H, W, 3), got {image.dtype} {image.shape}")
    return image
