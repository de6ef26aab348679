"""What the program sees, drawn into the picture: box, status, reason, confidence, aim point, truth."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.box import Box
from tracker.messages import ImageU8, TargetState, TargetStatus

COLOURS_BGR = {
    TargetStatus.IDLE: (160, 160, 160),
    TargetStatus.ACQUIRING: (255, 200, 0),
    TargetStatus.LOCKED: (80, 220, 80),
    TargetStatus.COASTING: (0, 190, 255),
    TargetStatus.SEARCHING: (0, 120, 255),
    TargetStatus.LOST: (60, 60, 230),
}
TRUTH_BGR = (255, 255, 255)
FONT = cv2.FONT_HERSHEY_SIMPLEX
MIN_TEXT_SIZE = 0.4  # smaller letters melt together
GRID_STEPS = (10, 20, 25, 50, 100, 200, 250, 500)
GRID_LINES = 16  # about as many along the longer side


def draw_state(image_bgr_u8: ImageU8, target: TargetState, truth: Box | None, label: str) -> ImageU8:
    """A copy of the picture with the target's state on it. `truth` is a thin white box."""
    canvas: ImageU8 = image_bgr_u8.copy()
    scale = max(canvas.shape[1] / 1280, 0.45)
    colour = COLOURS_BGR[target.status]
    if truth is not None and truth.is_valid:
        _rectangle(canvas, truth, TRUTH_BGR, 1)
    if target.box is not None and target.box.is_valid:
        _rectangle(canvas, target.box, colour, max(2, round(2 * scale)))
        if target.status is not TargetStatus.LOCKED:
            _uncertainty(canvas, target, colour)
    centre = (canvas.shape[1] // 2, canvas.shape[0] // 2)
    cv2.drawMarker(canvas, centre, (255, 255, 255), cv2.MARKER_CROSS, round(24 * scale), 1, cv2.LINE_AA)
    text = f"{target.status.value}  {target.reason.value}  {target.confidence:.2f}"
    _text(canvas, text, (round(10 * scale), round(26 * scale)), 0.7 * scale, colour)
    _text(canvas, label, (round(10 * scale), canvas.shape[0] - round(12 * scale)), 0.55 * scale, (255, 255, 255))
    return canvas


def draw_notice(image_bgr_u8: ImageU8, notice: str, is_fault: bool = True) -> ImageU8:
    """A copy of the picture with one line of text below the status: what went wrong (red), or more of the state."""
    canvas: ImageU8 = image_bgr_u8.copy()
    scale = max(canvas.shape[1] / 1280, 0.45)
    colour = COLOURS_BGR[TargetStatus.LOST] if is_fault else (255, 255, 255)
    _text(canvas, notice, (round(10 * scale), round(56 * scale)), 0.7 * scale, colour)
    return canvas


def draw_grid(image_bgr_u8: ImageU8) -> ImageU8:
    """A copy with a labelled pixel grid, to read a box from."""
    canvas: ImageU8 = image_bgr_u8.copy()
    height, width = canvas.shape[:2]
    step = next((s for s in GRID_STEPS if max(width, height) / s <= GRID_LINES), GRID_STEPS[-1])
    scale = max(width / 1280, 0.45)
    lines = canvas.copy()
    for x in range(0, width, step):
        cv2.line(lines, (x, 0), (x, height), (255, 255, 255), 1)
    for y in range(0, height, step):
        cv2.line(lines, (0, y), (width, y), (255, 255, 255), 1)
    canvas = np.asarray(cv2.addWeighted(lines, 0.6, canvas, 0.4, 0), dtype=np.uint8)
    for x in range(0, width, step):
        _text(canvas, str(x), (x + 3, round(16 * scale)), 0.45 * scale, (0, 255, 255))
    for y in range(step, height, step):
        _text(canvas, str(y), (3, y - 3), 0.45 * scale, (0, 255, 255))
    return canvas


def _rectangle(canvas: ImageU8, box: Box, colour: tuple[int, int, int], thickness: int) -> None:
    limit = 4 * max(canvas.shape[:2])
    x1, y1, x2, y2 = (round(min(max(v, -limit), limit)) for v in box.to_corners())
    cv2.rectangle(canvas, (x1, y1), (x2, y2), colour, thickness, cv2.LINE_AA)


def _uncertainty(canvas: ImageU8, target: TargetState, colour: tuple[int, int, int]) -> None:
    """Two-sigma ellipse of the centre."""
    if target.cov is None or target.box is None or not np.isfinite(target.cov[:2, :2]).all():
        return
    values, vectors = np.linalg.eigh(target.cov[:2, :2])
    limit = float(max(canvas.shape[:2]))
    axes = [min(2 * float(np.sqrt(max(v, 0.0))), limit) for v in values]
    angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
    centre = (round(target.box.cx_px), round(target.box.cy_px))
    cv2.ellipse(canvas, centre, (round(axes[1]), round(axes[0])), angle, 0, 360, colour, 1, cv2.LINE_AA)


def _text(canvas: ImageU8, text: str, at: tuple[int, int], size: float, colour: tuple[int, int, int]) -> None:
    """Text on a dark ground, `at` its lower left corner. (An outline is no way: a thicker font also runs wider.)"""
    size = max(size, MIN_TEXT_SIZE)
    thickness = max(1, round(1.4 * size))
    (width, height), below = cv2.getTextSize(text, FONT, size, thickness)
    corner, opposite = (at[0] - 3, at[1] - height - 3), (at[0] + width + 3, at[1] + below)
    cv2.rectangle(canvas, corner, opposite, (0, 0, 0), cv2.FILLED)
    cv2.putText(canvas, text, at, FONT, size, colour, thickness, cv2.LINE_AA)
