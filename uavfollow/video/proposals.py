"""Numbered boxes to pick a target from, drawn into the picture."""

from __future__ import annotations

from collections.abc import Sequence

import cv2

from tracker.messages import ImageU8
from tracker.selection import Proposal
from uavfollow.video.overlay import FONT, MIN_TEXT_SIZE

# Told apart by most colour-blind people too (Okabe and Ito 2008), BGR.
COLOURS_BGR = ((0, 159, 230), (233, 180, 86), (115, 158, 0), (66, 228, 240), (178, 114, 0), (0, 94, 213))


def draw_proposals(image_bgr_u8: ImageU8, proposals: Sequence[Proposal]) -> ImageU8:
    """A copy of the picture with each box and its number, from 1; the first is drawn last, on top."""
    canvas: ImageU8 = image_bgr_u8.copy()
    scale = max(canvas.shape[1] / 1280, MIN_TEXT_SIZE)
    for k in reversed(range(len(proposals))):
        colour = COLOURS_BGR[k % len(COLOURS_BGR)]
        x1, y1, x2, y2 = (round(v) for v in proposals[k].box.to_corners())
        cv2.rectangle(canvas, (x1, y1), (x2, y2), colour, max(1, round(2 * scale)), cv2.LINE_AA)
        _number(canvas, str(k + 1), (x1, y1), scale, colour)
    return canvas


def _number(canvas: ImageU8, text: str, corner: tuple[int, int], scale: float, colour: tuple[int, int, int]) -> None:
    """On a ground of the box's colour above its corner, or inside where there is no room above."""
    size = max(0.8 * scale, MIN_TEXT_SIZE)
    (width, height), below = cv2.getTextSize(text, FONT, size, 1)
    left = min(max(corner[0], 0), canvas.shape[1] - width - 4)
    bottom = corner[1] if corner[1] >= height + below + 2 else corner[1] + height + below + 2
    cv2.rectangle(canvas, (left, bottom - height - below - 2), (left + width + 4, bottom), colour, cv2.FILLED)
    cv2.putText(canvas, text, (left + 2, bottom - below), FONT, size, (0, 0, 0), 1, cv2.LINE_AA)
