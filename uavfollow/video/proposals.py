"""Numbered boxes to pick a target from, drawn into the picture."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from tracker.box import Box
from tracker.messages import ImageU8
from tracker.selection import Proposal
from uavfollow.video.overlay import FONT, MIN_TEXT_SIZE

# Told apart by most colour-blind people too (Okabe and Ito 2008), BGR.
COLOURS_BGR = ((0, 159, 230), (233, 180, 86), (115, 158, 0), (66, 228, 240), (178, 114, 0), (0, 94, 213))
LEAST_LONG_SIDE_PX = 960  # a smaller picture is enlarged: boxes of one click lie within a few pixels of each other
TEXT_SIZE = 0.7  # at LEAST_LONG_SIDE_PX
PADDING_PX = 2
Rectangle = tuple[int, int, int, int]  # x1, y1, x2, y2 of whole pixels


def draw_proposals(image_bgr_u8: ImageU8, proposals: Sequence[Proposal]) -> ImageU8:
    """A copy of the picture with each box and its number, from 1; the first is drawn last, on top.

    A picture whose longer side is below LEAST_LONG_SIDE_PX is enlarged to it first. No number lies on another one.
    """
    factor = max(LEAST_LONG_SIDE_PX / max(image_bgr_u8.shape[:2]), 1.0)
    canvas = enlarged(image_bgr_u8, factor)
    scale = max(canvas.shape[:2]) / LEAST_LONG_SIDE_PX
    boxes = [_scaled(p.box, factor) for p in proposals]
    for k in reversed(range(len(boxes))):
        x1, y1, x2, y2 = boxes[k]
        cv2.rectangle(canvas, (x1, y1), (x2, y2), _colour(k), max(1, round(1.5 * scale)), cv2.LINE_AA)
    size = max(TEXT_SIZE * scale, MIN_TEXT_SIZE)
    for k, place in enumerate(label_places(boxes, [_extent(k, size) for k in range(len(boxes))], canvas.shape[:2])):
        _number(canvas, k, place, size)
    return canvas


def enlarged(image_bgr_u8: ImageU8, factor: float) -> ImageU8:
    """A copy, `factor` (1 or more) times as large."""
    if factor <= 1.0:
        return np.array(image_bgr_u8)
    height, width = image_bgr_u8.shape[:2]
    size = (max(1, round(width * factor)), max(1, round(height * factor)))
    return np.asarray(cv2.resize(image_bgr_u8, size, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)


def label_places(
    boxes: Sequence[Rectangle], extents: Sequence[tuple[int, int]], shape: tuple[int, ...]
) -> list[Rectangle]:
    """Where the numbers go: (width, height) each, inside the picture (height, width), none on another.

    At the first free of the box's corners outside and then inside; else at the free place nearest to its first corner.
    """
    taken: list[Rectangle] = []
    for box, (w, h) in zip(boxes, extents, strict=True):
        corners = _corners(box, w, h)
        places = [_held(x, y, w, h, shape) for x, y in corners + _grid(corners[0], w, h, shape)]
        taken.append(next((p for p in places if not any(_touch(p, other) for other in taken)), places[0]))
    return taken


def _corners(box: Rectangle, w: int, h: int) -> list[tuple[int, int]]:
    x1, y1, x2, y2 = box
    outside = [(x1, y1 - h), (x2 - w, y1 - h), (x1, y2), (x2 - w, y2)]
    return [*outside, (x1, y1), (x2 - w, y1), (x1, y2 - h), (x2 - w, y2 - h)]


def _grid(near: tuple[int, int], w: int, h: int, shape: tuple[int, ...]) -> list[tuple[int, int]]:
    """Every place of a grid of labels, the nearest to a point first."""
    places = [(x, y) for x in range(0, shape[1], w + 1) for y in range(0, shape[0], h + 1)]
    return sorted(places, key=lambda p: (p[0] - near[0]) ** 2 + (p[1] - near[1]) ** 2)


def _held(x: int, y: int, w: int, h: int, shape: tuple[int, ...]) -> Rectangle:
    x, y = max(min(x, shape[1] - w), 0), max(min(y, shape[0] - h), 0)
    return x, y, x + w, y + h


def _touch(a: Rectangle, b: Rectangle) -> bool:
    return a[0] <= b[2] and b[0] <= a[2] and a[1] <= b[3] and b[1] <= a[3]


def _scaled(box: Box, factor: float) -> Rectangle:
    x1, y1, x2, y2 = (round(v * factor) for v in box.to_corners())
    return x1, y1, x2, y2


def _colour(k: int) -> tuple[int, int, int]:
    return COLOURS_BGR[k % len(COLOURS_BGR)]


def _extent(k: int, size: float) -> tuple[int, int]:
    (width, height), below = cv2.getTextSize(str(k + 1), FONT, size, 1)
    return width + 2 * PADDING_PX, height + below + PADDING_PX


def _number(canvas: ImageU8, k: int, place: Rectangle, size: float) -> None:
    """On a ground of the box's colour."""
    x1, y1, x2, y2 = place
    _, below = cv2.getTextSize(str(k + 1), FONT, size, 1)
    cv2.rectangle(canvas, (x1, y1), (x2, y2), _colour(k), cv2.FILLED)
    cv2.putText(canvas, str(k + 1), (x1 + PADDING_PX, y2 - below), FONT, size, (0, 0, 0), 1, cv2.LINE_AA)
