"""What spoils crops, with torch on float pictures (B, 3, S, S) of 0 to 255. The counterpart of `effects`.

The plan is in host memory, so the rows of each effect are known without asking the device.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
import torch.nn.functional as F

from tracker.messages import Array
from tracker.training.augment import ranges
from tracker.training.augment.effects import small_side
from tracker.training.augment.geometry import free_place, occluder
from tracker.training.augment.jpeg import jpeg
from tracker.training.augment.kernels import KERNEL_PX, blur_kernels, motion_kernels
from tracker.training.augment.plan import Degradation, Effect, Flags, Lookalike, Occlusion

Tensor = torch.Tensor
GRAY_BGR = (0.114, 0.587, 0.299)


def tensor_on(like: Tensor, values: npt.NDArray[Any]) -> Tensor:
    """Numbers of the plan as float32 where `like` is."""
    return _sent(torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32)), like.device)


def rows_on(like: Tensor, flags: Flags) -> Tensor:
    """The numbers of the rows that are marked, where `like` is."""
    return _sent(torch.from_numpy(np.flatnonzero(flags)), like.device)


def _sent(values: Tensor, device: torch.device) -> Tensor:
    """From pinned memory, for a copy from any other makes the host wait."""
    return values.pin_memory().to(device, non_blocking=True) if device.type == "cuda" else values.to(device)


def on_rows(images: Tensor, flags: Flags, change: Callable[..., Tensor], *values: Array) -> Tensor:
    """Replace the marked rows, in place, by `change(rows, value...)`; each value (B,) comes as (b, 1, 1, 1)."""
    if flags.any():
        rows = rows_on(images, flags)
        images[rows] = change(images[rows], *(tensor_on(images, v[flags])[:, None, None, None] for v in values))
    return images


def gray(images: Tensor, flags: Flags) -> Tensor:
    """The marked rows without colour."""
    weights = tensor_on(images, np.array(GRAY_BGR))[None, :, None, None]
    return on_rows(images, flags, lambda x: (x * weights).sum(dim=1, keepdim=True).expand_as(x))


def low_resolution(images: Tensor, factor: Array, flags: Flags | None = None) -> Tensor:
    """Rows with a factor below 1 (of those marked): averaged to that share of their pixels, enlarged bilinearly."""
    flags = (factor < 1.0) if flags is None else flags & (factor < 1.0)
    if not flags.any():
        return images
    side = images.shape[-1]
    small = np.array([small_side(f, side) for f in factor[flags]])
    through = _resampling(images, small, side)
    return on_rows(images, flags, lambda x: through[:, None] @ x @ through[:, None].mT)


def _resampling(like: Tensor, small: Array, side: int) -> Tensor:
    """(b, side, side): averaging to `small` pixels, then linear interpolation back, along one axis."""
    count = tensor_on(like, small)[:, None, None]
    cell = torch.arange(int(small.max()), device=like.device, dtype=torch.float32)
    pixel = torch.arange(side, device=like.device, dtype=torch.float32)
    pitch = side / count
    start = cell[None, :, None] * pitch
    shared = torch.minimum(start + pitch, pixel + 1) - torch.maximum(start, pixel)
    down = shared.clamp(min=0) / pitch
    place = ((pixel[None, :, None] + 0.5) / pitch - 0.5).clamp(min=0).minimum(count - 1)
    up = (1 - (place - cell).abs()).clamp(min=0)
    return up @ down


def degrade(images: Tensor, plan: Degradation, generator: torch.Generator | None) -> Tensor:
    """Every row's effect on its search crop."""
    streaks, blurs = plan.effect == Effect.MOTION_BLUR, plan.effect == Effect.BLUR
    images = _convolved(images, streaks, motion_kernels(plan.motion_px[streaks], plan.motion_angle_rad[streaks]))
    images = _convolved(images, blurs, blur_kernels(plan.blur_sigma_px[blurs]))
    images = low_resolution(images, plan.low_resolution, plan.effect == Effect.LOW_RESOLUTION)

    def noisy(x: Tensor, sigma: Tensor) -> Tensor:
        noise = torch.randn(x.shape, generator=generator, device=x.device, dtype=x.dtype)
        return (x + sigma * noise).clamp(0, 255)

    def foggy(x: Tensor, share: Tensor, level: Tensor) -> Tensor:
        return x + share * (level - x)

    images = on_rows(images, plan.effect == Effect.NOISE, noisy, plan.noise_sigma)
    images = on_rows(images, plan.effect == Effect.FOG, foggy, plan.fog, plan.fog_level)
    return on_rows(images, plan.effect == Effect.JPEG, jpeg, plan.jpeg_quality.astype(np.float64))


