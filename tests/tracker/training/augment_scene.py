"""Pictures and plans for the tests of the augmentation."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np

from tracker.box import Box
from tracker.training.augment.plan import Placement, Plan, draw_plan
from tracker.training.recipe import Augmentation, Jitter
from tracker.training.types import View

FILL = (10.0, 200.0, 90.0)
SHARES = (
    *("flip", "gray", "colour", "gamma", "motion_blur", "blur", "low_resolution", "noise", "fog", "jpeg"),
    *("exemplar_low_resolution", "occlusion", "lookalike"),
)
NOTHING = Augmentation(**dict.fromkeys(SHARES, 0.0))
STILL = Jitter(**dict.fromkeys(Jitter.model_fields, 0.0))


def only(effect: str) -> Augmentation:
    """This effect always, no other."""
    return Augmentation(**{**dict.fromkeys(SHARES, 0.0), effect: 1.0})


def plan_of(
    augmentation: Augmentation, jitter: Jitter = STILL, count: int = 1, seed: int = 3, search: int = 223
) -> Plan:
    return draw_plan(np.random.default_rng(seed), count, augmentation, jitter, search)


def placed(shift: tuple[float, float] = (0, 0), scale: float = 0, aspect: float = 0, angle: float = 0) -> Placement:
    """One row of a placement."""
    return Placement(np.array([shift], float), np.array([scale]), np.array([aspect]), np.array([angle]))


def with_search(plan: Plan, placement: Placement, flip: bool = False) -> Plan:
    return replace(plan, search=placement, flip=np.array([flip]))


def textured(box: Box, width: int = 500, height: int = 375, seed: int = 0) -> View:
    """Coloured clouds: smooth enough that two ways of sampling agree, different everywhere."""
    noise = np.random.default_rng(seed).normal(0, 1, (height, width, 3)).astype(np.float32)
    clouds = cv2.GaussianBlur(noise, (0, 0), 3.0)
    return View(np.clip(128 + 45 * clouds / clouds.std(), 0, 255).astype(np.uint8), box, FILL)


@lru_cache(maxsize=16)
def ellipse(box: Box, width: int = 700, height: int = 600) -> View:
    """A white ellipse that fills the box, black around it, edges blended by area."""
    y, x = (np.arange(4 * n, dtype=np.float32) / 4 + 1 / 8 for n in (height, width))
    inside = ((x[None, :] - box.cx_px) / (box.w_px / 2)) ** 2 + ((y[:, None] - box.cy_px) / (box.h_px / 2)) ** 2 <= 1
    cover = cv2.resize(inside.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
    image = np.repeat(np.rint(255 * cover).astype(np.uint8)[:, :, None], 3, axis=2)
    return View(image, box, (0.0, 0.0, 0.0))


def extent(crop: np.ndarray) -> np.ndarray:
    """x1, y1, x2, y2 of what is white, from the crop's centre, to parts of a pixel.

    Along a line through a convex shape's extreme point the half level is crossed at its edge.
    """
    level = crop[..., 0].astype(float) / 255
    out = []
    for profile in (level.max(axis=0), level.max(axis=1)):
        bright = np.flatnonzero(profile >= 0.5)
        first, last = bright[0], bright[-1]
        low = first - (profile[first] - 0.5) / max(profile[first] - profile[first - 1], 1e-6)
        high = last + (profile[last] - 0.5) / max(profile[last] - profile[last + 1], 1e-6)
        out.append((low + 0.5 - len(profile) / 2, high + 0.5 - len(profile) / 2))
    return np.array([out[0][0], out[1][0], out[0][1], out[1][1]])
