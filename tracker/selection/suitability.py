"""Whether a box can be tracked at all: better refused with a reason at the click than lost a second later."""

from __future__ import annotations

from enum import Enum

import numpy as np

from tracker.box import Box
from tracker.messages import Array, ImageU8
from tracker.selection.patch import cut_patch
from tracker.selection.repetition import repetition
from tracker.selection.surroundings import difference

LEAST_SIDE_PX = 8.0  # a smaller side has less than one cell (8 px) of the network's features at the frame's own scale
LARGEST_AREA = 0.5  # of the frame: the search region would be mostly outside of the picture
EDGE_PX = 1.0  # a box whose side is nearer to the border than that is cut by it: its middle is not the target's
LOOK_SIDES = 1.6  # side of the window looked at, in the box's longer side: the target and what is round it
LOOK_PX = 32  # it is looked at in so many pixels: what is left of noise and grain there, the tracker sees as well
# Below, neither the target nor its outline differs from plain ground. Of 355 true targets of training pictures one has
# less (2.8; the next has 4.6); of squares laid anywhere in these pictures a tenth.
LEAST_RELIEF = 4.0  # Lab units of 255
# Of 243 true targets (videos, stills from the air, simulator) none differs less from what is round it than 0.30, and
# one first box of 40 less than 0.42; of 66 boxes on noise, blurred noise, boards and stripes 65 are below 0.28. Grass
# whose patches are as large as the box has 0.2 to 0.5, blurred noise in boxes below 15 px the same: a patch is a
# landmark, so it is warned of, not refused.
LEAST_DIFFERENCE, WEAK_DIFFERENCE = 0.28, 0.40
# Of 163 true targets the most repeated has 0.86, one in a hundred above 0.79; boards and stripes have 0.94 and more.
MOST_REPETITION = 0.91


class Unsuitable(str, Enum):
    """Why a box is refused as a target."""

    NOT_A_BOX = "not_a_box"
    TOO_SMALL = "too_small"
    TOO_LARGE = "too_large"
    AT_EDGE = "at_edge"
    FEATURELESS = "featureless"
    NOT_DISTINCT = "not_distinct"

    @property
    def message(self) -> str:
        """What is wrong and what to do, for people."""
        return _MESSAGES[self]


_MESSAGES = {
    Unsuitable.NOT_A_BOX: "its place or size is no usable number; give four finite numbers, width and height above 0",
    Unsuitable.TOO_SMALL: f"a side is below {LEAST_SIDE_PX:g} px, too few to tell the target from others; "
    "go nearer, zoom in, or choose a larger box",
    Unsuitable.TOO_LARGE: f"it covers more than {LARGEST_AREA:.0%} of the picture, so there is nowhere to search; "
    "go further away, zoom out, or choose a part of the target",
    Unsuitable.AT_EDGE: "the edge of the picture cuts it, so where its middle is cannot be known; "
    "turn the camera until the whole target is seen",
    Unsuitable.FEATURELESS: "it looks like what is round it (plain sky, water, road): nothing in it can be recognised; "
    "choose something with an outline or a pattern",
    Unsuitable.NOT_DISTINCT: "the same look is all round it (noise, grass, gravel, tiles): a tracker would be as sure "
    "of the place beside it; choose something that differs from its surroundings",
}
WEAK_WARNING = (
    "it differs little from what is round it, so expect the track to slip; something that stands out is safer"
)


def unsuitable(image_bgr_u8: ImageU8, box: Box) -> Unsuitable | None:
    """The first reason that speaks against `box` (px of this picture) as a target, or None. Never raises for a box."""
    height, width = image_bgr_u8.shape[:2]
    if not box.is_valid:
        return Unsuitable.NOT_A_BOX
    if min(box.w_px, box.h_px) < LEAST_SIDE_PX:
        return Unsuitable.TOO_SMALL
    if box.w_px * box.h_px > LARGEST_AREA * width * height:
        return Unsuitable.TOO_LARGE
    x1, y1, x2, y2 = box.to_corners()
    if min(x1, y1, width - x2, height - y2) < EDGE_PX:
        return Unsuitable.AT_EDGE
    if relief(image_bgr_u8, box) < LEAST_RELIEF:
        return Unsuitable.FEATURELESS
    same = difference(image_bgr_u8, box) < LEAST_DIFFERENCE or repetition(image_bgr_u8, box) > MOST_REPETITION
    return Unsuitable.NOT_DISTINCT if same else None


def warning(image_bgr_u8: ImageU8, box: Box) -> str | None:
    """What to say of a suitable box that is a poor target all the same, or None. Never raises for a box."""
    if unsuitable(image_bgr_u8, box) is not None:
        return None
    return WEAK_WARNING if difference(image_bgr_u8, box) < WEAK_DIFFERENCE else None


def relief(image_bgr_u8: ImageU8, box: Box) -> float:
    """How far the colours in and round a box differ from a plain slope, root mean square in Lab units of 255.

    The slope (a plane in each channel, least squares) is left out because an empty sky is brighter on one side.
    0 when the window holds no picture.
    """
    side = LOOK_SIDES * max(box.w_px, box.h_px)
    patch = cut_patch(image_bgr_u8, (box.cx_px, box.cy_px), side, LOOK_PX)
    if patch is None:
        return 0.0
    width, height = patch.size
    yy, xx = np.mgrid[0:height, 0:width]
    plane: Array = np.column_stack((np.ones(width * height), xx.ravel(), yy.ravel()))
    colours = patch.lab.reshape(-1, 3).astype(np.float64)
    slope, *_ = np.linalg.lstsq(plane, colours, rcond=None)
    return float(np.sqrt(np.mean(np.sum((colours - plane @ slope) ** 2, axis=1))))
