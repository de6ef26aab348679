"""Boxes to labels for every cell of the maps, over the whole batch at once.

Coordinates are search pixels from the crop's centre; an M x M map has its cells' centres at 8 (i - M // 2), rows are y.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import torch
from torch import Tensor

from tracker.siamapnpp.decode import ANCHOR_PX, STRIDE_PX
from tracker.siamapnpp.network import Maps
from tracker.training.errors import TrainingError
from tracker.training.recipe import Labels

Corners = tuple[Tensor, Tensor, Tensor, Tensor]

IGNORED = -1
EPS_PX2 = 1e-6  # keeps the overlap of two empty boxes finite

# The paper's rule, as the official code has it (IoU of a predicted anchor with the target's box).
POSITIVE_IOU = 0.86
NEGATIVE_IOU = 0.6
BOX_IOU = 0.83
BOX_IOU_INNER = 0.80  # enough for a cell well inside the target
MAX_POSITIVES = 16  # of a sample
MAX_NEGATIVES = 48
OUTSIDE_PER_POSITIVE = 3
NEAR_CELLS = 3  # a stranger's centre cell and so many around it are the negatives of a true negative
CENTRE_EPS = 1e-4
PAPER_MIN_ANCHOR_PX = 1e-3  # only divides: a sample with such an anchor has no regression

# The relative rule: what the trials that made the embedded weights ended with.
BEST_ANCHORS = 6  # the best so many are positive ...
BEST_IOU = (0.55, 0.8)  # ... as long as the last of them overlaps by the first, and all that overlap by the second
WORST_IOU = 0.5
FAR_REACH = 1.3
ANCHOR_REACH = 1.15
INSIDE_REACH = 1.0
BOX_REACH = 0.9
CORE_REACH = 0.5
BOX_SHARE = 0.9  # of the overlap that makes a class positive
NEGATIVES_KEPT = 0.4  # share: the same easy cells in every batch teach little
MIN_CENTRENESS = 0.3
CORE_WEIGHT = 4.0
MIN_ANCHOR_PX = 4.0
MAX_DELTA = 2.0  # a factor of 7: beyond it the anchor is to be mended, not the box
PLACEHOLDER_PX = 64.0  # side of the box that stands in for that of a negative, so that nothing divides by zero


class Draw(IntEnum):
    """Which random number of a cell decides what."""

    POSITIVE = 0
    NEGATIVE = 1
    OUTSIDE = 2
    BOX = 3


DRAWS = len(Draw)


@dataclass(frozen=True, slots=True, eq=False)
class Targets:
    """Labels of a batch. Classes are 1, 0 or -1 (ignored); a weight of 0 takes a cell out.

    `anchor` (B, 4, M, M): left, right, top, bottom in units of 71 px; `cls1`, `cls2`, `cls3` and all weights
    (B, M, M); `loc` (B, 4, M, M): dx, dy, dw, dh; `anchors` (B, 4, M, M): cx, cy, w, h of the predicted anchors, sides
    bounded from below, without gradient; `box` (B, 4): corners, a placeholder for negatives.
    """

    rule: Labels
    anchor: Tensor
    anchor_weight: Tensor
    cls1: Tensor
    cls2: Tensor
    cls3: Tensor
    cls3_weight: Tensor
    loc: Tensor
    loc_weight: Tensor
    anchors: Tensor
    box: Tensor


@dataclass(frozen=True, slots=True, eq=False)
class _Scene:
    """What both rules start from. Box values are (B, 1, 1), cells (M, M) or (B, M, M); `sides` those of the anchors."""

    gx: Tensor
    gy: Tensor
    x1: Tensor
    y1: Tensor
    x2: Tensor
    y2: Tensor
    present: Tensor
    cx: Tensor
    cy: Tensor
    w: Tensor
    h: Tensor
    overlap: Tensor
    hint: Tensor
    draws: Tensor

    @property
    def corners(self) -> Corners:
        return self.x1, self.y1, self.x2, self.y2


def cells_per_side(search_px: int) -> int:
    """M of the maps of a search crop: 21 for 287 px, 13 for 223 px."""
    return (search_px - 287) // STRIDE_PX + 21


def draws_for(seed: int, stage: int, step: int, rows: range, cells: int, device: torch.device | str = "cpu") -> Tensor:
    """Random numbers in [0, 1) for the given rows of the global batch: (len(rows), cells, DRAWS) float32.

    A hash of the arguments (splitmix64), not a generator's stream: any process, on any device, gets the same numbers
    for the same row. `cells` is that of the whole map, M * M.
    """
    state = torch.zeros((), dtype=torch.int64, device=device)
    for number in (seed, stage, step):
        state = _scrambled((state ^ number) + _GOLDEN)
    row = _scrambled((torch.arange(rows.start, rows.stop, rows.step, device=device) ^ state) + _GOLDEN)
    cell = torch.arange(1, cells * DRAWS + 1, device=device) * _GOLDEN
    bits = (_scrambled(row[:, None] + cell) >> 40) & 0xFFFFFF  # as many bits as a float32 holds
    return (bits.float() / 2**24).view(-1, cells, DRAWS)


_GOLDEN = -0x61C8864680B583EB  # 2^64 / golden ratio, as a signed number


def _scrambled(x: Tensor) -> Tensor:
    """The finaliser of splitmix64 (Steele et al. 2014); int64 products wrap, shifts are made logical by masks."""
    x = (x ^ ((x >> 30) & ((1 << 34) - 1))) * -0x40A7B892E31B1A47
    x = (x ^ ((x >> 27) & ((1 << 37) - 1))) * -0x6B2FB644ECCEEE15
    return x ^ ((x >> 31) & ((1 << 33) - 1))


def iou(first: Corners, second: Corners) -> Tensor:
    """Overlap of boxes given by x1, y1, x2, y2 that broadcast; one with a negative side overlaps nothing."""
    ax1, ay1, ax2, ay2 = first
    bx1, by1, bx2, by2 = second
    across = (torch.minimum(ax2, bx2) - torch.maximum(ax1, bx1)).clamp(min=0)
    down = (torch.minimum(ay2, by2) - torch.maximum(ay1, by1)).clamp(min=0)
    inter = across * down
    area = (ax2 - ax1).clamp(min=0) * (ay2 - ay1).clamp(min=0)
    return inter / (area + (bx2 - bx1) * (by2 - by1) - inter + EPS_PX2)


def labels(maps: Maps, box: Tensor, negative: Tensor, search_px: int, rule: Labels, draws: Tensor) -> Targets:
    """Labels by a rule. Uses the predicted anchors of `maps`, without gradient.

    `box` (B, 4) and `negative` (B,) as in `types.Batch`; `draws` as `draws_for` makes them. A negative has no positive
    label anywhere; its box is at most a hint where the stranger is. Raises TrainingError when the maps are not those
    of a crop of `search_px`. Paper rule: section III of the paper and the official label builder, whose independent
    5 % of hard negatives are here exactly the true negatives.
    """
    side = cells_per_side(search_px)
    if maps.anchor.shape[-1] != side:
        raise TrainingError(
            f"a search crop of {search_px} px has {side} cells a side, the maps {maps.anchor.shape[-1]}"
        )
    scene = _scene(maps.anchor.detach().float(), box.float(), negative.bool(), draws)
    return _paper(scene) if rule is Labels.PAPER else _relative(scene)


def _scene(anchor: Tensor, box: Tensor, negative: Tensor, draws: Tensor) -> _Scene:
    batch, side = anchor.shape[0], anchor.shape[-1]
    axis = (torch.arange(side, device=anchor.device) - side // 2).float() * STRIDE_PX
    gy, gx = torch.meshgrid(axis, axis, indexing="ij")
    half = PLACEHOLDER_PX / 2
    placeholder = box.new_tensor([-half, -half, half, half])
    x1, y1, x2, y2 = torch.where(negative[:, None], placeholder, box)[:, :, None, None].unbind(1)
    left, right, top, bottom = (anchor * ANCHOR_PX).unbind(1)
    w, h = left + right, top + bottom
    cx, cy = gx - left + w / 2, gy - top + h / 2
    overlap = iou((cx - w / 2, cy - h / 2, cx + w / 2, cy + h / 2), (x1, y1, x2, y2))
    hint = torch.nan_to_num(box, 0.0, 0.0, 0.0)[:, :, None, None]
    present = ~negative[:, None, None]
    drawn = draws.view(batch, side, side, DRAWS)
    return _Scene(gx, gy, x1, y1, x2, y2, present, cx, cy, w, h, overlap, hint, drawn)


def _deltas(scene: _Scene, floor_px: float) -> tuple[Tensor, Tensor]:
    """Box targets relative to the anchors, and those anchors with their sides bounded from below: (B, 4, M, M)."""
    w, h = scene.w.clamp(min=floor_px), scene.h.clamp(min=floor_px)
    dx = ((scene.x1 + scene.x2) / 2 - scene.cx) / w
    dy = ((scene.y1 + scene.y2) / 2 - scene.cy) / h
    dw = torch.log((scene.x2 - scene.x1).clamp(min=EPS_PX2) / w)
    dh = torch.log((scene.y2 - scene.y1).clamp(min=EPS_PX2) / h)
    return torch.stack((dx, dy, dw, dh), 1), torch.stack((scene.cx, scene.cy, w, h), 1)


def _sides(scene: _Scene) -> Tensor:
    """Distances of the cells to the target's sides in units of the anchor map: (B, 4, M, M)."""
    gx, gy = scene.gx, scene.gy
    return torch.stack((gx - scene.x1, scene.x2 - gx, gy - scene.y1, scene.y2 - gy), 1) / ANCHOR_PX


