"""What is done to the pairs of a batch, drawn before any picture is read."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import IntEnum
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from tracker.messages import Array
from tracker.siamapnpp.crop import EXEMPLAR_PX
from tracker.training.augment import ranges
from tracker.training.recipe import Augmentation, Jitter

Flags = npt.NDArray[np.bool_]
Rows = npt.NDArray[np.intp] | slice
Part = TypeVar("Part")

DRAWS = 96  # uniform numbers of one row: more than are used, so that a new effect does not change the old ones
TURNED = 0.5  # share of crops that are rotated at all: most pictures stay upright


class Effect(IntEnum):
    """What spoils a search crop, at most one of them."""

    NONE = 0
    MOTION_BLUR = 1
    BLUR = 2
    LOW_RESOLUTION = 3
    NOISE = 4
    FOG = 5
    JPEG = 6


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Where and how a target lies in its crop: (B, 2) shift from the crop's centre, (B,) the rest.

    The target is stretched by exp(log_scale + log_aspect) in x and exp(log_scale - log_aspect) in y (of its own axes,
    after the flip), then turned by `angle_rad`, x towards y (clockwise on the screen).
    """

    shift_px: Array
    log_scale: Array
    log_aspect: Array
    angle_rad: Array


@dataclass(frozen=True, slots=True, eq=False)
class Colour:
    """255 clip((gain v + offset) / 255)^gamma: gain (B,), offset (B, 3) in grey levels, gamma (B,); else 1, 0, 1."""

    gain: Array
    offset_bgr: Array
    gamma: Array


@dataclass(frozen=True, slots=True, eq=False)
class Degradation:
    """The effect of each search crop (B,) and the strength that each effect would have."""

    effect: npt.NDArray[np.int64]
    motion_px: Array
    motion_angle_rad: Array
    blur_sigma_px: Array
    low_resolution: Array
    noise_sigma: Array
    fog: Array
    fog_level: Array
    jpeg_quality: npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Occlusion:
    """A patch of the search crop over the target: (B, 2) sides in boxes, place over the box and source, 0 to 1."""

    applied: Flags
    share: Array
    place: Array
    source: Array


@dataclass(frozen=True, slots=True, eq=False)
class Lookalike:
    """A copy of the target elsewhere: (B, tries, 2) centres in crop sides from the crop centre, and how it differs."""

    applied: Flags
    centres: Array
    scale: Array
    mirrored: Flags
    gain: Array
    offset_bgr: Array


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """One row per pair. `flip` and `gray` are for both crops; `exemplar_low_resolution` is 1 where nothing is done."""

    flip: Flags
    gray: Flags
    exemplar: Placement
    search: Placement
    exemplar_colour: Colour
    search_colour: Colour
    exemplar_low_resolution: Array
    degradation: Degradation
    occlusion: Occlusion
    lookalike: Lookalike
    noise_seed: npt.NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.flip)

    def rows(self, index: Rows) -> Plan:
        """The plan of these rows only, in this order: what one process of several renders."""
        return _taken(self, index)


def draw_plan(rng: np.random.Generator, count: int, augmentation: Augmentation, jitter: Jitter, search_px: int) -> Plan:
    """A plan of `count` rows.

    Row r depends on the generator's state and r alone, not on `count`; and a share or range that is changed in the
    recipe leaves all other draws as they were. Search shifts stay within the centres of the outermost cells of the map.
    """
    draws = _Draws(rng, count)
    reach_px = (search_px - EXEMPLAR_PX) / 2
    search = (min(jitter.shift_px, reach_px), jitter.log_scale, jitter.log_aspect, jitter.angle_deg)
    exemplar = (
        jitter.exemplar_shift_px,
        jitter.exemplar_log_scale,
        jitter.exemplar_log_aspect,
        jitter.exemplar_angle_deg,
    )
    low_resolution = draws.uniform(*ranges.EXEMPLAR_LOW_RESOLUTION)
    return Plan(
        exemplar_low_resolution=np.where(draws.share(augmentation.exemplar_low_resolution), low_resolution, 1.0),
        flip=draws.share(augmentation.flip),
        gray=draws.share(augmentation.gray),
        exemplar=_placement(draws, *exemplar),
        search=_placement(draws, *search),
        exemplar_colour=_colour(draws, augmentation),
        search_colour=_colour(draws, augmentation),
        degradation=_degradation(draws, augmentation),
        occlusion=_occlusion(draws, augmentation),
        lookalike=_lookalike(draws, augmentation),
        noise_seed=(draws.uniform(0.0, 1.0) * 2**32).astype(np.int64),
    )


