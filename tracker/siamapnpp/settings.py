"""The tracker's few numbers: the paper's values, overridden by a weights card where its training needs others."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from enum import Enum
from typing import Any


class CentreTerm(str, Enum):
    """How the centre-ness output enters the ranking: as the raw logit (official) or through a sigmoid."""

    LOGIT = "logit"
    SIGMOID = "sigmoid"


@dataclass(frozen=True, slots=True)
class TrackerSettings:
    """Hyper-parameters of SiamAPN++ at tracking time (official experiments/config.yaml).

    `penalty_k` damps changes of scale and aspect, `window` weighs the Hann window, `size_lr` smooths the size,
    `class_weights` are the paper's w1, w2, w3. `max_candidates` bounds the alternatives beside the best one.
    `size_lr_per_s` takes `size_lr` as the rate of a 30th of a second instead of a picture. `economy` searches a crop of
    223 px when a hint says that it is sure. `embed_candidates` is for how many candidates the likeness to the
    exemplars is computed (0: none).
    """

    penalty_k: float = 0.079
    window: float = 0.44
    size_lr: float = 0.31
    search_px: int = 287
    class_weights: tuple[float, float, float] = (1.2, 1.3, 1.1)
    centre_term: CentreTerm = CentreTerm.LOGIT
    max_candidates: int = 5
    size_lr_per_s: bool = False
    economy: bool = False
    embed_candidates: int = 1

    def __post_init__(self) -> None:
        """Check every range. Raises ValueError that names the field."""
        for name, low, high in (("penalty_k", 0.0, 5.0), ("window", 0.0, 1.0), ("size_lr", 0.0, 1.0)):
            value = getattr(self, name)
            if not (math.isfinite(value) and low <= value <= high):
                raise ValueError(f"tracker setting {name} is {value}, must lie in {low}..{high}")
        if self.search_px < 223 or (self.search_px - 127) % 8:
            raise ValueError(f"tracker setting search_px is {self.search_px}, must be 127 + a multiple of 8, from 223")
        if len(self.class_weights) != 3 or not all(math.isfinite(w) and w >= 0 for w in self.class_weights):
            raise ValueError(f"tracker setting class_weights is {self.class_weights}, must be three numbers >= 0")
        if sum(self.class_weights) <= 0:
            raise ValueError("tracker setting class_weights must not all be 0")
        if not 1 <= self.max_candidates <= 16:
            raise ValueError(f"tracker setting max_candidates is {self.max_candidates}, must lie in 1..16")
        if not 0 <= self.embed_candidates <= 16:
            raise ValueError(f"tracker setting embed_candidates is {self.embed_candidates}, must lie in 0..16")

    @classmethod
    def from_card(cls, values: dict[str, Any]) -> TrackerSettings:
        """From the `tracker_settings` of a weights card. Raises ValueError on an unknown or impossible entry."""
        known = {f.name for f in fields(cls)}
        unknown = sorted(set(values) - known)
        if unknown:
            raise ValueError(f"unknown tracker settings {', '.join(unknown)}; known are {', '.join(sorted(known))}")
        try:
            made = dict(values)
            if "class_weights" in made:
                made["class_weights"] = tuple(float(w) for w in made["class_weights"])
            if "centre_term" in made:
                allowed = [term.value for term in CentreTerm]
                if made["centre_term"] not in allowed:
                    raise ValueError(
                        f"tracker setting centre_term is {made['centre_term']!r}, must be one of {allowed}"
                    )
                made["centre_term"] = CentreTerm(made["centre_term"])
            return cls(**made)
        except TypeError as error:
            raise ValueError(f"tracker settings of the wrong kind: {error}") from error
