"""Labels and losses cell by cell in plain Python, written from the description and not from the code under test."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from tracker.siamapnpp.network import Maps

UNIT = 71.0


@dataclass
class Sample:
    """One sample as Python numbers: anchor (4, M, M), box, negative, draws (M * M, 4)."""

    anchor: np.ndarray
    box: list[float]
    negative: bool
    draws: np.ndarray

    @property
    def side(self) -> int:
        return int(self.anchor.shape[-1])

    def centre(self, row: int, column: int) -> tuple[float, float]:
        return 8.0 * (column - self.side // 2), 8.0 * (row - self.side // 2)

    def anchor_box(self, row: int, column: int) -> tuple[float, float, float, float]:
        gx, gy = self.centre(row, column)
        left, right, top, bottom = (float(v) * UNIT for v in self.anchor[:, row, column])
        return gx - left, gy - top, gx + right, gy + bottom

    def cells(self) -> list[tuple[int, int]]:
        return [(r, c) for r in range(self.side) for c in range(self.side)]

    def lowest(self, cells: list[tuple[int, int]], which: int, count: int) -> list[tuple[int, int]]:
        return sorted(cells, key=lambda rc: self.draws[rc[0] * self.side + rc[1], which])[:count]


def samples(maps: Maps, box: Tensor, negative: Tensor, draws: Tensor) -> list[Sample]:
    rows = zip(maps.anchor.double().numpy(), box.double().tolist(), negative.tolist(), draws.numpy(), strict=True)
    return [Sample(*row) for row in rows]


def overlap(a: tuple[float, ...], b: list[float] | tuple[float, ...]) -> float:
    across = max(0.0, min(a[2], b[2]) - max(a[0], b[0]))
    down = max(0.0, min(a[3], b[3]) - max(a[1], b[1]))
    area = max(0.0, a[2] - a[0]) * max(0.0, a[3] - a[1])
    return across * down / (area + (b[2] - b[0]) * (b[3] - b[1]) - across * down + 1e-6)


def deltas(sample: Sample, row: int, column: int, floor_px: float) -> list[float]:
    x1, y1, x2, y2 = sample.anchor_box(row, column)
    w, h = max(x2 - x1, floor_px), max(y2 - y1, floor_px)
    bx1, by1, bx2, by2 = sample.box
    dx, dy = ((bx1 + bx2) / 2 - (x1 + x2) / 2) / w, ((by1 + by2) / 2 - (y1 + y2) / 2) / h
    return [dx, dy, math.log((bx2 - bx1) / w), math.log((by2 - by1) / h)]


def paper(sample: Sample) -> dict[str, np.ndarray]:
    """cls1, cls2, cls3, anchor_weight, loc_weight of one sample, each (M, M)."""
    side = sample.side
    out = {name: np.full((side, side), -1.0) for name in ("cls1", "cls2")}
    out |= {name: np.zeros((side, side)) for name in ("cls3", "anchor_weight", "loc_weight")}
    if sample.negative:
        _paper_negative(sample, out)
        return out
    _paper_places(sample, out)
    _paper_overlaps(sample, out)
    return out


def _span(sample: Sample, low: int, high: int, divisor: int = 0) -> range:
    """Cells of a side's indices cut to the map, without 1/divisor at each end."""
    low, high = (min(max(v, 0), sample.side - 1) for v in (low, high))
    cut = (high - low + 1) // divisor if divisor else 0
    return range(low + cut, high - cut + 1)


