"""What a source is called when the recipe does not say."""

from __future__ import annotations

from pathlib import Path

from tracker.training.recipe import AnySource, Coco, Packed, Simulator, SourceBase, Stills, YoutubeBB

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


def default_name(spec: SourceBase, path: Path) -> str:
    """The same for a section whose path is at hand."""
    return source_name(spec)  # type: ignore[arg-type]
