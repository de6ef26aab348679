"""What JPEG does to a picture, in torch: colours halved in resolution, 8x8 cosine transforms, rounded coefficients."""

from __future__ import annotations

import math
from functools import lru_cache

import torch
import torch.nn.functional as F

Tensor = torch.Tensor
BLOCK_PX = 8
# Tables K.1 and K.2 of ITU-T T.81, the ones that libjpeg scales by its quality.
LUMINANCE = (
    (16, 11, 10, 16, 24, 40, 51, 61),
    (12, 12, 14, 19, 26, 58, 60, 55),
    (14, 13, 16, 24, 40, 57, 69, 56),
    (14, 17, 22, 29, 51, 87, 80, 62),
    (18, 22, 37, 56, 68, 109, 103, 77),
    (24, 35, 55, 64, 81, 104, 113, 92),
    (49, 64, 78, 87, 103, 121, 120, 101),
    (72, 92, 95, 98, 112, 100, 103, 99),
)
CHROMINANCE = (
    (17, 18, 24, 47, 99, 99, 99, 99),
    (18, 21, 26, 66, 99, 99, 99, 99),
    (24, 26, 56, 99, 99, 99, 99, 99),
    (47, 66, 99, 99, 99, 99, 99, 99),
) + ((99,) * 8,) * 4


def jpeg(images: Tensor, quality: Tensor) -> Tensor:
    """Pictures (B, 3, S, S) BGR, 0 to 255, as they come back from a JPEG of `quality` (B, 1, 1, 1), 1 to 100."""
    side = images.shape[-1]
    images = F.pad(images, [0, -side % (2 * BLOCK_PX)] * 2, mode="replicate")
    b, g, r = images.unbind(dim=1)
    luma = 0.114 * b + 0.587 * g + 0.299 * r
    chroma = torch.stack([0.5643 * (b - luma), 0.7133 * (r - luma)], dim=1)
    factor = torch.where(quality < 50, 5000 / quality, 200 - 2 * quality)[:, 0]  # libjpeg's rule, per cent
    luma = _quantised(luma[:, None] - 128, _table(LUMINANCE, factor))[:, 0] + 128
    chroma = _quantised(F.avg_pool2d(chroma, 2), _table(CHROMINANCE, factor))
    blue, red = F.interpolate(chroma, scale_factor=2.0, mode="bilinear", align_corners=False).unbind(dim=1)
    colours = luma + 1.772 * blue, luma - 0.3441 * blue - 0.7141 * red, luma + 1.402 * red
    return torch.stack(colours, dim=1)[..., :side, :side].clamp(0, 255)


def _table(base: tuple[tuple[int, ...], ...], factor: Tensor) -> Tensor:
    """(B, 1, 1, 1, 8, 8) quantisation steps."""
    steps = _steps(base, factor.device) * factor
    return ((steps + 50) / 100).floor().clamp(1, 255)[:, None, None, None]


def _quantised(planes: Tensor, steps: Tensor) -> Tensor:
    """Planes (B, C, H, W) with the coefficients of every 8x8 block rounded to multiples of `steps`."""
    count, channels, height, width = planes.shape
    transform = _cosines(planes.device)
    tiles = planes.reshape(count, channels, height // BLOCK_PX, BLOCK_PX, width // BLOCK_PX, BLOCK_PX)
    blocks = tiles.transpose(3, 4)
    rounded = ((transform @ blocks @ transform.T) / steps).round() * steps
    return (transform.T @ rounded @ transform).transpose(3, 4).reshape(planes.shape)


# Kept on each device: making a tensor there from numbers of the host waits for the device.
@lru_cache(maxsize=32)
def _steps(base: tuple[tuple[int, ...], ...], device: torch.device) -> Tensor:
    return torch.tensor(base, device=device, dtype=torch.float32)


@lru_cache(maxsize=16)
def _cosines(device: torch.device) -> Tensor:
    """The orthonormal cosine transform (8, 8)."""
    k, n = torch.arange(BLOCK_PX)[:, None], torch.arange(BLOCK_PX)[None, :]
    rows = math.sqrt(2 / BLOCK_PX) * torch.cos(math.pi * (2 * n + 1) * k / (2 * BLOCK_PX))
    rows[0] = math.sqrt(1 / BLOCK_PX)
    return rows.to(device)
