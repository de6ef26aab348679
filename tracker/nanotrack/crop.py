"""The crop of the published tracker: whole pixels, and bilinear resizing of them.

Ours (tracker/siamapnpp/crop.py) is exact in its place and does not alias, but on a target of 20 px the least difference
in a crop decides which of two look-alikes is followed; a comparison with the published tracker needs the published one.
"""

from __future__ import annotations

import cv2
import numpy as np

from tracker.messages import ImageU8
from tracker.siamapnpp.crop import MIN_SIDE_PX, CropGeometry


def crop_pixels(image_bgr_u8: ImageU8, geometry: CropGeometry, fill_bgr: tuple[float, float, float]) -> ImageU8:
    """The nearest square of whole pixels, resized to (out, out, 3); what lies outside the frame is `fill_bgr`.

    Costs memory of the square's size wherever it lies: not for windows far larger than the frame.
    """
    side_px = max(round(MIN_SIDE_PX), round(geometry.side_px))
    left, top = (round(centre - geometry.side_px / 2) for centre in (geometry.cx_px, geometry.cy_px))
    part = image_bgr_u8[max(top, 0) : max(top + side_px, 0), max(left, 0) : max(left + side_px, 0)]
    if part.shape[:2] != (side_px, side_px):
        square = np.empty((side_px, side_px, 3), np.uint8)
        square[:] = np.clip(np.rint(fill_bgr), 0, 255)
        rows, columns = part.shape[:2]
        square[max(-top, 0) : max(-top, 0) + rows, max(-left, 0) : max(-left, 0) + columns] = part
        part = square
    out_px = geometry.out_px
    return np.asarray(cv2.resize(part, (out_px, out_px), interpolation=cv2.INTER_LINEAR), dtype=np.uint8)
