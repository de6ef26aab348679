"""A session that knows the target by its colour, and pictures to find it in."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.messages import Frame

CELLS = 15
HALF_TARGET_PX = 127 / 4  # a square target's exemplar is two of its sizes
RED, BLUE = (40, 40, 210), (210, 40, 40)
ALIKE = 30.0  # mean difference of colour at which a cell is as much target as background
WIDTH_PX, HEIGHT_PX = 480, 360


class ColourSession:
    """Features are mean colours of squares of the target's size; the head compares them with the exemplar's middle."""

    def __init__(self) -> None:
        self.crops: list[np.ndarray] = []
        self.sides = np.full((4, CELLS, CELLS), HALF_TARGET_PX, np.float32)
        self.spoil: float | None = None
        self.square_px = 63

    def features(self, crop_bgr_u8: np.ndarray) -> np.ndarray:
        self.crops.append(crop_bgr_u8)
        side = crop_bgr_u8.shape[0]
        cells = 7 if side == 127 else CELLS
        at = side // 2 + (np.arange(cells) - cells // 2) * 16
        means = cv2.blur(crop_bgr_u8, (self.square_px, self.square_px)).astype(np.float32)
        return means[np.ix_(at, at)].transpose(2, 0, 1)

    def head(self, exemplar: np.ndarray, search: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        wanted = exemplar[:, 3, 3][:, None, None]
        logit = (ALIKE - np.abs(search - wanted).mean(0)) / 8.0
        classes = np.stack((np.zeros_like(logit), logit))
        if self.spoil is not None:
            classes[:] = self.spoil
        return classes, self.sides


def picture(*places: tuple[float, float], size_px: int = 32, colour: tuple[int, int, int] = RED) -> np.ndarray:
    """Grey, with a square at each place (centre)."""
    image = np.full((HEIGHT_PX, WIDTH_PX, 3), 128, np.uint8)
    for cx, cy in places:
        half = size_px // 2
        cv2.rectangle(image, (int(cx) - half, int(cy) - half), (int(cx) + half - 1, int(cy) + half - 1), colour, -1)
    return image


def frame(image: np.ndarray, seq: int = 0) -> Frame:
    return Frame(image, seq, seq / 30, seq / 30)
