"""Where to look for a target that is not seen: first around the prediction, then over the whole picture.

    REGION   the window at the prediction, of the normal size in one call, growing in the next
    SWEEP    the picture in tiles, nearest first, over several steps; the prediction's own window every `own_s`
    WHOLE    as SWEEP, but all tiles fit into the calls of one step

A wide window makes the target small, and the network was trained for one size. Of 84 looks on the 12 validation
sequences (embedded `s`, the target somewhere in the core of the window) these shares had a score of 0.55 or more on it:

    scale     1     1.41   2      2.83   4
    share     0.90  0.75   0.49   0.06   0.00

So width is bought with calls, not with scale. Lengths are px of the picture; a window's side at scale 1 is the
tracker's search side for the target's present size.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, replace
from enum import Enum

from tracker.agreement import TIME_EPS_S
from tracker.box import Box
from tracker.filter import check_range
from tracker.messages import SearchTile
from tracker.siamapnpp.crop import EXEMPLAR_PX, exemplar_side_px

MAX_SCALE = 2.0  # beyond, a target is hardly ever recognised (above)
MIN_SIZE_PX, MAX_SIZE_PX = 4.0, 4096.0  # the tracker's own limits of a size it is told
MAX_IMAGE_PX = 16384.0  # a longer side is no picture; bounds the number of tiles
MAX_TILES = 256  # of a sweep: about 9 s of one tile per picture at 30 per second, when most targets are given up
# The 21 x 21 cells of the response lie over 160 of the 287 px of the crop; a centre further out is found by chance.
CORE_SIDES = 160.0 / 287.0
ELLIPSE_SIGMAS = 2.0  # the ellipse that the region must hold: 86 % of a plane's Gaussian
SIDE_CHANGE = 1.25  # a sweep planned for a target of another size than this factor is planned anew
SCALE_STEPS = 8  # scales that are tried per doubling of the tiles' size; finer gains less than a tile per row
PERIOD_S = 1.0 / 30.0  # between two pictures, until there were two
MIN_PERIOD_S, MAX_PERIOD_S = 1.0 / 120.0, 0.5  # faster no camera is used; after a longer gap it is no rate
PERIOD_SHARE = 0.2  # of the newest in the mean: one late picture must not make a whole sweep coarse


class SearchStage(str, Enum):
    """What part of the picture is being searched."""

    REGION = "region"
    SWEEP = "sweep"
    WHOLE = "whole"
    NO_PLACE = "no_place"  # box or picture are nonsense: the narrow window at some finite place


@dataclass(frozen=True, slots=True)
class SearchPlanConfig:
    """Times and scales of `SearchPlan`.

    The region's scale doubles every `double_s` seconds unseen, up to `region_scale`. After `region_s` unseen, or when
    the region cannot hold the 2-sigma ellipse, the picture is swept by tiles of the smallest scale from 1 to
    `tile_scale` that lets a sweep end within `sweep_s`; where none does, of `tile_scale`, and it takes longer. While
    the picture is swept the prediction's own window is searched every `own_s` seconds. `search_sides` is the side of
    the search crop in sides of the exemplar.
    """

    double_s: float = 2.0
    region_scale: float = MAX_SCALE
    region_s: float = 2.0
    tile_scale: float = MAX_SCALE
    sweep_s: float = 1.5
    own_s: float = 0.3
    search_sides: float = 287.0 / EXEMPLAR_PX

    def __post_init__(self) -> None:
        """Check every range. Raises ValueError naming field, value and range."""
        for name, low, high in (
            ("double_s", 0.1, 60.0),
            ("region_scale", 1.0, MAX_SCALE),
            ("region_s", 0.0, 60.0),
            ("tile_scale", 1.0, MAX_SCALE),
            ("sweep_s", 0.1, 60.0),
            ("own_s", 0.0, 60.0),
            ("search_sides", 1.0, 10.0),
        ):
            check_range("search plan", name, getattr(self, name), low, high)


@dataclass(frozen=True, slots=True)
class PlannedSearch:
    """The windows of one step: that at `center_px` (px) with `scale`, then `tiles`; 1 + len(tiles) network calls."""

    center_px: tuple[float, float]
    scale: float
    tiles: tuple[SearchTile, ...]
    stage: SearchStage

    def shifted(self, dx_px: float, dy_px: float) -> PlannedSearch:
        """Moved with the picture (ego-motion)."""
        x, y = self.center_px
        tiles = (replace(t, center_px=(t.center_px[0] + dx_px, t.center_px[1] + dy_px)) for t in self.tiles)
        return replace(self, center_px=(x + dx_px, y + dy_px), tiles=tuple(tiles))


@dataclass(frozen=True, slots=True)
class _Sweep:
    """Tiles that are still to be searched, nearest first, with what they were planned for; lengths in px."""

    pending: tuple[tuple[float, float], ...]
    tile_px: float
    side_px: float
    image_size_px: tuple[float, float]
    tiles: int

    def holds(self, side_px: float, image_size_px: tuple[float, float]) -> bool:
        change = max(side_px / self.side_px, self.side_px / side_px)
        return bool(self.pending) and image_size_px == self.image_size_px and change <= SIDE_CHANGE

    def scale(self, side_px: float) -> float:
        """Of the tiles, for a target that has changed its size a little since."""
        return min(max(self.tile_px / side_px, 1.0), MAX_SCALE)

    def shifted(self, dx_px: float, dy_px: float) -> _Sweep:
        """Moved with the picture; a tile that no longer reaches into it is dropped."""
        reach_px = CORE_SIDES * self.tile_px / 2
        width_px, height_px = self.image_size_px
        moved = ((x + dx_px, y + dy_px) for x, y in self.pending)
        inside = (
            (x, y) for x, y in moved if -reach_px <= x <= width_px + reach_px and -reach_px <= y <= height_px + reach_px
        )
        return replace(self, pending=tuple(inside))


class SearchPlan:
    """Which windows to search in each step while the target is SEARCHING. Deterministic; never raises in the loop.

    State is the rest of the present sweep, whose turn it is (prediction or elsewhere), and the rate of the pictures.
    """

    def __init__(self, config: SearchPlanConfig | None = None) -> None:
        self._config = config or SearchPlanConfig()
        self.reset()

    def reset(self) -> None:
        """Begin anew, as for a target that was just lost."""
        self._sweep: _Sweep | None = None
        self._own_turn = True
        self._own_s = -math.inf
        self._t_s: float | None = None
        self._period_s: float | None = None

    def step(
        self,
        box: Box,
        cov_px2: tuple[float, float, float],
        image_size_px: tuple[float, float],
        unseen_s: float,
        max_calls: int,
        t_s: float,
    ) -> PlannedSearch:
        """The windows for the picture of `t_s` (monotonic s), at most `max_calls` (below 1: one). One call per picture.

        `box` is the prediction, `cov_px2` the covariance (xx, xy, yy) of its centre, `image_size_px` (width, height).
        Windows' centres lie in the picture. Nonsense of box or picture gives the narrow window (NO_PLACE); a covariance
        or a time that is not finite is left out of account.
        """
        self._tick(t_s)
        calls = max(1, int(max_calls)) if math.isfinite(max_calls) else 1
        if not (_is_picture(image_size_px) and box.is_valid):
            return PlannedSearch(_some_place(box, image_size_px), 1.0, (), SearchStage.NO_PLACE)
        centre = _clamped((box.cx_px, box.cy_px), image_size_px)
        side_px = self._side_px(box)
        needed = 2.0 * _ellipse_px(cov_px2) / side_px
        if unseen_s + TIME_EPS_S >= self._config.region_s or needed > self._config.region_scale:
            return self._frame(centre, side_px, image_size_px, calls)
        return self._region(centre, self._region_scale(needed, unseen_s), calls)

    def shift(self, dx_px: float, dy_px: float) -> None:
        """Move what is still to be searched with the picture (ego-motion); nothing when not finite.

        What comes into view by that is searched by the next sweep.
        """
        if self._sweep is not None and math.isfinite(dx_px) and math.isfinite(dy_px):
            self._sweep = self._sweep.shifted(dx_px, dy_px)

    def _tick(self, t_s: float) -> None:
        """Keep the mean time between two pictures, by which a sweep is planned."""
        if not math.isfinite(t_s):
            return
        if self._t_s is not None and t_s > self._t_s:
            period_s = min(max(t_s - self._t_s, MIN_PERIOD_S), MAX_PERIOD_S)
            before_s = period_s if self._period_s is None else self._period_s
            self._period_s = before_s + PERIOD_SHARE * (period_s - before_s)
        self._t_s = t_s

    def _side_px(self, box: Box) -> float:
        """Of the normal search window."""
        w_px, h_px = (min(max(v, MIN_SIZE_PX), MAX_SIZE_PX) for v in (box.w_px, box.h_px))
        return exemplar_side_px(w_px, h_px) * self._config.search_sides

    def _region_scale(self, needed: float, unseen_s: float) -> float:
        """That grows with time, or is needed to hold the ellipse, whichever is larger."""
        c = self._config
        grown = 2.0 ** (max(unseen_s, 0.0) / c.double_s) if math.isfinite(unseen_s) else 1.0
        return min(max(grown, needed), c.region_scale)

    def _region(self, centre: tuple[float, float], scale: float, calls: int) -> PlannedSearch:
        own = self._take_turn(calls)
        if own and calls > 1 and scale > 1.0:
            return PlannedSearch(centre, 1.0, (SearchTile(centre, scale),), SearchStage.REGION)
        return PlannedSearch(centre, 1.0 if own else scale, (), SearchStage.REGION)

    def _frame(
        self, centre: tuple[float, float], side_px: float, image_size_px: tuple[float, float], calls: int
    ) -> PlannedSearch:
        own = self._own_is_due(calls)
        room = calls - 1 if own else calls
        sweep = self._sweep
        if sweep is None or not sweep.holds(side_px, image_size_px):
            sweep = self._plan(centre, side_px, image_size_px, calls)
        scale = sweep.scale(side_px)
        tiles = tuple(SearchTile(_clamped(xy, image_size_px), scale) for xy in sweep.pending[:room])
        self._sweep = replace(sweep, pending=sweep.pending[room:])
        stage = SearchStage.WHOLE if sweep.tiles <= max(1, calls - 1) else SearchStage.SWEEP
        if own:
            return PlannedSearch(centre, 1.0, tiles, stage)
        return PlannedSearch(tiles[0].center_px, scale, tiles[1:], stage)

    def _own_is_due(self, calls: int) -> bool:
        """Whether a sweep is interrupted for the prediction's own window; one call is never all for it."""
        due = self._t_s is None or self._t_s - self._own_s + TIME_EPS_S >= self._config.own_s
        own = due and (calls > 1 or self._own_turn)
        if own:
            self._own_s = -math.inf if self._t_s is None else self._t_s
        self._own_turn = not own
        return own

    def _take_turn(self, calls: int) -> bool:
        """Whether this step searches the prediction's own window: always, but only every other time with one call."""
        own = self._own_turn or calls > 1
        self._own_turn = not own
        return own

    def _plan(
        self, centre: tuple[float, float], side_px: float, image_size_px: tuple[float, float], calls: int
    ) -> _Sweep:
        """A new sweep: as small tiles as the time allows, nearest first."""
        period_s = self._period_s or PERIOD_S
        own_share = min(period_s / self._config.own_s, 1.0) if self._config.own_s > 0 else 1.0
        affordable = max(calls - own_share, 0.5) * self._config.sweep_s / period_s
        steps = round(SCALE_STEPS * math.log2(self._config.tile_scale))
        scales = [2.0 ** (i / SCALE_STEPS) for i in range(steps + 1)]
        scale = next((s for s in scales if _count(side_px * s, image_size_px) <= affordable), self._config.tile_scale)
        tile_px = side_px * scale
        places = _places(centre, tile_px, image_size_px)
        return _Sweep(places, tile_px, side_px, image_size_px, len(places))


