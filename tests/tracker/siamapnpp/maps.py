"""Response maps with what a test needs in them."""

from __future__ import annotations

import numpy as np

from tracker.siamapnpp.decode import ANCHOR_PX, ResponseMaps
from tracker.siamapnpp.settings import CentreTerm, TrackerSettings

SETTINGS = TrackerSettings(centre_term=CentreTerm.SIGMOID)
TARGET_PX = 63.5  # side of a square target in its own search crop


def maps_with(
    hits: dict[tuple[int, int], float], cells: int = 21, box_px: float = TARGET_PX, features: np.ndarray | None = None
) -> ResponseMaps:
    """Near 0 everywhere but in cells (row, column), whose logits are given; all boxes are squares on their cells."""
    cls = np.zeros((2, cells, cells), np.float32)
    centre = np.full((1, cells, cells), -6.0, np.float32)
    cls[0] = 6.0
    for (row, column), logit in hits.items():
        cls[:, row, column] = [0.0, logit]
        centre[0, row, column] = logit
    anchor = np.full((4, cells, cells), box_px / 2 / ANCHOR_PX, np.float32)
    return ResponseMaps(cls, cls.copy(), centre, np.zeros((4, cells, cells), np.float32), anchor, features)