def _chosen(eligible: Tensor, draws: Tensor, count: Tensor | int) -> Tensor:
    """Of the eligible cells of every sample those with the `count` (number or (B,)) smallest draws; (B, M, M)."""
    keys = torch.where(eligible, draws, torch.full_like(draws, 2.0)).flatten(1)
    order = keys.argsort(dim=1, stable=True)
    rank = torch.empty_like(order)
    rank.scatter_(1, order, torch.arange(order.shape[1], device=order.device).expand_as(order))
    limit = count[:, None] if isinstance(count, Tensor) else count
    return eligible & (rank < limit).view_as(eligible)


def _classes(positive: Tensor, negative: Tensor) -> Tensor:
    out = torch.full_like(positive, IGNORED, dtype=torch.int8)
    out.masked_fill_(negative, 0)
    return out.masked_fill_(positive, 1)


# ---- the paper's rule


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """The target in whole cells: (B, 1, 1) indices of first and last column and row, cut to the map, and before that.

    `column` is (1, M), `row` (M, 1); pairs are x, y.
    """

    column: Tensor
    row: Tensor
    first: tuple[Tensor, Tensor]
    last: tuple[Tensor, Tensor]
    raw_first: tuple[Tensor, Tensor]
    raw_last: tuple[Tensor, Tensor]

    def whole(self) -> Tensor:
        """All cells of the target: (B, M, M)."""
        return self._between(self.first, self.last, (0.0, 0.0))

    def inner(self, divisor: int) -> Tensor:
        """The target's cells without a 1/divisor of its extent at each side, in whole cells: (B, M, M)."""
        cut_x, cut_y = ((b - a + 1) // divisor for a, b in zip(self.first, self.last, strict=True))
        return self._between(self.first, self.last, (-cut_x, -cut_y))

    def enlarged(self, divisor: int) -> Tensor:
        """The target's cells and a 1/divisor of its extent more at each side, also of what lies outside the map."""
        more_x, more_y = ((b - a) // divisor for a, b in zip(self.raw_first, self.raw_last, strict=True))
        return self._between(self.raw_first, self.raw_last, (more_x, more_y))

    def centreness(self) -> Tensor:
        """sqrt of the product of the smaller over the larger distance to opposite sides, in cells: (B, M, M)."""
        ratios = []
        for index, a, b in zip((self.column, self.row), self.first, self.last, strict=True):
            before, after = (index - a).clamp(min=0), (b - index).clamp(min=0)
            ratios.append(torch.minimum(before, after) / (torch.maximum(before, after) + CENTRE_EPS))
        return (ratios[0] * ratios[1]).sqrt()

    def _between(
        self, low: tuple[Tensor, Tensor], high: tuple[Tensor, Tensor], more: tuple[Tensor | float, Tensor | float]
    ) -> Tensor:
        across = (self.column >= low[0] - more[0]) & (self.column <= high[0] + more[0])
        return across & (self.row >= low[1] - more[1]) & (self.row <= high[1] + more[1])


def _cells(scene: _Scene) -> _Cells:
    side = scene.gx.shape[-1]
    # The official indices are cut towards zero, not rounded down: it matters for boxes that begin outside the map.
    raw = [torch.trunc(v / STRIDE_PX + side // 2) for v in scene.corners]
    x1, y1, x2, y2 = (v.clamp(0, side - 1) for v in raw)
    index = torch.arange(side, device=scene.gx.device).float()
    return _Cells(index[None, :], index[:, None], (x1, y1), (x2, y2), (raw[0], raw[1]), (raw[2], raw[3]))


def _near_hint(scene: _Scene) -> Tensor:
    """The block of cells around where the stranger of a negative may be, whole even for a hint outside the map."""
    side = scene.gx.shape[-1]
    x1, y1, x2, y2 = scene.hint.unbind(1)
    index = torch.arange(side, device=scene.gx.device).float()
    distances = []
    for line, low, high in ((index[None, :], x1, x2), (index[:, None], y1, y2)):
        middle = torch.ceil((low + high) / 2 / STRIDE_PX + 0.5) + side // 2
        distances.append((line - middle.clamp(NEAR_CELLS, side - 1 - NEAR_CELLS)).abs())
    return (distances[0] <= NEAR_CELLS) & (distances[1] <= NEAR_CELLS)


def _paper(scene: _Scene) -> Targets:
    cells, present, draws = _cells(scene), scene.present, scene.draws
    positive = _chosen((scene.overlap > POSITIVE_IOU) & present, draws[..., Draw.POSITIVE], MAX_POSITIVES)
    apart = _chosen((scene.overlap <= NEGATIVE_IOU) & present, draws[..., Draw.NEGATIVE], MAX_NEGATIVES)
    near = _chosen(_near_hint(scene) & ~present, draws[..., Draw.NEGATIVE], MAX_POSITIVES)
    centre = cells.inner(4) & present
    # Three for each positive would leave a true negative without a single label.
    count = torch.where(present[:, 0, 0], OUTSIDE_PER_POSITIVE * centre.flatten(1).sum(1), MAX_NEGATIVES)
    outside = _chosen(~(cells.whole() & present), draws[..., Draw.OUTSIDE], count)
    sound = ((scene.w > 0) & (scene.h > 0)).flatten(1).all(1)[:, None, None]
    fits = (scene.overlap > BOX_IOU) | ((scene.overlap > BOX_IOU_INNER) & cells.inner(6))
    boxes = _chosen(fits & sound & present, draws[..., Draw.BOX], MAX_POSITIVES).float()
    loc, anchors = _deltas(scene, PAPER_MIN_ANCHOR_PX)
    return Targets(
        rule=Labels.PAPER,
        anchor=_sides(scene),
        anchor_weight=(cells.enlarged(8) & present).float(),
        cls1=_classes(positive, apart | near),
        cls2=_classes(centre, outside),
        cls3=cells.centreness() * centre,
        cls3_weight=torch.ones_like(scene.overlap),
        loc=loc,
        loc_weight=boxes / boxes.sum((1, 2), keepdim=True).clamp(min=1),
        anchors=anchors,
        box=torch.cat(scene.corners, 1)[:, :, 0],
    )


# ---- the relative rule


def _reach(scene: _Scene) -> Tensor:
    """How far a cell lies from the target's centre: 1 at its sides, half a stride inside them for free; (B, M, M)."""
    slack = STRIDE_PX / 2
    dx = ((scene.gx - (scene.x1 + scene.x2) / 2).abs() - slack).clamp(min=0) / ((scene.x2 - scene.x1) / 2)
    dy = ((scene.gy - (scene.y1 + scene.y2) / 2).abs() - slack).clamp(min=0) / ((scene.y2 - scene.y1) / 2)
    return torch.maximum(dx, dy)


def _smooth_centreness(scene: _Scene) -> Tensor:
    left, right, top, bottom = _sides(scene).clamp(min=0).unbind(1)
    tiny = 1e-3 / ANCHOR_PX
    across = torch.minimum(left, right) / torch.maximum(left, right).clamp(min=tiny)
    down = torch.minimum(top, bottom) / torch.maximum(top, bottom).clamp(min=tiny)
    return (across * down).sqrt().clamp(min=MIN_CENTRENESS)


def _relative(scene: _Scene) -> Targets:
    overlap, present, reach = scene.overlap, scene.present, _reach(scene)
    inside, core = (reach < INSIDE_REACH) & present, (reach < CORE_REACH) & present
    # A young network has no anchor that overlaps by 0.86; its best ones are what it has to learn from.
    ranked = (overlap * inside).flatten(1).topk(BEST_ANCHORS, 1).values
    best = ranked[:, -1].clamp(*BEST_IOU)[:, None, None]
    positive = (overlap >= best) & inside
    apart = (overlap <= WORST_IOU) | (reach > FAR_REACH) | ~present
    kept = scene.draws[..., Draw.NEGATIVE] <= NEGATIVES_KEPT
    # At least 4 px: a delta of a sliver would be huge, and its overlap no proof of a good anchor.
    sized = (scene.w > MIN_ANCHOR_PX) & (scene.h > MIN_ANCHOR_PX)
    boxes = (overlap > BOX_SHARE * best) & (reach < BOX_REACH) & sized & present
    loc, anchors = _deltas(scene, MIN_ANCHOR_PX)
    return Targets(
        rule=Labels.RELATIVE,
        anchor=_sides(scene),
        anchor_weight=((reach < ANCHOR_REACH) & present).float(),
        cls1=_classes(positive, apart & kept),
        cls2=_classes(core, (reach > INSIDE_REACH) | ~present),
        cls3=_smooth_centreness(scene) * core,
        cls3_weight=1.0 + (CORE_WEIGHT - 1.0) * core,
        loc=loc.clamp(-MAX_DELTA, MAX_DELTA),
        loc_weight=boxes.float(),
        anchors=anchors,
        box=torch.cat(scene.corners, 1)[:, :, 0],
    )
