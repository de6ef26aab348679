"""Kernels of motion and defocus, for both ways of rendering."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from tracker.messages import Array
from tracker.training.augment import ranges

KERNEL_PX = 2 * math.ceil(ranges.MOTION_BLUR_PX[1] / 2) + 1  # holds the longest streak and 3.5 sigma of the widest blur
_AXIS = np.arange(KERNEL_PX) - KERNEL_PX // 2


def motion_kernels(length_px: Array, angle_rad: Array) -> npt.NDArray[np.float32]:
    """(B, K, K): a streak of `length_px` through the middle, one pixel wide, with soft ends. Sum 1."""
    c, s = np.cos(angle_rad)[:, None, None], np.sin(angle_rad)[:, None, None]
    x, y = _AXIS[None, None, :], _AXIS[None, :, None]
    along, across = np.abs(c * x + s * y), np.abs(c * y - s * x)
    streak = np.clip(length_px[:, None, None] / 2 + 0.5 - along, 0.0, 1.0) * np.clip(1.0 - across, 0.0, 1.0)
    return _normalised(streak)


def blur_kernels(sigma_px: Array) -> npt.NDArray[np.float32]:
    """(B, K, K): Gaussians. Sum 1."""
    line = np.exp(-0.5 * (_AXIS[None, :] / sigma_px[:, None]) ** 2)
    return _normalised(line[:, :, None] * line[:, None, :])


def _normalised(kernels: Array) -> npt.NDArray[np.float32]:
    return np.asarray(kernels / kernels.sum(axis=(1, 2), keepdims=True), dtype=np.float32)