def _raw(sample: Sample) -> list[int]:
    return [int(v / 8 + sample.side // 2) for v in sample.box]


def _paper_places(sample: Sample, out: dict[str, np.ndarray]) -> None:
    c1, r1, c2, r2 = _raw(sample)
    more_c, more_r = (c2 - c1) // 8, (r2 - r1) // 8
    columns, rows = _span(sample, c1, c2), _span(sample, r1, r2)
    middle_columns, middle_rows = _span(sample, c1, c2, 4), _span(sample, r1, r2, 4)
    for r, c in sample.cells():
        if r1 - more_r <= r <= r2 + more_r and c1 - more_c <= c <= c2 + more_c:
            out["anchor_weight"][r, c] = 1
        if r in middle_rows and c in middle_columns:
            out["cls2"][r, c] = 1
            pairs = ((r - rows[0], rows[-1] - r), (c - columns[0], columns[-1] - c))
            ratios = [min(p) / (max(p) + 1e-4) for p in pairs]
            out["cls3"][r, c] = math.sqrt(ratios[0] * ratios[1])
    free = [(r, c) for r, c in sample.cells() if r not in rows or c not in columns]
    for rc in sample.lowest(free, 2, 3 * len(middle_rows) * len(middle_columns)):
        out["cls2"][rc] = 0


def _paper_overlaps(sample: Sample, out: dict[str, np.ndarray]) -> None:
    c1, r1, c2, r2 = _raw(sample)
    columns, rows = _span(sample, c1, c2, 6), _span(sample, r1, r2, 6)
    found = {rc: overlap(sample.anchor_box(*rc), sample.box) for rc in sample.cells()}
    for rc in sample.lowest([rc for rc, u in found.items() if u > 0.86], 0, 16):
        out["cls1"][rc] = 1
    for rc in sample.lowest([rc for rc, u in found.items() if u <= 0.6], 1, 48):
        out["cls1"][rc] = 0
    boxes = [sample.anchor_box(*rc) for rc in sample.cells()]
    if any(x2 <= x1 or y2 <= y1 for x1, y1, x2, y2 in boxes):
        return
    inner = {(r, c) for r in rows for c in columns}
    chosen = sample.lowest([rc for rc, u in found.items() if u > 0.83 or (u > 0.80 and rc in inner)], 3, 16)
    for rc in chosen:
        out["loc_weight"][rc] = 1 / len(chosen)


def _paper_negative(sample: Sample, out: dict[str, np.ndarray]) -> None:
    side = sample.side
    column, row = (
        side // 2 + math.ceil((a + b) / 2 / 8 + 0.5)
        for a, b in ((sample.box[0], sample.box[2]), (sample.box[1], sample.box[3]))
    )
    column, row = (min(max(v, 3), side - 4) for v in (column, row))
    block = [(r, c) for r, c in sample.cells() if abs(r - row) <= 3 and abs(c - column) <= 3]
    for rc in sample.lowest(block, 1, 16):
        out["cls1"][rc] = 0
    for rc in sample.lowest(sample.cells(), 2, 48):
        out["cls2"][rc] = 0


def relative_total(maps: Maps, rows: list[Sample]) -> float:
    """The whole loss of the relative rule with the trials' weights, one cell after the other."""
    sums: dict[str, float] = {}

    def add(name: str, value: float, weight: float = 1.0) -> None:
        sums[name] = sums.get(name, 0.0) + value * weight
        sums[f"n {name}"] = sums.get(f"n {name}", 0.0) + weight

    for index, sample in enumerate(rows):
        best = _best(sample)
        for r, c in sample.cells():
            logits = [m[index, :, r, c].double().numpy() for m in maps]
            _relative_cell(sample, r, c, best, logits, add)
    mean = {k: v / max(sums[f"n {k}"], 1.0) for k, v in sums.items() if not k.startswith("n ")}
    classes = {k: 0.5 * (mean.get(f"{k}+", 0.0) + mean.get(f"{k}-", 0.0)) for k in ("cls1", "cls2")}
    cls = 1.2 * classes["cls1"] + 1.3 * classes["cls2"] + 3.3 * mean["cls3"]
    return cls + 2.2 * (1.5 * mean.get("l1", 0.0) + mean.get("iou", 0.0)) + 1.8 * mean.get("anchor", 0.0)


def _reach(sample: Sample, row: int, column: int) -> float:
    gx, gy = sample.centre(row, column)
    x1, y1, x2, y2 = sample.box
    across = max(abs(gx - (x1 + x2) / 2) - 4, 0.0) / ((x2 - x1) / 2)
    return max(across, max(abs(gy - (y1 + y2) / 2) - 4, 0.0) / ((y2 - y1) / 2))


def _best(sample: Sample) -> float:
    found = [0.0] * 6
    if not sample.negative:
        found += [overlap(sample.anchor_box(*rc), sample.box) for rc in sample.cells() if _reach(sample, *rc) < 1]
    return min(max(sorted(found)[-6], 0.55), 0.8)


def _relative_cell(sample: Sample, r: int, c: int, best: float, logits: list[np.ndarray], add) -> None:  # type: ignore[no-untyped-def]
    anchor, cls1, cls2, cls3, loc = logits
    kept = sample.draws[r * sample.side + c, 1] <= 0.4
    if sample.negative:
        if kept:
            add("cls1-", _entropy(cls1, 0))
        add("cls2-", _entropy(cls2, 0))
        add("cls3", math.log1p(math.exp(cls3[0])))
        return
    gx, gy = sample.centre(r, c)
    x1, y1, x2, y2 = sample.box
    reach, u = _reach(sample, r, c), overlap(sample.anchor_box(r, c), sample.box)
    sides = [gx - x1, x2 - gx, gy - y1, y2 - gy]
    if reach < 1.15:
        for value, side in zip(anchor, sides, strict=True):
            error = abs(value - side / UNIT)
            add("anchor", 25 * error**2 if error < 0.04 else error)
    if u >= best and reach < 1:
        add("cls1+", _entropy(cls1, 1))
    elif kept and (u <= 0.5 or reach > 1.3):
        add("cls1-", _entropy(cls1, 0))
    if reach < 0.5:
        add("cls2+", _entropy(cls2, 1))
        ratios = [min(max(a, 0), max(b, 0)) / max(a, b) for a, b in (sides[:2], sides[2:])]
        target = max(math.sqrt(ratios[0] * ratios[1]), 0.3)
        add("cls3", math.log1p(math.exp(cls3[0])) - target * cls3[0], 4.0)
    else:
        add("cls3", math.log1p(math.exp(cls3[0])))
        if reach > 1:
            add("cls2-", _entropy(cls2, 0))
    ax1, ay1, ax2, ay2 = sample.anchor_box(r, c)
    w, h = ax2 - ax1, ay2 - ay1
    if u > 0.9 * best and reach < 0.9 and w > 4 and h > 4:
        wanted = [min(max(d, -2.0), 2.0) for d in deltas(sample, r, c, 4.0)]
        add("l1", sum(abs(a - b) for a, b in zip(loc, wanted, strict=True)))
        cx, cy = (ax1 + ax2) / 2 + loc[0] * w, (ay1 + ay2) / 2 + loc[1] * h
        bw, bh = (side * math.exp(min(max(d, -2.0), 2.0)) for side, d in ((w, loc[2]), (h, loc[3])))
        v = max(overlap((cx - bw / 2, cy - bh / 2, cx + bw / 2, cy + bh / 2), sample.box), 1e-4)
        add("iou", -(1 - v) * (1.5 - v) * math.log(v))


def _entropy(logits: np.ndarray, label: int) -> float:
    return float(math.log(math.exp(logits[0]) + math.exp(logits[1])) - logits[label])


def random_case(search_px: int, batch: int, seed: int, noise: float = 0.06) -> tuple[Maps, Tensor, Tensor, Tensor]:
    """Maps whose anchors lie near the truth, ever less so; boxes, some beyond the map; a quarter negatives; draws."""
    generator = torch.Generator().manual_seed(seed)
    side = (search_px - 287) // 8 + 21
    centre = torch.rand(batch, 2, generator=generator) * 90 - 45
    size = torch.rand(batch, 2, generator=generator) * 130 + 12
    box = torch.cat((centre - size / 2, centre + size / 2), 1)
    negative = torch.arange(batch) % 4 == 3
    axis = (torch.arange(side).float() - side // 2) * 8
    gy, gx = torch.meshgrid(axis, axis, indexing="ij")
    x1, y1, x2, y2 = box[:, :, None, None].unbind(1)
    truth = torch.stack((gx - x1, x2 - gx, gy - y1, y2 - gy), 1) / UNIT

    def normal(channels: int, scale: float) -> Tensor:
        return torch.randn(batch, channels, side, side, generator=generator) * scale

    steadiness = torch.linspace(0.2, 1.8, batch)[:, None, None, None]
    maps = Maps(truth + normal(4, noise) * steadiness, normal(2, 1.0), normal(2, 1.0), normal(1, 1.0), normal(4, 0.2))
    return maps, box, negative, torch.rand(batch, side * side, 4, generator=generator)
