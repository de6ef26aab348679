"""What an ablation found, and what the paper published."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from tracker.training.recipe import Variant
from tracker.training.validate import SequenceScore, Tracks

# Precision at 20 px on UAV20L, from the paper's component study (SiamAPN++, section IV).
PAPER_P20 = {Variant.SIAMAPN: 0.721, Variant.APN_DF: 0.727, Variant.SELF_AAN: 0.730, Variant.AAN: 0.736}
PAPER_BEST_W1 = 1.2
TITLES = {
    Variant.SIAMAPN: "baseline (SiamAPN)",
    Variant.APN_DF: "+ APN-DF",
    Variant.SELF_AAN: "+ APN-DF + self-AAN",
    Variant.AAN: "+ APN-DF + AAN (SiamAPN++)",
}
NOT_A_REPRODUCTION = (
    "No reproduction of the paper: its numbers (published) are the precision on UAV20L of networks that were trained "
    "on some 15 million pairs of other data. Compare differences within a column, never across columns."
)


@dataclass(frozen=True, slots=True)
class VariantResult:
    """A variant after its training: cost, size, raw-tracker scores (means over sequences, and each)."""

    variant: Variant
    pairs: int
    pairs_per_s: float | None
    parameters: int
    auc: float
    p20: float
    sequences: tuple[SequenceScore, ...]

    def as_json(self) -> dict[str, Any]:
        """With the variant's name and the paper's number beside it."""
        return {**asdict(self), "variant": self.variant.value, "paper_p20_uav20l": PAPER_P20[self.variant]}

    @classmethod
    def from_json(cls, variant: Variant, told: dict[str, Any]) -> VariantResult:
        """Back from `as_json`. Raises KeyError, TypeError or ValueError for anything else."""
        sequences = tuple(SequenceScore(**row) for row in told["sequences"])
        speed = None if told["pairs_per_s"] is None else float(told["pairs_per_s"])
        counts, scores = (int(told["pairs"]), int(told["parameters"])), (float(told["auc"]), float(told["p20"]))
        return cls(variant, counts[0], speed, counts[1], *scores, sequences)


@dataclass(frozen=True, slots=True)
class SweepPoint:
    """Mean scores with w1 at `w1`."""

    w1: float
    auc: float
    p20: float

    @classmethod
    def from_json(cls, told: dict[str, Any]) -> SweepPoint:
        """Back from `as_json`. Raises KeyError, TypeError or ValueError for anything else."""
        return cls(float(told["w1"]), float(told["auc"]), float(told["p20"]))

    def as_json(self) -> dict[str, float]:
        """Plain numbers."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Ablation:
    """All variants, in the paper's order, and the sweep (empty when there was none)."""

    recipe: str
    size: str
    footage: tuple[str, ...]
    tracks: Tracks
    variants: tuple[VariantResult, ...]
    sweep: tuple[SweepPoint, ...]

    def as_json(self) -> dict[str, Any]:
        """For ablation.json."""
        return {
            "recipe": self.recipe,
            "size": self.size,
            "footage": list(self.footage),
            "starts": self.tracks.starts,
            "max_frames": self.tracks.max_frames,
            "note": NOT_A_REPRODUCTION,
            "variants": [result.as_json() for result in self.variants],
            "w1_sweep": [point.as_json() for point in self.sweep],
            "paper_best_w1": PAPER_BEST_W1,
        }
