"""A table of still pictures: CSV with the columns image, x, y, w, h and, if you like, class, img_w and img_h."""

from __future__ import annotations

from pathlib import Path

from tracker.training.recipe import Stills
from tracker.training.source_names import source_name
from tracker.training.sources.limits import Choice
from tracker.training.sources.pictures import Listing
from tracker.training.sources.table import Rows
from tracker.training.sources.table_source import TableSource, finish
from tracker.training.sources.text import need_file, need_folder, read_table, valid_box, whole_px
from tracker.training.types import Skipped

NEEDED = ("image", "x", "y", "w", "h")
ALIASES = {
    **{column: (column,) for column in NEEDED},
    "class": ("class", "label", "category"),
    "img_w": ("img_w",),
    "img_h": ("img_h",),
}
EXPECTED = "a CSV with the header image,x,y,w,h and, if you like, class"


def open_stills(spec: Stills, root: Path, reserved: frozenset[str]) -> TableSource:
    """Every row a track of one frame; a picture is a sequence by the name that the table gives it."""
    table = need_file(root / spec.annotations, "annotations", EXPECTED)
    folder = table.parent
    if spec.images is not None:
        folder = need_folder(root / spec.images, "images", "the folder that the image column is relative to")
    skipped, rows = Skipped(), Rows()
    choice, listing = Choice(spec, reserved, skipped), Listing(folder)
    pictures: dict[str, int | None] = {}
    for line, row in read_table(table, ALIASES, NEEDED):
        where = f"{table}:{line}"
        name = row.get("image", "").replace("\\", "/")
        try:
            box = valid_box([float(row[column]) for column in NEEDED[1:]])
        except (KeyError, ValueError):
            box = None
        if not name or box is None:
            skipped.add("row without an image and a box", where)
            continue
        if name not in pictures:
            pictures[name] = rows.picture(name) if choice.admits(name) and listing.has(name) else None
        picture = pictures[name]
        if picture is not None:
            track = rows.track(name, f"{name}:{line}", row.get("class") or None)
            rows.add(track, picture, 0, box, _size(row))
        elif not listing.has(name):
            skipped.add("row whose picture is missing", f"{folder / name} ({where})")
    choice.close(f"annotations {table}", pictures)
    return TableSource(source_name(spec), spec, finish(rows, spec, skipped, str(table)), folder, skipped)


def _size(row: dict[str, str]) -> tuple[int, int]:
    """The picture's, where the table has it: then a box too large for it is known without reading it."""
    return whole_px(row.get("img_w")), whole_px(row.get("img_h"))
