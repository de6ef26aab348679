"""COCO as published (cocodataset.org): instances_*.json with the pictures of one folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

from tracker.training.errors import TrainingError
from tracker.training.recipe import Coco
from tracker.training.source_names import source_name
from tracker.training.sources.limits import Choice
from tracker.training.sources.pictures import Listing
from tracker.training.sources.table import Rows
from tracker.training.sources.table_source import TableSource, finish
from tracker.training.sources.text import need_file, need_folder, open_text, valid_box, whole_px
from tracker.training.types import Skipped

LISTS = ("images", "annotations", "categories")
EXPECTED = "the published instances_train2017.json or one like it"


class _Annotation(NamedTuple):
    number: Any
    image: Any
    category: Any
    box: Any
    crowd: Any


class _Image(NamedTuple):
    path: str
    number: int
    size: tuple[int, int]


def open_coco(spec: Coco, root: Path, reserved: frozenset[str]) -> TableSource:
    """Every annotation that is no crowd is a track of one frame; its label is the category's name."""
    table = need_file(root / spec.annotations, "annotations", EXPECTED)
    folder = need_folder(root / spec.images, "images", "the folder of the pictures that the annotations name")
    content, skipped, rows = _load(table), Skipped(), Rows()
    labels = {c["id"]: str(c.get("name")) for c in content["categories"] if isinstance(c, dict) and _is_id(c.get("id"))}
    images = _images(content["images"], spec, folder, reserved, rows, skipped, table)
    for annotation in content["annotations"]:
        fault = _add(annotation, images, labels, rows)
        if fault:
            number = annotation.number if isinstance(annotation, _Annotation) else annotation
            skipped.add(fault, f"{table} annotation {number}")
    return TableSource(source_name(spec), spec, finish(rows, spec, skipped, str(table)), folder, skipped)


def _add(annotation: Any, images: dict[Any, _Image | None], labels: dict[Any, str], rows: Rows) -> str | None:
    """Add one annotation, or say what is wrong with it."""
    if not isinstance(annotation, _Annotation) or not _is_id(annotation.image) or annotation.image not in images:
        return "annotation without a box or a picture"
    if annotation.crowd:
        return "crowd"
    image = images[annotation.image]
    if image is None:
        return None  # the picture was left out, and counted there
    try:
        box = valid_box([float(v) for v in annotation.box])
    except (TypeError, ValueError, OverflowError):
        box = None
    if box is None:
        return "annotation without a box or a picture"
    track = rows.track(
        image.path,
        f"{image.path}#{annotation.number}",
        labels.get(annotation.category) if _is_id(annotation.category) else None,
    )
    rows.add(track, image.number, 0, box, image.size)
    return None


def _is_id(value: object) -> bool:
    return isinstance(value, (int, str))


def _images(
    entries: list[Any], spec: Coco, folder: Path, reserved: frozenset[str], rows: Rows, skipped: Skipped, table: Path
) -> dict[Any, _Image | None]:
    """The pictures by their id; None for those that are not used."""
    choice, listing = Choice(spec, reserved, skipped), Listing(folder)
    images: dict[Any, _Image | None] = {}
    for entry in entries:
        if not (isinstance(entry, dict) and isinstance(entry.get("file_name"), str) and _is_id(entry.get("id"))):
            skipped.add("image entry without id or file_name", f"{table}: {str(entry)[:60]}")
            continue
        path = entry["file_name"]
        images[entry["id"]] = None
        if not choice.admits(path):
            continue
        if listing.has(path):
            size = (whole_px(entry.get("width")), whole_px(entry.get("height")))
            images[entry["id"]] = _Image(path, rows.picture(path), size)
        else:
            skipped.add("missing picture", str(folder / path))
    choice.close(f"annotations {table}")
    return images


def _load(table: Path) -> dict[str, list[Any]]:
    """The file with annotations as small tuples: outlines would take gigabytes."""
    try:
        with open_text(table) as file:
            content = json.load(file, object_hook=_small)
    except (ValueError, OSError, RecursionError) as error:  # ValueError: no JSON, or a number of thousands of digits
        raise TrainingError(f"annotations {table}: {error}; expected {EXPECTED}") from None
    lists: dict[str, list[Any]] = {}
    for key in LISTS:
        entries = content.get(key) if isinstance(content, dict) else None
        if not isinstance(entries, list):
            raise TrainingError(f"annotations {table}: no list {key} in it; expected {EXPECTED}")
        lists[key] = entries
    return lists


def _small(entry: dict[str, Any]) -> Any:
    if "image_id" not in entry:
        return entry
    return _Annotation(*(entry.get(k) for k in ("id", "image_id", "category_id", "bbox", "iscrowd")))
