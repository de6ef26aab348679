"""Which windows of a picture are searched: around the last place, around a hint, and the hint's further tiles."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tracker.messages import SearchHint
from tracker.siamapnpp.crop import EXEMPLAR_PX, CropGeometry, exemplar_side_px

MAX_HINT_SCALE = 4.0  # beyond this the target has under 1/4 of the pixels that the exemplar was made from
FLOOR_PX = 4.0  # the official floor of 10 px makes small targets grow at once
MAX_HINT_SIZE_PX = 4096.0  # larger than any picture: a bound against nonsense
MAX_CALLS = 16  # of the network per picture, whatever a hint wishes: more than a second of a processor


@dataclass(frozen=True, slots=True)
class Window:
    """One square to search. `scale` is its size relative to the normal one."""

    geometry: CropGeometry
    scale: float


def hinted_size(hint: SearchHint | None) -> tuple[float, float] | None:
    """The target's size as a hint tells it, bounded; None when it tells none that can be used."""
    if hint is None or hint.size_px is None or not all(math.isfinite(v) for v in hint.size_px):
        return None
    width_px, height_px = (min(max(v, FLOOR_PX), MAX_HINT_SIZE_PX) for v in hint.size_px)
    return width_px, height_px


def places(hint: SearchHint | None) -> bool:
    """Whether a hint says where to look."""
    return hint is not None and all(math.isfinite(v) for v in (*hint.center_px, hint.scale))


def windows(
    hint: SearchHint | None,
    centre_px: tuple[float, float],
    size_px: tuple[float, float],
    search_px: int,
    sure_px: int | None = None,
) -> tuple[Window, ...]:
    """The windows to search, the main one first; at least one, at most `hint.max_calls`.

    Without a hint, or with one that is not finite, the one at `centre_px`, else where it says. `search_px` is the
    crop's side, `sure_px` that of a smaller crop at the same resolution for a hint that is `sure`; None: none.
    """
    side_px = exemplar_side_px(*size_px) * search_px / EXEMPLAR_PX
    if hint is None or not places(hint):
        return (Window(CropGeometry(*centre_px, side_px, search_px), 1.0),)
    scale = _scale(hint.scale)
    cx, cy = hint.center_px
    out_px = sure_px if hint.sure and sure_px is not None and scale == 1.0 and not hint.tiles else search_px
    found = [Window(CropGeometry(cx, cy, side_px * scale * out_px / search_px, out_px), scale)]
    for tile in hint.tiles[: min(max(hint.max_calls, 1), MAX_CALLS) - 1]:
        if all(math.isfinite(v) for v in (*tile.center_px, tile.scale)):
            scale = _scale(tile.scale)
            found.append(Window(CropGeometry(*tile.center_px, side_px * scale, search_px), scale))
    return tuple(found)


def _scale(scale: float) -> float:
    return min(max(scale, 1.0), MAX_HINT_SCALE)
