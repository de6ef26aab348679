"""What spoils a crop, with OpenCV on 8-bit pictures (H, W, 3), H = W."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.messages import Array, ImageU8
from tracker.training.augment import ranges
from tracker.training.augment.geometry import free_place, occluder
from tracker.training.augment.kernels import motion_kernels
from tracker.training.augment.plan import Effect, Lookalike, Occlusion, Plan
from tracker.training.types import seed_of

_LEVELS = np.arange(256.0)[:, None]


def colour_curve(gain: float, offset_bgr: Array, gamma: float) -> Array:
    """(256, 3): the new level of every level of every channel, 0 to 255."""
    curve = np.clip(gain * _LEVELS + offset_bgr, 0.0, 255.0)
    return np.asarray(curve if gamma == 1.0 else 255.0 * (curve / 255.0) ** gamma)


def look_up(image: ImageU8, curve: Array) -> ImageU8:
    """Every channel through its column of `curve` (256, 3)."""
    table = np.rint(curve).astype(np.uint8)[None]
    return np.asarray(cv2.LUT(image, table), dtype=np.uint8)


def gray(image: ImageU8) -> ImageU8:
    """The same without colour, still with three channels."""
    return np.asarray(cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def small_side(factor: float, side_px: int) -> int:
    """Side in pixels that is left of a crop at low resolution."""
    return max(2, round(factor * side_px))


def low_resolution(image: ImageU8, factor: float) -> ImageU8:
    """As if the target had been `factor` as many pixels wide: averaged, then enlarged bilinearly as crops are."""
    if factor >= 1.0:
        return image
    side = image.shape[0]
    small = small_side(factor, side)
    reduced = cv2.resize(image, (small, small), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(reduced, (side, side), interpolation=cv2.INTER_LINEAR), dtype=np.uint8)


def degrade(image: ImageU8, plan: Plan, row: int, seed: int) -> ImageU8:
    """The row's effect on a search crop."""
    part, effect = plan.degradation, Effect(int(plan.degradation.effect[row]))
    if effect is Effect.MOTION_BLUR:
        kernel = motion_kernels(part.motion_px[row : row + 1], part.motion_angle_rad[row : row + 1])[0]
        return np.asarray(cv2.filter2D(image, -1, kernel), dtype=np.uint8)
    if effect is Effect.BLUR:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), float(part.blur_sigma_px[row])), dtype=np.uint8)
    if effect is Effect.LOW_RESOLUTION:
        return low_resolution(image, float(part.low_resolution[row]))
    if effect is Effect.NOISE:
        rng = seed_of(seed, int(plan.noise_seed[row]))
        noise = rng.standard_normal(image.shape, dtype=np.float32) * np.float32(part.noise_sigma[row])
        return np.asarray(cv2.add(image, np.rint(noise).astype(np.int16), dtype=cv2.CV_8U), dtype=np.uint8)
    if effect is Effect.FOG:
        share = float(part.fog[row])
        return look_up(image, np.repeat(_LEVELS * (1.0 - share) + share * part.fog_level[row], 3, axis=1))
    if effect is Effect.JPEG:
        _, code = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(part.jpeg_quality[row])])
        return np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR), dtype=np.uint8)
    return image


def occlude(image: ImageU8, box: Array, occlusion: Occlusion, row: int) -> None:
    """Cover a part of the target, in place, by a patch from elsewhere in the crop."""
    side = image.shape[0]
    draws = occlusion.share[row], occlusion.place[row], occlusion.source[row]
    first, size, source = (v.astype(int) for v in occluder(box[:2], box[2:], *draws, side))
    patch = image[source[1] : source[1] + size[1], source[0] : source[0] + size[0]].copy()
    low, high = np.clip(first, 0, side), np.clip(first + size, 0, side)
    cut = patch[low[1] - first[1] : high[1] - first[1], low[0] - first[0] : high[0] - first[0]]
    image[low[1] : high[1], low[0] : high[0]] = cut


def paste_lookalike(image: ImageU8, box: Array, lookalike: Lookalike, row: int) -> None:
    """Copy the target, in place, to the first free place of the plan: rescaled, recoloured, with a soft edge."""
    side = image.shape[0]
    low, high = box[:2], box[2:]
    scale = float(lookalike.scale[row])
    centre, found = free_place(low, high, lookalike.centres[row] * side, np.array([scale]))
    if not found[0]:
        return
    reach = ranges.LOOKALIKE_CONTEXT * (high - low) / 2  # of what is copied, before scaling
    first = np.clip(np.floor(centre - reach * scale + side / 2), 0, side).astype(int)
    last = np.clip(np.ceil(centre + reach * scale + side / 2), 0, side).astype(int)
    if (last <= first).any():
        return
    step = np.array([-1.0 if lookalike.mirrored[row] else 1.0, 1.0]) / scale
    # Offsets from the target's centre, in target pixels, of the columns and rows of the copy.
    offsets = [(np.arange(a, b) + 0.5 - side / 2 - c) * s for a, b, c, s in zip(first, last, centre, step, strict=True)]
    start = np.array([offsets[0][0], offsets[1][0]]) + (low + high) / 2 + side / 2 - 0.5
    matrix = np.array([[step[0], 0.0, start[0]], [0.0, step[1], start[1]]])
    size = (int(last[0] - first[0]), int(last[1] - first[1]))
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    copy = cv2.warpAffine(image, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
    copy = np.clip(copy * lookalike.gain[row] + lookalike.offset_bgr[row], 0.0, 255.0)
    place = image[first[1] : last[1], first[0] : last[0]]
    opacity = _opacity(offsets[0] / reach[0], offsets[1] / reach[1])
    place[:] = np.rint(place + opacity[:, :, None] * (copy - place)).astype(np.uint8)


def _opacity(x: Array, y: Array) -> Array:
    """1 inside a rectangle with round corners, fading to 0 at 1 from the middle: `x`, `y` in half sides."""
    radius = np.sqrt(np.hypot(x[None, :] ** 2, y[:, None] ** 2))
    return np.clip((1.0 - radius) / ranges.LOOKALIKE_FEATHER, 0.0, 1.0)
