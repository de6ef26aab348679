"""YouTube-BB as published (research.google.com/youtube-bb): a CSV without header, boxes relative to the picture."""

from __future__ import annotations

import math
import string
from array import array
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tracker.training.errors import TrainingError
from tracker.training.recipe import YoutubeBB
from tracker.training.source_names import source_name
from tracker.training.sources.limits import Choice
from tracker.training.sources.pictures import Listing
from tracker.training.sources.table import Rows
from tracker.training.sources.table_source import TableSource, finish
from tracker.training.sources.text import LARGEST_FRAME, XYWH, need_file, need_folder, open_text, read_rows, valid_box
from tracker.training.types import Skipped

COLUMNS = ("youtube_id", "timestamp_ms", "class_id", "class_name", "object_id", "object_presence")
FIELDS = COLUMNS[:5]  # those that a file name may be made of
EXPECTED = f"the published CSV: {','.join(COLUMNS)},xmin,xmax,ymin,ymax"
SEGMENT_GAP_MS = 5000  # annotated once a second: after a longer gap another segment begins, perhaps of another target
PRESENT = "present"
ABSENT: XYWH = (math.nan, math.nan, math.nan, math.nan)
RELATIVE = (1, 1)  # the size that boxes of shares are relative to


class _Object(NamedTuple):
    """What the rows of one target have in common."""

    video: str
    class_id: str
    class_name: str
    object_id: str

    @property
    def name(self) -> str:
        return f"{self.video}/{self.class_id}/{self.object_id}"


class _Published:
    """The rows of the CSV as arrays: object, time, and the box as shares of the picture (NaN where it is absent)."""

    def __init__(self) -> None:
        self.objects: list[_Object] = []
        self.object = array("i")
        self.time_ms = array("q")
        self.box = array("f")

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows by object and time, and for each row of the CSV which annotated moment of its video it is, from 0."""
        videos: dict[str, int] = {}
        video_of = np.array([videos.setdefault(o.video, len(videos)) for o in self.objects], np.int64)
        objects, times = np.array(self.object, np.int64), np.array(self.time_ms, np.int64)
        video = video_of[objects] if len(objects) else objects
        by_time = np.lexsort((times, video))
        v, t = video[by_time], times[by_time]
        step = np.ones(len(v), np.int64)
        step[1:] = (v[1:] != v[:-1]) | (t[1:] != t[:-1])
        count = np.cumsum(step)
        moment = np.empty_like(count)
        moment[by_time] = count - count[np.searchsorted(v, v)] if len(v) else count
        return np.lexsort((times, objects)), moment


def open_youtube_bb(spec: YoutubeBB, root: Path, reserved: frozenset[str]) -> TableSource:
    """A track for each object and segment; its frame numbers count the annotated moments of the video.

    Raises TrainingError.
    """
    table = need_file(root / spec.annotations, "annotations", EXPECTED)
    folder = need_folder(root / spec.images, "images", f"the frames, named {spec.pattern}")
    _check_pattern(spec.pattern)
    skipped, rows = Skipped(), Rows()
    published = _read(table, Choice(spec, reserved, skipped), skipped)
    _add(published, spec.pattern, Listing(folder), folder, rows, skipped)
    table_of = finish(rows, spec, skipped, str(table), relative=True)
    return TableSource(source_name(spec), spec, table_of, folder, skipped, relative=True)


def _check_pattern(pattern: str) -> None:
    """Raises TrainingError unless the pattern can be filled in from the columns, and tells the frames apart."""
    known = ", ".join(f"{{{field}}}" for field in FIELDS)
    try:
        fields = {field for _, field, _, _ in string.Formatter().parse(pattern) if field is not None}
        one = _path(pattern, _Object("a", "1", "b", "1"), 1)
        other = _path(pattern, _Object("a", "1", "b", "1"), 2)
    except (KeyError, IndexError, ValueError, AttributeError) as error:
        raise TrainingError(f"pattern {pattern}: cannot be filled in ({error}); it may hold {known}") from None
    if one == other or "youtube_id" not in fields:
        raise TrainingError(f"pattern {pattern}: needs {{youtube_id}} and {{timestamp_ms}}; it may hold {known}")


def _path(pattern: str, item: _Object, time_ms: int) -> str:
    return pattern.format(
        youtube_id=item.video,
        timestamp_ms=time_ms,
        class_id=int(item.class_id),
        class_name=item.class_name,
        object_id=int(item.object_id),
    )


def _read(table: Path, choice: Choice, skipped: Skipped) -> _Published:
    out = _Published()
    objects: dict[tuple[str, str, str], int] = {}
    admitted: dict[str, bool] = {}
    with open_text(table) as file:
        for line, row in read_rows(file):
            if row and row[0] == COLUMNS[0]:  # a header, which some copies have
                continue
            try:
                video, time_ms, box = row[0], int(float(row[1])), _box(row)
                key = (video, str(int(row[2])), str(int(row[4])))
                if not 0 <= time_ms <= LARGEST_FRAME:  # 24 days
                    raise ValueError("no time")
            except (ValueError, IndexError, OverflowError):
                skipped.add("corrupt row", f"{table}:{line}")
                continue
            if video not in admitted:
                admitted[video] = choice.admits(video)
            if not admitted[video]:
                continue
            if key not in objects:
                objects[key] = len(objects)
                out.objects.append(_Object(video, key[1], row[3], key[2]))
            out.object.append(objects[key])
            out.time_ms.append(time_ms)
            out.box.extend(box)
    choice.close(f"annotations {table}", admitted)
    return out


def _box(row: list[str]) -> XYWH:
    """The box of a row as x, y, w, h, NaN where the object is not present. Raises ValueError, IndexError."""
    if row[5] != PRESENT:
        return ABSENT
    x1, x2, y1, y2 = (float(cell) for cell in row[6:10])
    box = valid_box((x1, y1, x2 - x1, y2 - y1))
    if box is None:
        raise ValueError("no size")
    return box


def _add(published: _Published, pattern: str, listing: Listing, folder: Path, rows: Rows, skipped: Skipped) -> None:
    order, moment = published.moments()
    boxes = np.array(published.box, np.float64).reshape(-1, 4)
    last, segment, track, last_ms = -1, 0, -1, 0
    for row in order.tolist():
        item, time_ms = published.object[row], published.time_ms[row]
        if item != last:
            last, segment, track = item, 0, -1
        elif time_ms - last_ms > SEGMENT_GAP_MS:
            segment, track = segment + 1, -1
        last_ms = time_ms
        if np.isnan(boxes[row, 0]):
            continue
        target = published.objects[item]
        path = _path(pattern, target, time_ms)
        if not listing.has(path):
            skipped.add("missing picture", str(folder / path))
            continue
        if track < 0:
            track = rows.track(target.video, f"{target.name}.{segment}" if segment else target.name, target.class_name)
        x, y, w, h = boxes[row].tolist()
        rows.add(track, rows.picture(path), int(moment[row]), (x, y, w, h), RELATIVE)
