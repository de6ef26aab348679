"""The one box convention of the project.

Continuous pixel coordinates: x right, y down, origin at the outer corner of the top-left pixel; pixel (i, j) covers
[i, i+1) x [j, j+1), so the centre of an image of width W is at W/2. A row `x,y,w,h` converts by cx = x + w/2.
The (w-1)/2 convention of the official toolkit exists only where published scores are reproduced.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Box:
    """Centre and size of an upright box in continuous pixel coordinates."""

    cx_px: float
    cy_px: float
    w_px: float
    h_px: float

    @classmethod
    def from_xywh(cls, x_px: float, y_px: float, w_px: float, h_px: float) -> Box:
        """From the top-left corner and the size."""
        return cls(x_px + w_px / 2, y_px + h_px / 2, w_px, h_px)

    @classmethod
    def from_corners(cls, x1_px: float, y1_px: float, x2_px: float, y2_px: float) -> Box:
        """From the top-left and the bottom-right corner."""
        return cls((x1_px + x2_px) / 2, (y1_px + y2_px) / 2, x2_px - x1_px, y2_px - y1_px)

    def to_xywh(self) -> tuple[float, float, float, float]:
        """Top-left corner and size."""
        return self.cx_px - self.w_px / 2, self.cy_px - self.h_px / 2, self.w_px, self.h_px

    def to_corners(self) -> tuple[float, float, float, float]:
        """Top-left and bottom-right corner."""
        half_w, half_h = self.w_px / 2, self.h_px / 2
        return self.cx_px - half_w, self.cy_px - half_h, self.cx_px + half_w, self.cy_px + half_h

    @property
    def is_valid(self) -> bool:
        """All four numbers finite and the size positive."""
        finite = all(math.isfinite(v) for v in (self.cx_px, self.cy_px, self.w_px, self.h_px))
        return finite and self.w_px > 0 and self.h_px > 0

    def iou(self, other: Box) -> float:
        """Intersection over union, 0 when either box is not valid."""
        if not (self.is_valid and other.is_valid):
            return 0.0
        ax1, ay1, ax2, ay2 = self.to_corners()
        bx1, by1, bx2, by2 = other.to_corners()
        inter = max(0.0, min(ax2, bx2) - max(ax1, bx1)) * max(0.0, min(ay2, by2) - max(ay1, by1))
        union = self.w_px * self.h_px + other.w_px * other.h_px - inter
        return min(1.0, inter / union) if union > 0 else 0.0  # far from the origin rounding could exceed 1
