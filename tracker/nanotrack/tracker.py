"""NanoTrack as a tracker: exemplar once, then a search crop per frame around the last place or the filter's hint."""

from __future__ import annotations

from typing import Protocol

import cv2

from tracker.box import Box
from tracker.messages import Candidate, Frame, ImageU8, SearchHint
from tracker.nanotrack.crop import crop_pixels
from tracker.nanotrack.decode import apart, decode, rank
from tracker.nanotrack.settings import NanoSettings
from tracker.siamapnpp.crop import EXEMPLAR_PX, CropGeometry, crop_square, exemplar_side_px
from tracker.siamapnpp.decode import Decoded, FloatMap, pick, shape_penalty
from tracker.siamapnpp.evidence import map_evidence, penalised_score
from tracker.siamapnpp.merge import Found, merge
from tracker.siamapnpp.tracker import check_box
from tracker.siamapnpp.windows import Window, hinted_size, places, windows

SEARCH_PX = 255
MAX_CROP_FRAMES = 2.0  # sides of the frame: the target fills half of it, and the published crop would cost 40 MB


class Session(Protocol):
    """Runs the two networks."""

    def features(self, crop_bgr_u8: ImageU8) -> FloatMap:
        """Of a crop (S, S, 3), S = 127 or 255: (C, S / 16, S / 16), rounded up."""

    def head(self, exemplar: FloatMap, search: FloatMap) -> tuple[FloatMap, FloatMap]:
        """Class logits (2, M, M) and box sides (4, M, M) from the features of both crops."""


class NanoTracker:
    """Implements `tracker.messages.Tracker` on any `Session`. State: exemplar, centre, size, first frame's colour."""

    def __init__(self, session: Session, settings: NanoSettings | None = None) -> None:
        self._session = session
        self._settings = settings or NanoSettings()
        self._exemplar: FloatMap | None = None
        self._centre_px = (0.0, 0.0)
        self._size_px = (0.0, 0.0)
        self._fill_bgr = (0.0, 0.0, 0.0)

    def init(self, frame: Frame, box: Box) -> None:
        """Take the exemplar. Raises ValueError when the box is not valid, below 4 px or outside the frame."""
        image = frame.image_bgr_u8
        check_box(box, image.shape[1], image.shape[0])
        blue, green, red, _ = cv2.mean(image)
        self._fill_bgr = (blue, green, red)
        self._centre_px, self._size_px = (box.cx_px, box.cy_px), (box.w_px, box.h_px)
        side_px = exemplar_side_px(box.w_px, box.h_px)
        self._exemplar = self._features(image, CropGeometry(box.cx_px, box.cy_px, side_px, EXEMPLAR_PX))

    def update(self, frame: Frame, hint: SearchHint | None = None) -> tuple[Candidate, ...]:
        """Candidates in this frame, best first; empty when the network's output holds nothing finite.

        With a hint the search window is centred there and scaled by it, and its size is taken over; its tiles are
        searched too. Without, the window stays at the last place. Raises RuntimeError before `init`.
        """
        if self._exemplar is None:
            raise RuntimeError("update() before init(): the tracker has no exemplar yet")
        self._size_px = hinted_size(hint) or self._size_px
        planned = windows(hint, self._centre_px, self._size_px, SEARCH_PX)
        found = [self._search(frame.image_bgr_u8, window, self._exemplar) for window in planned]
        self._follow(planned[0], found[0], places(hint))
        return merge(found, self._settings.max_candidates)

    def _follow(self, window: Window, found: list[Found], hinted: bool) -> None:
        """Where to search next when nothing else is said. A hint knows better than the best candidate."""
        if found:
            best = found[0].candidate.box
            self._centre_px, self._size_px = (best.cx_px, best.cy_px), (best.w_px, best.h_px)
        if hinted:
            self._centre_px = (window.geometry.cx_px, window.geometry.cy_px)

    def _search(self, image: ImageU8, window: Window, exemplar: FloatMap) -> list[Found]:
        """One call of the networks: its candidates, best first."""
        geometry, settings = window.geometry, self._settings
        decoded = decode(*self._session.head(exemplar, self._features(image, geometry, window.scale)))
        w, h = self._size_px[0] * geometry.scale, self._size_px[1] * geometry.scale
        penalty = shape_penalty(decoded, w, h, settings.penalty_k)
        ranked, plain = rank(decoded, penalty, settings.window), penalised_score(decoded, penalty)
        footprint = apart(w, h)
        footprint_px = (footprint[0] / geometry.scale, footprint[1] / geometry.scale)
        found = []
        for i in pick(decoded, ranked, footprint, settings.max_candidates):
            candidate = Candidate(
                box=self._box(decoded, i, geometry, float(plain[i]) * settings.size_lr, image),
                score=float(decoded.confidence[i]),
                peak=float(ranked[i]),
                similarity=float(decoded.similarity[i]),
                evidence=map_evidence(decoded, plain, i, footprint, (w, h), window.scale),
            )
            found.append(Found(candidate, float(plain[i]), footprint_px))
        return found

    def _features(self, image: ImageU8, geometry: CropGeometry, scale: float = 1.0) -> FloatMap:
        """The published crop for what the published tracker does; for wider windows ours, which costs no more then."""
        common = scale == 1.0 and geometry.side_px <= MAX_CROP_FRAMES * max(image.shape[:2])
        crop = crop_pixels if common else crop_square
        return self._session.features(crop(image, geometry, self._fill_bgr))

    def _box(self, decoded: Decoded, i: int, geometry: CropGeometry, rate: float, image: ImageU8) -> Box:
        height_px, width_px = (float(v) for v in image.shape[:2])
        floor_px = self._settings.floor_px
        w = (1.0 - rate) * self._size_px[0] + rate * float(decoded.w[i]) / geometry.scale
        h = (1.0 - rate) * self._size_px[1] + rate * float(decoded.h[i]) / geometry.scale
        return Box(
            cx_px=min(max(geometry.cx_px + float(decoded.cx[i]) / geometry.scale, 0.0), width_px),
            cy_px=min(max(geometry.cy_px + float(decoded.cy[i]) / geometry.scale, 0.0), height_px),
            w_px=min(max(w, floor_px), width_px),
            h_px=min(max(h, floor_px), height_px),
        )
