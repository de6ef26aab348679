"""NanoTrack's few numbers: those it was published with."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class NanoSettings:
    """Hyper-parameters at tracking time (models/config/configv3.yaml of the published tracker).

    `penalty_k` damps changes of scale and aspect, `window` weighs the Hann window, `size_lr` smooths the size,
    `floor_px` is the smallest side of a box. `max_candidates` bounds the alternatives beside the best one (ours).
    """

    penalty_k: float = 0.15
    window: float = 0.455
    size_lr: float = 0.38
    floor_px: float = 10.0
    max_candidates: int = 3

    def __post_init__(self) -> None:
        """Check every range. Raises ValueError that names the field."""
        for name, low, high in (
            ("penalty_k", 0.0, 5.0),
            ("window", 0.0, 1.0),
            ("size_lr", 0.0, 1.0),
            ("floor_px", 1.0, 100.0),
            ("max_candidates", 1, 16),
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and low <= value <= high):
                raise ValueError(f"nanotrack setting {name} is {value}, must lie in {low}..{high}")
