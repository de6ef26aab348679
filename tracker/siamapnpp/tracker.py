"""SiamAPN++ as a tracker: exemplar once, then a search crop per frame around the last place or the filter's hint."""

from __future__ import annotations

import math

import cv2
import numpy as np

from tracker.box import Box
from tracker.engines import Engine
from tracker.messages import Candidate, Frame, ImageU8, SearchHint
from tracker.siamapnpp.crop import EXEMPLAR_PX, CropGeometry, crop_square, exemplar_side_px
from tracker.siamapnpp.decode import Decoded, decode, pick, rank, shape_penalty
from tracker.siamapnpp.settings import TrackerSettings

MIN_TARGET_PX = 4.0  # a smaller box fills less than one cell of the exemplar's features
FLOOR_PX = 4.0  # the official floor of 10 px makes small targets grow at once
MAX_HINT_SCALE = 4.0  # beyond this the target has under 1/4 of the pixels that the exemplar was made from
HINT_STEP_SIDES = 0.5  # a hint may move the search window by at most half its side: it is a prediction, not a jump
MAX_HINT_SIZE_PX = 4096.0  # larger than any picture: a bound against nonsense


class SiamAPNTracker:
    """Implements `tracker.messages.Tracker` on any engine. State: centre, size and first frame's mean colour."""

    def __init__(self, engine: Engine, settings: TrackerSettings) -> None:
        self._engine = engine
        self._settings = settings
        self._centre_px = (0.0, 0.0)
        self._size_px = (0.0, 0.0)
        self._fill_bgr = (0.0, 0.0, 0.0)
        self._started = False

    def init(self, frame: Frame, box: Box) -> None:
        """Take the exemplar. Raises ValueError when the box is not valid, below 4 px or outside the frame."""
        image = _checked(frame.image_bgr_u8)
        check_box(box, image.shape[1], image.shape[0])
        blue, green, red, _ = cv2.mean(image)
        self._fill_bgr = (blue, green, red)
        self._centre_px, self._size_px = (box.cx_px, box.cy_px), (box.w_px, box.h_px)
        side = exemplar_side_px(box.w_px, box.h_px)
        crop = crop_square(image, CropGeometry(box.cx_px, box.cy_px, side, EXEMPLAR_PX), self._fill_bgr)
        self._engine.set_exemplar(crop)
        self._started = True

    def update(self, frame: Frame, hint: SearchHint | None = None) -> tuple[Candidate, ...]:
        """Candidates in this frame, best first; empty when the network's output holds nothing finite.

        With a hint the search window is centred there and scaled by it, and its size is taken over; without, it stays
        at the last place. Raises RuntimeError before `init`, ValueError when the picture is not a BGR uint8 image.
        """
        if not self._started:
            raise RuntimeError("update() before init(): the tracker has no exemplar yet")
        image = _checked(frame.image_bgr_u8)
        geometry = self._search_window(hint)
        maps = self._engine.search(crop_square(image, geometry, self._fill_bgr))
        decoded = decode(maps, self._settings)
        w, h = self._size_px[0] * geometry.scale, self._size_px[1] * geometry.scale
        penalty = shape_penalty(decoded, w, h, self._settings.penalty_k)
        ranked = rank(decoded, penalty, self._settings)
        chosen = pick(decoded, ranked, w, h, self._settings.max_candidates)
        found = [self._candidate(decoded, float(penalty[i]), float(ranked[i]), i, geometry, image) for i in chosen]
        if found:
            self._centre_px = (found[0].box.cx_px, found[0].box.cy_px)
            self._size_px = (found[0].box.w_px, found[0].box.h_px)
        return tuple(found)

    def _search_window(self, hint: SearchHint | None) -> CropGeometry:
        if hint is not None and hint.size_px is not None and all(math.isfinite(v) for v in hint.size_px):
            width_px, height_px = (min(max(v, FLOOR_PX), MAX_HINT_SIZE_PX) for v in hint.size_px)
            self._size_px = (width_px, height_px)
        side = exemplar_side_px(*self._size_px) * self._settings.search_px / EXEMPLAR_PX
        cx, cy, scale = *self._centre_px, 1.0
        if hint is not None and all(math.isfinite(v) for v in (*hint.center_px, hint.scale)):
            reach = HINT_STEP_SIDES * side * max(1.0, hint.scale)
            cx += min(max(hint.center_px[0] - cx, -reach), reach)
            cy += min(max(hint.center_px[1] - cy, -reach), reach)
            scale = min(max(hint.scale, 1.0), MAX_HINT_SCALE)
        return CropGeometry(cx, cy, side * scale, self._settings.search_px)

    def _candidate(
        self, decoded: Decoded, penalty: float, peak: float, i: int, geometry: CropGeometry, image: ImageU8
    ) -> Candidate:
        height, width = image.shape[:2]
        # The official rate is penalty * score * size_lr; its score is no probability, so the product is bounded here.
        rate = min(max(penalty * float(decoded.ranking[i]) * self._settings.size_lr, 0.0), 1.0)
        w = (1.0 - rate) * self._size_px[0] + rate * float(decoded.w[i]) / geometry.scale
        h = (1.0 - rate) * self._size_px[1] + rate * float(decoded.h[i]) / geometry.scale
        box = Box(
            cx_px=min(max(geometry.cx_px + float(decoded.cx[i]) / geometry.scale, 0.0), float(width)),
            cy_px=min(max(geometry.cy_px + float(decoded.cy[i]) / geometry.scale, 0.0), float(height)),
            w_px=min(max(w, FLOOR_PX), float(width)),
            h_px=min(max(h, FLOOR_PX), float(height)),
        )
        score = min(max(float(decoded.confidence[i]), 0.0), 1.0)
        return Candidate(box=box, score=score, peak=peak, similarity=float(decoded.similarity[i]))


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
