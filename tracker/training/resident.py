"""Packed crops in the memory of the device that trains: one GPU is kept busy without a disk or a decoder behind it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import torch
import torch.nn.functional as F

from tracker.messages import ImageU8
from tracker.siamapnpp.crop import EXEMPLAR_PX, MIN_SIDE_PX, CropGeometry, crop_square, exemplar_side_px
from tracker.training.augment.device import render_batch
from tracker.training.augment.plan import Plan
from tracker.training.errors import TrainingError
from tracker.training.pack_format import AGAIN, PACK_FILE
from tracker.training.pairs import Fault, Pick, Picker, Rows, patch_box
from tracker.training.recipe import Recipe
from tracker.training.sources.mix import Mix
from tracker.training.sources.packed import PackedSource
from tracker.training.types import Batch, Skipped, View, seed_of
from tracker.weights.card import sha256_of

MEMORY_SHARE = 0.8  # of what is free; the rest is for the network and the crops of a batch
CROPS_AT_ONCE = 256  # decoded on the host before they go to the device: 200 MB
NOISE_STREAM = (1 << 31) + 1  # of the generator on the device; row numbers are far below
RENDERED_AT_ONCE = 128
UNSCALED = 0.01  # a crop whose scale is off by less is copied, not resampled: it keeps its sharpness
HALVED_FROM = 2.0  # a patch whose square is that many exemplars wide is averaged down before it is sampled

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Pool:
    """All crops of a mix on one device, N in all, each P x P with its target in the middle.

    `images` (N, 3, P, P) uint8 BGR, `boxes` (N, 4) float32 cx, cy, w, h in their pixels, `fill_bgr` (N, 3) float32.
    On the host: `row` of each source from crop number to N (-1: left out), `place` (N, 5) float64: width and height of
    the crop as it was packed, scale and shift x, y from its pixels to those of the pool; `faults` by row.
    """

    images: torch.Tensor
    boxes: torch.Tensor
    fill_bgr: torch.Tensor
    row: tuple[npt.NDArray[np.int64], ...]
    place: Floats
    faults: dict[int, str]


def load_pool(
    mix: Mix,
    device: torch.device,
    crop_px: int | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    threads: int | None = None,
) -> Pool:
    """Decode all crops of packed sources into the memory of `device`; `crop_px`: side, by default the packs' largest.

    Raises TrainingError: a source that is not packed, a shard that does not match its hash, too little memory.
    """
    sources = _packed_only(mix)
    side = crop_px or max(source.crop_px for source in sources)
    total = sum(len(source.crops()) for source in sources)
    _check_memory(device, total * 3 * side * side, side)
    images = torch.empty((total, 3, side, side), dtype=torch.uint8, device=device)
    boxes, fill, place = np.zeros((total, 4)), np.zeros((total, 3)), np.ones((total, 5))
    faults: dict[int, str] = {}
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as workers:
        list(workers.map(_check_hash, [shard for source in sources for shard in source.files()]))
        row = 0
        for crops in _chunks(sources):
            made = list(workers.map(lambda crop: _standard(crop[0].crop(crop[1]), side), crops))
            host = np.zeros((len(made), side, side, 3), np.uint8)
            for i, one in enumerate(made):
                if isinstance(one, str):
                    faults[row + i], boxes[row + i] = one, (side / 2, side / 2, 1, 1)
                else:
                    host[i], boxes[row + i], fill[row + i], place[row + i] = one
            images[row : row + len(made)] = torch.from_numpy(host).to(device).permute(0, 3, 1, 2)
            row += len(made)
            progress(row, total)
    boxes_on, fill_on = (to_device(a.astype(np.float32), device) for a in (boxes, fill))
    return Pool(images, boxes_on, fill_on, tuple(_rows(sources)), place, faults)


def resident_batches(
    mix: Mix,
    recipe: Recipe,
    device: torch.device,
    rank: int = 0,
    world: int = 1,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Callable[[int], DeviceBatches]:
    """DeviceBatches of any stage, all from one pool. Raises TrainingError as `load_pool` does."""
    pool = load_pool(mix, device, progress=progress)
    return lambda stage_index: DeviceBatches(mix, recipe, stage_index, device, rank, world, pool)


class DeviceBatches:
    """Batches rendered where the pool lies. Implements `types.Batches`; same pairs and geometry as HostBatches.

    `mix` holds packed sources only. `pool` is what `load_pool` made of them, loaded to `device` when it is not given;
    a run of several stages uses `resident_batches`. Raises TrainingError as HostBatches and `load_pool` do.
    """

    def __init__(
        self,
        mix: Mix,
        recipe: Recipe,
        stage_index: int,
        device: torch.device,
        rank: int = 0,
        world: int = 1,
        pool: Pool | None = None,
    ) -> None:
        self._recipe, self._stage_index = recipe, stage_index
        self._rows = Rows.of(recipe, stage_index, rank, world)
        self._picker = Picker(mix, recipe.pairing)
        self._sources = _packed_only(mix)
        self._search_px = recipe.stages[stage_index].search_px
        self._pool = pool or load_pool(mix, device)

    def batch(self, step: int) -> Batch:
        """The rows of this process of batch number `step`, on the pool's device."""
        rows, skipped = self._rows.numbers, Skipped()
        drawn = [self._rows.draw(step, row, self._picker, self._fetch, skipped) for row in rows]
        picks = [pick for _, pick, _ in drawn]
        where = np.array([crops for _, _, crops in drawn], np.int64)
        plan = self._rows.plan(step, self._recipe).rows(slice(rows.start, rows.stop))
        device = self._pool.images.device
        generator = torch.Generator(device)
        noise = seed_of(self._recipe.seed, self._stage_index, step, NOISE_STREAM, rows.start)
        generator.manual_seed(int(noise.integers(2**63)))
        parts = []
        for start in range(0, len(rows), RENDERED_AT_ONCE):
            some = slice(start, start + RENDERED_AT_ONCE)
            parts.append(self._render(picks[some], where[some], plan.rows(some), generator))
        exemplar, search, box = (torch.cat(part) for part in zip(*parts, strict=True))
        negative = to_device(np.array([pick.negative for pick in picks]), device)
        return Batch(exemplar, search, box, negative, skipped)

    def _fetch(self, pick: Pick) -> tuple[int, int] | Fault:
        views = (
            (pick.source, pick.track, pick.exemplar_index),
            (pick.search_source, pick.search_track, pick.search_index),
        )
        found = []
        for source, track, index in views:
            row = int(self._pool.row[source][self._sources[source].crop_of(track, index)])
            if row in self._pool.faults:
                return Fault(self._sources[source].name, self._pool.faults[row])
            found.append(row)
        return found[0], found[1]

    def _render(
        self, picks: list[Pick], where: npt.NDArray[np.int64], plan: Plan, generator: torch.Generator
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Rows of a chunk. They are taken from the pool first, for a patch has a box of its own in a crop of others."""
        pool, count = self._pool, len(picks)
        device = pool.images.device
        rows = to_device(where.T.reshape(-1), device)
        images, boxes, fill = pool.images[rows], pool.boxes[rows], pool.fill_bgr[rows]
        patches: dict[int, tuple[float, float, float, float]] = {}
        for i, pick in enumerate(picks):
            if pick.patch is not None:
                image, patches[i] = _patch(images[i], fill[i], pool.place[where[i, 0]], pick.patch)
                images[i] = images[count + i] = image
        if patches:  # in one copy: one for each would make the device wait as often
            at = to_device(np.array(list(patches)), device)
            boxes[at] = boxes[at + count] = to_device(np.array(list(patches.values()), np.float32), device)
        numbers = torch.arange(2 * count, device=device)
        return render_batch(images, boxes, fill, numbers[:count], numbers[count:], plan, self._search_px, generator)


def to_device(array: npt.NDArray[Any], device: torch.device) -> torch.Tensor:
    """The array as a tensor there. To a GPU it goes by pinned memory, so that nothing waits for the copy."""
    tensor = torch.from_numpy(np.ascontiguousarray(array))
    return tensor.pin_memory().to(device, non_blocking=True) if device.type == "cuda" else tensor


def _patch(
    image: torch.Tensor, fill_bgr: torch.Tensor, place: Floats, seed: int
) -> tuple[torch.Tensor, tuple[float, float, float, float]]:
    """The box of a patch in a crop of the pool, and the crop; halved when the patch is far from the pool's scale."""
    width, height, scale, x, y = (float(v) for v in place)
    box = patch_box(seed, width, height)
    cx, cy, w, h = box.cx_px * scale + x, box.cy_px * scale + y, box.w_px * scale, box.h_px * scale
    if exemplar_side_px(w, h) < HALVED_FROM * EXEMPLAR_PX:
        return image, (cx, cy, w, h)
    half = F.avg_pool2d(image[None].float(), 2)[0]
    side, inner = image.shape[-1], half.shape[-1]
    at = (side - inner) // 2
    out = fill_bgr[:, None, None].expand(-1, side, side).clone()
    out[:, at : at + inner, at : at + inner] = half
    return out.round().to(torch.uint8), (cx / 2 + at, cy / 2 + at, w / 2, h / 2)


def _standard(view: View | str, side: int) -> tuple[ImageU8, list[float], tuple[float, ...], list[float]] | str:
    """A crop as the pool holds it: picture (side, side, 3), box, colour of the outside, place (see Pool)."""
    if isinstance(view, str):
        return view
    image, box = view.image_bgr_u8, view.box
    height, width = image.shape[:2]
    square = max(exemplar_side_px(box.w_px, box.h_px), MIN_SIDE_PX)
    scale = EXEMPLAR_PX / square
    if abs(scale - 1) > UNSCALED:
        out = crop_square(image, CropGeometry(box.cx_px, box.cy_px, side / scale, side), view.fill_bgr)
        x, y = side / 2 - scale * box.cx_px, side / 2 - scale * box.cy_px
    else:
        scale, x, y = 1.0, float(round(side / 2 - box.cx_px)), float(round(side / 2 - box.cy_px))
        shift = np.array([[1.0, 0.0, x], [0.0, 1.0, y]])
        moved = cv2.warpAffine(
            image,
            shift,
            (side, side),
            flags=cv2.INTER_NEAREST,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=view.fill_bgr,
        )
        out = np.asarray(moved, dtype=np.uint8)
    placed = [box.cx_px * scale + x, box.cy_px * scale + y, box.w_px * scale, box.h_px * scale]
    return out, placed, view.fill_bgr, [width, height, scale, x, y]


def _packed_only(mix: Mix) -> list[PackedSource]:
    for source in mix.sources:
        if not isinstance(source, PackedSource):
            raise TrainingError(f"source `{source.name}` is not packed; pack the recipe first: uavfollow train prepare")
    return [source for source in mix.sources if isinstance(source, PackedSource)]


def _chunks(sources: list[PackedSource]) -> Iterator[list[tuple[PackedSource, int]]]:
    """All crops in the order of the pool's rows, some hundreds at a time."""
    crops = ((source, int(crop)) for source in sources for crop in source.crops())
    while chunk := list(islice(crops, CROPS_AT_ONCE)):
        yield chunk


def _rows(sources: list[PackedSource]) -> Iterator[npt.NDArray[np.int64]]:
    first = 0
    for source in sources:
        rows = np.full(len(source), -1, np.int64)
        rows[source.crops()] = first + np.arange(len(source.crops()))
        first += len(source.crops())
        yield rows


def _check_hash(file: tuple[Path, str]) -> None:
    path, sha256 = file
    if sha256_of(path) != sha256:
        raise TrainingError(f"{path}: is not the file that {PACK_FILE} describes; {AGAIN}")


def _check_memory(device: torch.device, needed: int, side: int) -> None:
    free = free_bytes(device)
    if needed > MEMORY_SHARE * free:
        raise TrainingError(
            f"the crops at {side} px need {needed / 1e9:.3g} GB, and {device} has {free / 1e9:.3g} GB free, of which "
            f"{MEMORY_SHARE:.0%} may be used; pack fewer (--limit) or smaller ones (--crop-px)"
        )


def free_bytes(device: torch.device) -> int:
    """Memory that can still be had on a device."""
    if device.type == "cuda":
        return int(torch.cuda.mem_get_info(device)[0])
    for line in Path("/proc/meminfo").read_text().splitlines():
        if line.startswith("MemAvailable:"):
            return int(line.split()[1]) * 1024
    return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
