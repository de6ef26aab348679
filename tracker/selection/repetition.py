"""Whether what is in a box is found again all round it: tiles, boards, fences, furrows.

Of these a box smaller than the pattern differs from the boxes beside it, and yet cannot be told from others a little
further on: so the picture of the box itself is searched for.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from tracker.box import Box
from tracker.messages import ImageU8
from tracker.selection.patch import cut_patch

SIZE_PX = 14  # the box, as sqrt(w h), is looked at in so many pixels
WINDOW_SIDES = 5.0  # side of what is searched, in the box's longer side
OWN_SHARE = 0.6  # of the box's sides: nearer places are the box itself
DIRECTIONS = 8
ALL_ROUND = 4  # directions of the eight: a row of parked cars has two
LEAST_SIDE_PX = 3  # of the box there: a thinner strip matches anything


def repetition(image_bgr_u8: ImageU8, box: Box) -> float:
    """How well a valid box matches places all round it, 0 to 1: of eight directions' best matches the fourth best.

    A match is a normalised correlation of Lab colours.
    """
    side = WINDOW_SIDES * max(box.w_px, box.h_px)
    scale = SIZE_PX / math.sqrt(box.w_px * box.h_px)
    patch = cut_patch(image_bgr_u8, (box.cx_px, box.cy_px), side, max(1, round(side * scale)))
    if patch is None:
        return 0.0
    x1, y1, x2, y2 = (max(round(float(v)), 0) for v in patch.to_patch(np.array([box.to_corners()]))[0])
    own = np.ascontiguousarray(patch.lab[y1:y2, x1:x2])
    if min(own.shape[:2]) < LEAST_SIDE_PX:
        return 0.0
    match = np.nan_to_num(cv2.matchTemplate(patch.lab, own, cv2.TM_CCOEFF_NORMED), posinf=0.0, neginf=0.0)
    rows, columns = np.mgrid[0 : match.shape[0], 0 : match.shape[1]]
    dx, dy = (columns - x1) / own.shape[1], (rows - y1) / own.shape[0]
    # Plain ground gives no correlation, but rounding may give any number.
    counts = (np.maximum(np.abs(dx), np.abs(dy)) > OWN_SHARE) & (np.abs(match) <= 1.01)
    sector = np.floor(np.arctan2(dy, dx) / (2 * math.pi) * DIRECTIONS + 0.5).astype(np.int64) % DIRECTIONS
    best = sorted((float(match[counts & (sector == k)].max(initial=0.0)) for k in range(DIRECTIONS)), reverse=True)
    return min(best[ALL_ROUND - 1], 1.0)