class _Draws:
    """Columns of uniform numbers, handed out from left to right."""

    def __init__(self, rng: np.random.Generator, count: int) -> None:
        self._numbers = rng.random((count, DRAWS))
        self._used = 0

    def columns(self, width: int) -> Array:
        start = self._used
        self._used += width
        if self._used > DRAWS:
            raise AssertionError(f"a row of the plan needs more than {DRAWS} numbers; raise DRAWS")
        return self._numbers[:, start : self._used]

    def uniform(self, low: float, high: float) -> Array:
        return low + (high - low) * self.columns(1)[:, 0]

    def around(self, reach: float) -> Array:
        return self.uniform(-reach, reach)

    def share(self, share: float) -> Flags:
        return np.asarray(self.columns(1)[:, 0] < share)

    def normal(self, sigma: float, width: int) -> Array:
        """Box and Muller: two numbers for each, always the same count."""
        radius = np.sqrt(-2.0 * np.log1p(-self.columns(width)))
        return np.asarray(sigma * radius * np.cos(2.0 * math.pi * self.columns(width)))


def _placement(draws: _Draws, shift_px: float, log_scale: float, log_aspect: float, angle_deg: float) -> Placement:
    turned, angle = draws.share(TURNED), draws.around(math.radians(angle_deg))
    return Placement(
        shift_px=shift_px * (2.0 * draws.columns(2) - 1.0),
        log_scale=draws.around(log_scale),
        log_aspect=draws.around(log_aspect),
        angle_rad=np.where(turned, angle, 0.0),
    )


def _colour(draws: _Draws, augmentation: Augmentation) -> Colour:
    coloured = draws.share(augmentation.colour)
    gain, offset = draws.uniform(*augmentation.gain), draws.around(augmentation.offset)
    offset_bgr = offset[:, None] + draws.normal(augmentation.cast, 3)
    bent, log_gamma = draws.share(augmentation.gamma), draws.uniform(*(math.log(v) for v in ranges.GAMMA))
    return Colour(
        gain=np.where(coloured, gain, 1.0),
        offset_bgr=np.where(coloured[:, None], offset_bgr, 0.0),
        gamma=np.where(bent, np.exp(log_gamma), 1.0),
    )


def _degradation(draws: _Draws, augmentation: Augmentation) -> Degradation:
    shares = [float(getattr(augmentation, effect.name.lower())) for effect in Effect if effect is not Effect.NONE]
    # Above the last threshold lies NONE, which has the number 0.
    effect = (np.searchsorted(np.cumsum(shares), draws.columns(1)[:, 0], side="right") + 1) % len(Effect)
    return Degradation(
        effect=effect.astype(np.int64),
        motion_px=draws.uniform(*ranges.MOTION_BLUR_PX),
        motion_angle_rad=draws.uniform(0.0, math.pi),
        blur_sigma_px=draws.uniform(*ranges.BLUR_SIGMA_PX),
        low_resolution=draws.uniform(*ranges.LOW_RESOLUTION),
        noise_sigma=draws.uniform(*ranges.NOISE_SIGMA),
        fog=draws.uniform(*ranges.FOG),
        fog_level=draws.uniform(*ranges.FOG_LEVEL),
        jpeg_quality=np.rint(draws.uniform(*ranges.JPEG_QUALITY)).astype(np.int64),
    )


def _occlusion(draws: _Draws, augmentation: Augmentation) -> Occlusion:
    low, high = ranges.OCCLUSION
    return Occlusion(
        applied=draws.share(augmentation.occlusion),
        share=low + (high - low) * draws.columns(2),
        place=draws.columns(2),
        source=draws.columns(2),
    )


def _lookalike(draws: _Draws, augmentation: Augmentation) -> Lookalike:
    tries = ranges.LOOKALIKE_TRIES
    return Lookalike(
        applied=draws.share(augmentation.lookalike),
        centres=draws.columns(2 * tries).reshape(-1, tries, 2) - 0.5,
        scale=np.exp(draws.around(ranges.LOOKALIKE_LOG_SCALE)),
        mirrored=draws.share(0.5),
        gain=draws.uniform(*ranges.LOOKALIKE_GAIN),
        offset_bgr=draws.normal(ranges.LOOKALIKE_CAST, 3),
    )


def _taken(part: Part, index: Rows) -> Part:
    """The rows of every array in a dataclass of arrays and of such dataclasses."""
    values: dict[str, Any] = {field.name: getattr(part, field.name) for field in fields(part)}  # type: ignore[arg-type]
    taken = {name: _taken(v, index) if is_dataclass(v) else v[index] for name, v in values.items()}
    return replace(part, **taken)  # type: ignore[type-var]
