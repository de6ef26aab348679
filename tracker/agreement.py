"""Whether boxes found one after the other could be one object."""

from __future__ import annotations

import math
from dataclasses import replace

from tracker.box import Box

AGREE_SIZES, AGREE_SIZES_S = 0.3, 4.0  # two boxes of one object: centre noise, and the speed it may have
AGREE_LN_SIZE = 0.5  # and a size within a factor of 1.65
RUN_MIN = 3  # two boxes agree too easily by chance
RUN_GAP_S = 0.5  # boxes further apart in time tell nothing about each other
TIME_EPS_S = 1e-6  # sums of frame periods are not exact; a microsecond decides nothing


class AgreeingRun:
    """Boxes in a row that could be one object: each near the one before, in place and size."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self._last: Box | None = None
        self._first_s = self._last_s = 0.0
        self._count = 0

    def add(self, box: Box, t_s: float) -> None:
        """Take the next box; one that does not agree with the last begins a new run."""
        if self._last is None or not self._agrees(self._last, box, t_s - self._last_s):
            self._first_s, self._count = t_s, 0
        self._last, self._last_s = box, t_s
        self._count += 1

    def lasted(self, span_s: float) -> bool:
        """Whether the run spans at least this time and enough boxes."""
        return self._count >= RUN_MIN and self._last_s - self._first_s >= span_s - TIME_EPS_S

    def shift(self, dx_px: float, dy_px: float) -> None:
        """Move with the picture."""
        if self._last is not None:
            self._last = replace(self._last, cx_px=self._last.cx_px + dx_px, cy_px=self._last.cy_px + dy_px)

    @staticmethod
    def _agrees(a: Box, b: Box, dt_s: float) -> bool:
        if not 0.0 <= dt_s <= RUN_GAP_S:
            return False
        reach_px = (AGREE_SIZES + AGREE_SIZES_S * dt_s) * math.sqrt(a.w_px * a.h_px)
        near = math.hypot(b.cx_px - a.cx_px, b.cy_px - a.cy_px) <= reach_px
        return near and max(abs(math.log(b.w_px / a.w_px)), abs(math.log(b.h_px / a.h_px))) <= AGREE_LN_SIZE
