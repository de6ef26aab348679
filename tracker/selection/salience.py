"""Things that stand still but stand out: the places of a picture that differ most from what is round them."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.messages import ImageU8
from tracker.selection.click import propose
from tracker.selection.patch import Float32
from tracker.selection.ranking import MAX_PROPOSALS, Proposal, Reason, distinct
from tracker.selection.suitability import unsuitable

WORK_WIDTH_PX = 240  # places are looked for in so many pixels
SCALES_SHARE = (0.02, 0.04, 0.08)  # sizes of things sought, of the picture's width: from the air they are small
RING_FACTOR = 3.0  # side of the surroundings compared with
PLACES = 8  # clicked on: 90 ms each
SAME_IOU = 0.3  # two boxes that overlap more come from one thing clicked on twice
SAME_SHARE = 1.0  # a second place nearer than a thing's size is the same thing


def salient(image_bgr_u8: ImageU8, at_most: int = MAX_PROPOSALS) -> tuple[Proposal, ...]:
    """Boxes of suitable things that stand out, best first, distinct. Some 0.7 s of one core: no call for a loop."""
    found = []
    for point in _places(image_bgr_u8):
        best = next((p for p in propose(image_bgr_u8, point) if unsuitable(image_bgr_u8, p.box) is None), None)
        if best is not None:
            found.append(Proposal(best.box, best.score, Reason.SALIENT))
    return distinct(sorted(found, key=lambda p: -p.score), SAME_IOU, at_most)


def _places(image: ImageU8) -> list[tuple[float, float]]:
    """Points in px of the picture where middle and surroundings differ most, at any scale; the strongest first."""
    scale = min(1.0, WORK_WIDTH_PX / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    lab = np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2LAB), dtype=np.float32)
    peaks: list[tuple[float, float, float, float]] = []
    for share in SCALES_SHARE:
        peaks += _peaks(lab, max(3.0, share * small.shape[1]))
    kept: list[tuple[float, float, float, float]] = []
    for peak in sorted(peaks, reverse=True):
        if all(np.hypot(peak[1] - k[1], peak[2] - k[2]) > SAME_SHARE * max(peak[3], k[3]) for k in kept):
            kept.append(peak)
    return [(x / scale, y / scale) for _, x, y, _ in kept[:PLACES]]


def _peaks(lab: Float32, size: float) -> list[tuple[float, float, float, float]]:
    """(strength, x, y, size) of the local maxima of centre against surround."""
    inner = cv2.blur(lab, (round(size), round(size)))
    side = round(RING_FACTOR * size)
    strength = np.sqrt(np.sum((inner - cv2.blur(lab, (side, side))) ** 2, axis=2))
    reach = 2 * round(size) + 1
    top = cv2.dilate(strength, np.ones((reach, reach), np.uint8))
    margin = round(size / 2)
    inside = np.zeros(strength.shape, dtype=bool)
    inside[margin : strength.shape[0] - margin, margin : strength.shape[1] - margin] = True
    rows, columns = np.nonzero((strength >= top) & inside & (strength > 0))
    order = np.argsort(-strength[rows, columns])[: 2 * PLACES]
    return [(float(strength[rows[i], columns[i]]), columns[i] + 0.5, rows[i] + 0.5, size) for i in order]
