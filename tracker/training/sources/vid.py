"""ImageNet VID as published (image-net.org): an XML for each frame, Annotations/VID/train beside Data/VID/train."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from tracker.training.recipe import Vid
from tracker.training.source_names import source_name
from tracker.training.sources.limits import Choice
from tracker.training.sources.pictures import Listing
from tracker.training.sources.table import Rows
from tracker.training.sources.table_source import TableSource, finish
from tracker.training.sources.text import XYWH, need_folder, valid_box, whole_px
from tracker.training.types import Skipped

ANNOTATIONS, DATA = "Annotations/VID/train", "Data/VID/train"
EXPECTED = f"the folder ILSVRC2015 that holds {ANNOTATIONS} and {DATA}"
FRAME_DIGITS = 10  # fewer fit 32 bits
SUFFIXES = (".JPEG", ".jpg", ".jpeg")


class _Object(NamedTuple):
    track: str
    label: str | None
    box: XYWH


def open_vid(spec: Vid, root: Path, reserved: frozenset[str]) -> TableSource:
    """A track for each track id of a video; its label is the WordNet id. Every XML is read: minutes for all of VID."""
    folder = root / spec.path
    annotations = need_folder(folder / ANNOTATIONS, "path", EXPECTED)
    pictures = need_folder(folder / DATA, "path", EXPECTED)
    skipped, rows = Skipped(), Rows()
    choice, listing, names = Choice(spec, reserved, skipped), Listing(pictures), []
    for place, files in _videos(annotations):
        name = place.rpartition("/")[2]
        names.append(name)
        if choice.admits(name):
            _add_video(annotations, place, files, listing, rows, skipped)
    choice.close(f"path {folder}", names)
    return TableSource(source_name(spec), spec, finish(rows, spec, skipped, str(folder)), pictures, skipped)


def _videos(annotations: Path) -> Iterator[tuple[str, list[str]]]:
    """Folder (relative) and XML files of each video, in a fixed order."""
    for place, folders, files in os.walk(annotations):
        folders.sort()
        xml = sorted(f for f in files if f.endswith(".xml"))
        if xml:
            yield Path(place).relative_to(annotations).as_posix(), xml


def _add_video(annotations: Path, place: str, files: list[str], listing: Listing, rows: Rows, skipped: Skipped) -> None:
    tracks: dict[str, int] = {}
    name = place.rpartition("/")[2]
    for position, file in enumerate(files):
        path = annotations / place / file
        stem = path.stem
        picture = next((p for s in SUFFIXES if listing.has(p := f"{place}/{stem}{s}")), None)
        if picture is None:
            skipped.add("annotation whose picture is missing", str(path))
            continue
        try:
            size, objects = _read(path, skipped)
        except (ElementTree.ParseError, OSError, ValueError, LookupError) as error:  # the last two: its encoding
            skipped.add("unreadable annotation", f"{path} ({error})")
            continue
        number = rows.picture(picture) if objects else 0
        frame = int(stem) if stem.isdecimal() and len(stem) < FRAME_DIGITS else position
        for item in objects:
            if item.track not in tracks:
                tracks[item.track] = rows.track(name, f"{name}/{item.track}", item.label)
            rows.add(tracks[item.track], number, frame, item.box, size)


def _read(path: Path, skipped: Skipped) -> tuple[tuple[int, int], list[_Object]]:
    """Size of the picture and its objects. Raises ParseError, OSError."""
    tree = ElementTree.parse(path).getroot()
    size = whole_px(tree.findtext("size/width")), whole_px(tree.findtext("size/height"))
    objects = []
    for item in tree.iter("object"):
        try:
            x1, y1, x2, y2 = (float(item.findtext(f"bndbox/{k}", "")) for k in ("xmin", "ymin", "xmax", "ymax"))
            box = valid_box((x1, y1, x2 - x1, y2 - y1))
        except ValueError:
            box = None
        track = item.findtext("trackid")
        if box is None or track is None:
            skipped.add("object without track or box", str(path))
        else:
            objects.append(_Object(track.strip(), item.findtext("name"), box))
    return size, objects
