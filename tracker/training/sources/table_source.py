"""A source whose pictures are files and whose targets are a table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tracker.box import Box
from tracker.messages import ImageU8
from tracker.training.errors import TrainingError
from tracker.training.recipe import SourceBase
from tracker.training.sources.faults import UnusableBox
from tracker.training.sources.limits import Limits
from tracker.training.sources.pictures import mean_colour, read_picture
from tracker.training.sources.table import Rows, Table, Tracks
from tracker.training.sources.text import XYWH
from tracker.training.types import Skipped, Track, View


class TableSource:
    """Implements types.Source. `relative`: the table's boxes are shares of the picture's width and height."""

    def __init__(
        self, name: str, spec: SourceBase, table: Table, folder: Path, skipped: Skipped, relative: bool = False
    ) -> None:
        self.name = name
        self.frame_range = spec.frame_range
        self.tracks: Sequence[Track] = Tracks(table, name)
        self.skipped = skipped
        self._table, self._folder, self._limits, self._relative = table, folder, Limits.of(spec), relative

    def view(self, track: int, index: int) -> View | str:
        """The picture of `tracks[track].frames[index]` with the target's box, or path and fault in one line."""
        first, end = self._table.first[track], self._table.first[track + 1]
        row = int(first) + range(int(end - first))[index]
        name, frame = self._table.pictures[int(self._table.picture[row])], int(self._table.frame[row])
        image = self._read(self._folder / name, frame)
        if isinstance(image, str):
            return image
        x, y, w, h = (float(v) for v in self._table.box[row])
        height, width = image.shape[:2]
        box = (x * width, y * height, w * width, h * height) if self._relative else (x, y, w, h)
        fault = self._fault(box, width, height)
        if fault:
            return UnusableBox(f"{self._folder / name}: {fault} (frame {frame}, picture of {width}x{height} px)")
        return View(image, Box.from_xywh(*box), mean_colour(image))

    def _read(self, path: Path, frame: int) -> ImageU8 | str:
        return read_picture(path)

    def _fault(self, box: XYWH, width: int, height: int) -> str | None:
        x, y, w, h = box
        if x >= width or y >= height or x + w <= 0 or y + h <= 0:
            return "box outside the picture"
        size = np.array([[w, h]]) if self._relative else np.full((1, 2), np.nan)  # the others were judged on opening
        broken = int(self._limits.broken(size, np.array([w * h / (width * height)]))[0])
        return self._limits.kinds[broken] if broken >= 0 else None


def finish(rows: Rows, spec: SourceBase, skipped: Skipped, where: str, relative: bool = False) -> Table:
    """The table of a source. Raises TrainingError saying what was skipped when there is nothing to train on."""
    table = rows.finish(Limits.of(spec), spec.stride, relative, skipped)
    if not len(table.names):
        why = "; ".join(skipped.lines()) or "there is no annotation in it"
        raise TrainingError(f"{where}: no usable target. Skipped: {why}")
    return table
