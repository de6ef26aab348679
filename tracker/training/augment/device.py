"""A whole batch at once with torch, where the crops lie: keeps a GPU busy, and runs on a CPU just as well.

Everything that decides the way of the work comes from the plan, which is in host memory: no step waits for the device.
"""

from __future__ import annotations

import numpy as np
import torch
import torch.nn.functional as F

from tracker.siamapnpp.crop import CONTEXT, EXEMPLAR_PX, MIN_SIDE_PX, SHRINK_FROM
from tracker.training.augment import device_effects as effects
from tracker.training.augment.geometry import deformation, label_box
from tracker.training.augment.plan import Colour, Placement, Plan

Tensor = torch.Tensor
CHUNK_ROWS = 128  # a chunk of 511 px crops is 0.4 GB as float; more gains nothing on a GPU and costs memory


def render_batch(
    pool: Tensor,
    boxes: Tensor,
    fill_bgr: Tensor,
    exemplar_index: Tensor,
    search_index: Tensor,
    plan: Plan,
    search_px: int,
    generator: torch.Generator | None = None,
) -> tuple[Tensor, Tensor, Tensor]:
    """Exemplars (B, 3, 127, 127), search crops (B, 3, search_px, search_px), both uint8, labels (B, 4) float32.

    `pool` (N, 3, P, P) uint8 BGR holds crops with context in which the target has about the undisturbed size (its
    exemplar square is about 127 px); `boxes` (N, 4) float32 are the targets cx, cy, w, h in pixels of their pool crop;
    `fill_bgr` (N, 3) stands for the outside; the indices (B,) int64 say which row shows which target. All of these and
    `generator` (of the noise) are on one device, and so are the results. Geometry and labels are those of
    `render_pair`, effects are alike. `plan` has B rows.
    """
    parts = []
    for start in range(0, len(plan), CHUNK_ROWS):
        some = plan.rows(slice(start, start + CHUNK_ROWS))
        chosen = exemplar_index[start : start + CHUNK_ROWS], search_index[start : start + CHUNK_ROWS]
        parts.append(_render(pool, boxes, fill_bgr, *chosen, some, search_px, generator))
    exemplar, search, label = (torch.cat(part) for part in zip(*parts, strict=True))
    return exemplar, search, label


def _render(
    pool: Tensor,
    boxes: Tensor,
    fill_bgr: Tensor,
    exemplar_index: Tensor,
    search_index: Tensor,
    plan: Plan,
    search_px: int,
    generator: torch.Generator | None,
) -> tuple[Tensor, Tensor, Tensor]:
    seen = pool[exemplar_index], boxes[exemplar_index], fill_bgr[exemplar_index]
    exemplar, _, _ = _placed(*seen, plan.exemplar, plan, EXEMPLAR_PX)
    exemplar = _coloured(exemplar, plan.exemplar_colour)
    exemplar = effects.low_resolution(exemplar, plan.exemplar_low_resolution)
    seen = pool[search_index], boxes[search_index], fill_bgr[search_index]
    search, low, high = _placed(*seen, plan.search, plan, search_px)
    search = effects.paste_lookalikes(search, low, high, plan.lookalike)
    search = effects.occlude(search, low, high, plan.occlusion)
    search = _coloured(search, plan.search_colour)
    search = effects.degrade(search, plan.degradation, generator)
    exemplar, search = (effects.gray(x, plan.gray) for x in (exemplar, search))
    return _bytes(exemplar), _bytes(search), torch.cat([low, high], dim=1)


def _bytes(images: Tensor) -> Tensor:
    return images.round().clamp(0, 255).to(torch.uint8)


def _placed(
    crops: Tensor, boxes: Tensor, fill_bgr: Tensor, placement: Placement, plan: Plan, out_px: int
) -> tuple[Tensor, Tensor, Tensor]:
    """Crops (B, 3, out, out) float32 and the labels' low and high corners (B, 2)."""
    turn = effects.tensor_on(boxes, deformation(placement, plan.flip))
    shift = effects.tensor_on(boxes, placement.shift_px)
    size = boxes[:, 2:]
    sides = (size + CONTEXT * size.sum(dim=1, keepdim=True)).prod(dim=1).sqrt().clamp(min=MIN_SIDE_PX)
    linear = turn * (EXEMPLAR_PX / sides)[:, None, None]
    low, high = label_box(linear, shift, size)
    # The pool's scale is about the undisturbed one, so the jitter alone says, on the host, who shrinks by how much.
    step = np.exp(-placement.log_scale)
    factors = np.where(step >= SHRINK_FROM, np.floor(step), 1.0).astype(int)
    out = torch.empty((len(crops), crops.shape[1], out_px, out_px), device=crops.device)
    groups = np.unique(factors)
    for factor in groups:
        rows = slice(None) if len(groups) == 1 else effects.rows_on(boxes, factors == factor)
        part = _warp(crops[rows], boxes[rows, :2], fill_bgr[rows], linear[rows], shift[rows], out_px, int(factor))
        out[rows] = part
    return out, low, high


def _warp(
    crops: Tensor, centre: Tensor, fill_bgr: Tensor, linear: Tensor, shift: Tensor, out_px: int, factor: int
) -> Tensor:
    """`linear` (B, 2, 2) from pool pixels to crop pixels; `factor`: by how much the area is averaged first."""
    crops = crops.float().sub_(fill_bgr[:, :, None, None])  # so that zero padding blends into the fill colour
    if factor > 1:
        crops = F.avg_pool2d(crops, factor)
    a, b, c, d = linear.flatten(1).T
    inverse = torch.stack([d, -b, -c, a], dim=1).view(-1, 2, 2) / (a * d - b * c)[:, None, None]
    axis = torch.arange(out_px, device=crops.device, dtype=torch.float32) + (0.5 - out_px / 2)
    x, y = axis[None, None, :] - shift[:, 0, None, None], axis[None, :, None] - shift[:, 1, None, None]
    seen = [
        inverse[:, i, 0, None, None] * x + inverse[:, i, 1, None, None] * y + centre[:, i, None, None] for i in (0, 1)
    ]
    height, width = crops.shape[2:]
    grid = torch.stack([seen[0] * (2 / (factor * width)), seen[1] * (2 / (factor * height))], dim=-1) - 1.0
    warped = F.grid_sample(crops, grid, mode="bilinear", padding_mode="zeros", align_corners=False)
    return warped + fill_bgr[:, :, None, None]


def _coloured(images: Tensor, colour: Colour) -> Tensor:
    gain = effects.tensor_on(images, colour.gain)[:, None, None, None]
    images = (images * gain + effects.tensor_on(images, colour.offset_bgr)[:, :, None, None]).clamp(0, 255)
    return effects.on_rows(images, colour.gamma != 1.0, lambda x, gamma: 255 * (x / 255) ** gamma, colour.gamma)