def _grid(tile_px: float, image_size_px: tuple[float, float]) -> tuple[int, int]:
    """Columns and rows of tiles whose cores cover the picture."""
    core_px = CORE_SIDES * tile_px
    return math.ceil(image_size_px[0] / core_px), math.ceil(image_size_px[1] / core_px)


def _count(tile_px: float, image_size_px: tuple[float, float]) -> int:
    columns, rows = _grid(tile_px, image_size_px)
    return columns * rows


def _places(
    centre: tuple[float, float], tile_px: float, image_size_px: tuple[float, float]
) -> tuple[tuple[float, float], ...]:
    """Centres of the tiles, nearest first; the nearest `MAX_TILES` when there are more."""
    columns, rows = _grid(tile_px, image_size_px)
    step_x, step_y = image_size_px[0] / columns, image_size_px[1] / rows
    every = (((i + 0.5) * step_x, (j + 0.5) * step_y) for j in range(rows) for i in range(columns))
    return tuple(heapq.nsmallest(MAX_TILES, every, key=lambda xy: math.hypot(xy[0] - centre[0], xy[1] - centre[1])))


def _ellipse_px(cov_px2: tuple[float, float, float]) -> float:
    """Half the long axis of the 2-sigma ellipse; 0 when the covariance is none."""
    xx, xy, yy = cov_px2
    largest_px2 = (xx + yy) / 2 + math.hypot((xx - yy) / 2, xy)
    return ELLIPSE_SIGMAS * math.sqrt(largest_px2) if math.isfinite(largest_px2) and largest_px2 > 0 else 0.0


def _is_picture(image_size_px: tuple[float, float]) -> bool:
    return all(0.0 < v <= MAX_IMAGE_PX for v in image_size_px)


def _clamped(point_px: tuple[float, float], image_size_px: tuple[float, float]) -> tuple[float, float]:
    x, y = (min(max(v, 0.0), side) for v, side in zip(point_px, image_size_px, strict=True))
    return x, y


def _some_place(box: Box, image_size_px: tuple[float, float]) -> tuple[float, float]:
    """The box's centre, in the picture if there is one; the picture's centre, or 0, where it is not finite."""
    sides = image_size_px if _is_picture(image_size_px) else (0.0, 0.0)
    x, y = (v if math.isfinite(v) else side / 2 for v, side in zip((box.cx_px, box.cy_px), sides, strict=True))
    return _clamped((x, y), sides) if _is_picture(image_size_px) else (x, y)
