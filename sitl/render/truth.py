"""Truth of the movers in a picture: boxes, share seen, range."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sitl.render.posed import Posed
from sitl.render.projection import View
from sitl.scene import ObjectTruth
from tracker.box import Box

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Outline:
    """What projection alone tells of a body: whole box, the part of it in the picture, middle, range."""

    name: str
    amodal: Box | None
    inner: Box | None
    centre_px: tuple[float, float] | None
    range_m: float

    def truth(self, visible: Box | None, visibility: float) -> ObjectTruth:
        """Truth of the body of which the visible part is known."""
        truncation = 1.0
        if self.amodal is not None and self.inner is not None:
            area = self.amodal.w_px * self.amodal.h_px
            truncation = max(0.0, 1 - self.inner.w_px * self.inner.h_px / area) if area > 0 else 1.0
        return ObjectTruth(self.name, self.amodal, visible, visibility, truncation, self.centre_px, self.range_m)


def outlines(view: View, movers: list[Posed]) -> list[Outline]:
    """Project all bodies. A box is None when part of the body is not before the camera."""
    if not movers:
        return []
    starts = np.cumsum([0] + [len(body.corners) for body in movers[:-1]])
    corners = view.to_camera(np.concatenate([body.corners for body in movers]))
    near = np.minimum.reduceat(corners[:, 2], starts)
    pixels = view.pixels(np.stack([corners[:, 0], corners[:, 1], np.maximum(corners[:, 2], view.near_m)], axis=1))
    low = np.minimum.reduceat(pixels, starts).tolist()
    high = np.maximum.reduceat(pixels, starts).tolist()
    middles = view.to_camera(np.array([body.middle for body in movers])).tolist()
    found = []
    for body, nearest, (x0, y0), (x1, y1), (x, y, z) in zip(movers, near.tolist(), low, high, middles, strict=True):
        amodal = Box.from_corners(x0, y0, x1, y1) if nearest >= view.near_m else None
        inner = inside_picture(view, amodal) if amodal is not None else None
        centre: tuple[float, float] | None = None
        if z >= view.near_m:
            share = view.focal_px / z
            centre = (share * x + view.width_px / 2, share * y + view.height_px / 2)
        found.append(Outline(body.name, amodal, inner, centre, math.sqrt(x * x + y * y + z * z)))
    return found


def inside_picture(view: View, box: Box) -> Box | None:
    """The part of a box that lies in the picture."""
    x0, y0, x1, y1 = box.to_corners()
    x0, y0, x1, y1 = max(x0, 0.0), max(y0, 0.0), min(x1, float(view.width_px)), min(y1, float(view.height_px))
    return Box.from_corners(x0, y0, x1, y1) if x1 > x0 and y1 > y0 else None
