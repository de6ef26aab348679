"""Video files beside tables of the same name: `NAME.mp4`, `NAME.csv` with frame (from 0), x, y, w, h, track, class."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import NamedTuple

from tracker.messages import ImageU8
from tracker.training.errors import TrainingError
from tracker.training.recipe import SourceBase, VideoFiles
from tracker.training.source_names import source_name
from tracker.training.sources.captures import Captures
from tracker.training.sources.limits import Choice
from tracker.training.sources.sequences import chosen, natural
from tracker.training.sources.table import Rows, Table, add_many
from tracker.training.sources.table_source import TableSource, finish
from tracker.training.sources.text import LARGEST_FRAME, XYWH, need_folder, read_table, valid_box
from tracker.training.types import Skipped

NEEDED = ("frame", "x", "y", "w", "h")
ALIASES = {**{column: (column,) for column in NEEDED}, "track": ("track", "track_id"), "class": ("class", "label")}
SUFFIXES = (".mp4", ".avi", ".mkv", ".mov", ".m4v", ".webm")
EXPECTED = "a folder of videos NAME.mp4 with tables NAME.csv beside them (frame,x,y,w,h[,track][,class])"


class VideoSource(TableSource):
    """A source whose pictures are frames of videos."""

    def __init__(self, name: str, spec: SourceBase, table: Table, folder: Path, skipped: Skipped) -> None:
        super().__init__(name, spec, table, folder, skipped)
        self._captures = Captures()

    def _read(self, path: Path, frame: int) -> ImageU8 | str:
        return self._captures.read(path, frame)


class _Row(NamedTuple):
    frame: int
    track: str
    label: str
    box: XYWH


def open_video_files(spec: VideoFiles, root: Path, reserved: frozenset[str]) -> VideoSource:
    """A track for each track and class of a table.

    Without a track column, frames with several boxes are left out: which box belongs to which is not known then.
    """
    folder, skipped, rows = need_folder(root / spec.path, "path", EXPECTED), Skipped(), Rows()
    videos = {p.stem: p.name for p in folder.iterdir() if p.suffix.lower() in SUFFIXES}
    tables = {p.stem: p for p in folder.iterdir() if p.suffix.lower() == ".csv"}
    if not tables:
        raise TrainingError(f"path {folder}: no table there; expected {EXPECTED}")
    for name in chosen(sorted(tables, key=natural), Choice(spec, reserved, skipped), f"path {folder}"):
        if name in videos:
            _add(name, videos[name], tables[name], rows, skipped)
        else:
            skipped.add("table without a video", str(tables[name]))
    for name in sorted(set(videos) - set(tables), key=natural):
        skipped.add("video without a table", str(folder / videos[name]))
    return VideoSource(source_name(spec), spec, finish(rows, spec, skipped, str(folder)), folder, skipped)


def _add(name: str, video: str, table: Path, rows: Rows, skipped: Skipped) -> None:
    found = _read(table, skipped)
    boxes_in = Counter(row.frame for row in found if not row.track)
    crowded = sorted(frame for frame, count in boxes_in.items() if count > 1)
    add_many(
        skipped, "frame with several boxes and no track column", len(crowded), lambda i: f"{table} frame {crowded[i]}"
    )
    picture, tracks = rows.picture(video), {}
    for row in found:
        if boxes_in[row.frame] > 1 and not row.track:
            continue
        key = (row.track, row.label)
        if key not in tracks:
            said = "/".join(part for part in (name, *key) if part)
            tracks[key] = rows.track(name, said, row.label or None)
        rows.add(tracks[key], picture, row.frame, row.box)


def _read(table: Path, skipped: Skipped) -> list[_Row]:
    out = []
    try:
        for line, row in read_table(table, ALIASES, NEEDED):
            try:
                frame = int(row["frame"])
                box = valid_box([float(row[column]) for column in NEEDED[1:]])
            except (KeyError, ValueError):
                frame, box = -1, None
            if box is None or not 0 <= frame <= LARGEST_FRAME:
                skipped.add("row without a frame and a box", f"{table}:{line}")
            else:
                out.append(_Row(frame, row.get("track", ""), row.get("class", ""), box))
    except (OSError, TrainingError) as error:
        skipped.add("unreadable table", str(error))
        return []
    return out
