"""What sources and the simulator's sequences are called. Looks at no disk."""

from __future__ import annotations

from pathlib import Path

from tracker.training.recipe import AnySource, Coco, Packed, Simulator, Stills, YoutubeBB

COMMON_STEMS = frozenset(("annotations", "annotation", "labels", "boxes", "train", "val"))  # say nothing of the set


def source_name(spec: AnySource) -> str:
    """The recipe's name; else the folder's, or the table's without suffix (its folder's when many are called so).

    Looks at no disk: a recipe's sources have the same names wherever its data lies.
    """
    if spec.name:
        return spec.name
    if isinstance(spec, Simulator):
        return spec.kind
    if isinstance(spec, Packed):
        return spec.set_name
    if not isinstance(spec, (Coco, Stills, YoutubeBB)):
        return Path(spec.path).name or spec.kind
    table = Path(spec.annotations)
    stem = table.name.split(".")[0]
    return (table.parent.name if stem in COMMON_STEMS else stem) or spec.kind


def simulated_name(seed: int) -> str:
    """Name of the sequence that the simulator draws in the world of a seed."""
    return f"sim-{seed:06d}"