def _convolved(images: Tensor, flags: Flags, kernels: npt.NDArray[np.float32]) -> Tensor:
    """The marked rows, each with a kernel (K, K) of its own; reflected at the border as OpenCV does."""
    if not flags.any():
        return images
    channels = images.shape[1]
    weights = tensor_on(images, kernels).repeat_interleave(channels, dim=0)[:, None]

    def blurred(x: Tensor) -> Tensor:
        padded = F.pad(x, [KERNEL_PX // 2] * 4, mode="reflect").flatten(0, 1)[None]
        return F.conv2d(padded, weights, groups=weights.shape[0]).view_as(x)

    return on_rows(images, flags, blurred)


def occlude(images: Tensor, low: Tensor, high: Tensor, plan: Occlusion) -> Tensor:
    """Cover a part of the target of the marked rows by a patch from elsewhere in the crop."""
    if not plan.applied.any():
        return images
    rows, side = rows_on(images, plan.applied), images.shape[-1]
    share, place, source = (tensor_on(images, v[plan.applied]) for v in (plan.share, plan.place, plan.source))
    first, size, source = occluder(low[rows], high[rows], share, place, source, side)
    pixel = torch.arange(side, device=images.device, dtype=torch.float32)
    offset = pixel - first[:, :, None]  # (b, 2, side): from the patch's first column and row
    inside = (offset >= 0) & (offset < size[:, :, None])
    index = torch.where(inside, offset + source[:, :, None], pixel).long()
    crops = images[rows]
    across = crops.gather(3, index[:, None, 0, None, :].expand_as(crops))
    moved = across.gather(2, index[:, None, 1, :, None].expand_as(crops))
    covered = inside[:, None, 0, None, :] & inside[:, None, 1, :, None]
    images[rows] = torch.where(covered, moved, crops)
    return images


def paste_lookalikes(images: Tensor, low: Tensor, high: Tensor, plan: Lookalike) -> Tensor:
    """Copy the target of the marked rows to the first free place: rescaled, recoloured, with a soft edge."""
    flags = plan.applied
    if not flags.any():
        return images
    rows, side = rows_on(images, flags), images.shape[-1]
    low, high, crops = low[rows], high[rows], images[rows]
    scale = tensor_on(images, plan.scale[flags])[:, None]
    centre, found = free_place(low, high, tensor_on(images, plan.centres[flags]) * side, scale)
    sign = tensor_on(images, np.stack([np.where(plan.mirrored[flags], -1.0, 1.0), np.ones(flags.sum())], axis=1))
    pixel = torch.arange(side, device=images.device, dtype=torch.float32) + (0.5 - side / 2)
    offset = (pixel - centre[:, :, None]) * (sign / scale)[:, :, None]  # (b, 2, side) from the target's centre
    seen = (offset + ((low + high) / 2)[:, :, None]) * (2 / side)
    shape = (len(crops), side, side)
    grid = torch.stack([seen[:, 0, None, :].expand(shape), seen[:, 1, :, None].expand(shape)], dim=-1)
    copy = F.grid_sample(crops, grid, mode="bilinear", padding_mode="border", align_corners=False)
    gain, offset_bgr = tensor_on(images, plan.gain[flags]), tensor_on(images, plan.offset_bgr[flags])
    copy = (copy * gain[:, None, None, None] + offset_bgr[:, :, None, None]).clamp(0, 255)
    near = (offset / (ranges.LOOKALIKE_CONTEXT * (high - low) / 2)[:, :, None]) ** 4
    radius = (near[:, 0, None, :] + near[:, 1, :, None]) ** 0.25
    opacity = ((1 - radius) / ranges.LOOKALIKE_FEATHER).clamp(0, 1) * found[:, :, None]
    images[rows] = crops + opacity[:, None] * (copy - crops)
    return images
