"""What a source knows of its targets, as flat arrays: small enough for a million boxes in every worker process."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from tracker.training.sources.limits import Limits
from tracker.training.sources.strings import Strings
from tracker.training.sources.text import XYWH
from tracker.training.types import NAMED_PER_KIND, Skipped, Track

Ints = npt.NDArray[Any]
NO_LABEL = -1
UNKNOWN_SIZE = (0, 0)


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Rows sorted by track and frame. `box` (N, 4) float32 x, y, w, h; rows of track t: first[t] to first[t + 1].

    `picture`, `frame` (N,); `label`, `group` (T,) are indices into `labels` (NO_LABEL: none) and `groups`.
    """

    pictures: Strings
    picture: Ints
    frame: Ints
    box: npt.NDArray[np.float32]
    first: Ints
    names: Strings
    label: Ints
    labels: tuple[str, ...]
    group: Ints
    groups: Strings


class Tracks(Sequence[Track]):
    """The tracks of a table, made when asked for. Groups carry the source's name: two sources may use the same."""

    def __init__(self, table: Table, source: str) -> None:
        self._table, self._source = table, source

    def __len__(self) -> int:
        return len(self._table.names)

    @overload
    def __getitem__(self, index: int) -> Track: ...
    @overload
    def __getitem__(self, index: slice) -> list[Track]: ...
    def __getitem__(self, index: int | slice) -> Track | list[Track]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        t, at = self._table, range(len(self))[index]
        frames = t.frame[t.first[at] : t.first[at + 1]].tolist()
        label = None if t.label[at] == NO_LABEL else t.labels[t.label[at]]
        return Track(t.names[at], tuple(frames), label, f"{self._source}/{t.groups[int(t.group[at])]}")


class Rows:
    """Collects the rows of a table while a data set is read, in any order."""

    def __init__(self) -> None:
        self._pictures: list[str] = []
        self._names: list[str] = []
        self._label = array("i")
        self._group = array("i")
        self._labels: dict[str, int] = {}
        self._groups: dict[str, int] = {}
        self._keys = array("i")  # track, picture, frame of each row
        self._boxes = array("f")
        self._sizes = array("i")

    def picture(self, path: str) -> int:
        """A number for a picture (or video), which the caller asks for once."""
        self._pictures.append(path)
        return len(self._pictures) - 1

    def track(self, group: str, name: str, label: str | None) -> int:
        """A number for a new track of the sequence or still picture `group`."""
        self._names.append(name)
        self._group.append(self._groups.setdefault(group, len(self._groups)))
        self._label.append(NO_LABEL if label is None else self._labels.setdefault(label, len(self._labels)))
        return len(self._names) - 1

    def add(self, track: int, picture: int, frame: int, box: XYWH, size: tuple[int, int] = UNKNOWN_SIZE) -> None:
        """One valid box in pixels, or relative to the picture when its size is given as (1, 1)."""
        self._keys.extend((track, picture, frame))
        self._boxes.extend(box)
        self._sizes.extend(size)

    def finish(self, limits: Limits, stride: int, relative: bool, skipped: Skipped) -> Table:
        """The table of what the limits leave: every `stride`-th frame of each track, tracks without any left out."""
        keys = np.frombuffer(self._keys, np.int32).reshape(-1, 3) if self._keys else np.zeros((0, 3), np.int32)
        boxes = np.frombuffer(self._boxes, np.float32).reshape(-1, 4) if self._keys else np.zeros((0, 4), np.float32)
        kept = self._within(limits, keys, boxes, relative, skipped)
        kept = kept[np.lexsort((keys[kept, 2], keys[kept, 0]))]
        kept = self._without_doubles(kept, keys, skipped)
        track = keys[kept, 0]
        place = np.arange(len(kept)) - np.searchsorted(track, track)  # within its track
        kept = kept[place % stride == 0]
        used, counts = np.unique(keys[kept, 0], return_counts=True)
        return Table(
            Strings(self._pictures),
            keys[kept, 1].copy(),
            keys[kept, 2].copy(),
            boxes[kept].copy(),
            np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
            Strings(self._names[t] for t in used),
            np.array(self._label, np.int32)[used],
            tuple(self._labels),
            np.array(self._group, np.int32)[used],
            Strings(self._groups),
        )

    def _within(
        self, limits: Limits, keys: Ints, boxes: npt.NDArray[np.float32], relative: bool, skipped: Skipped
    ) -> Ints:
        sizes = np.array(self._sizes, np.float64).reshape(-1, 2)
        sizes[sizes <= 0] = np.nan
        wide = boxes[:, 2:].astype(np.float64)
        share = wide.prod(axis=1) / sizes.prod(axis=1)
        broken = limits.broken(np.full_like(wide, np.nan) if relative else wide, share)
        for index, kind in enumerate(limits.kinds):
            self._count(kind, np.flatnonzero(broken == index), keys, skipped)
        return np.flatnonzero(broken < 0)

    def _without_doubles(self, kept: Ints, keys: Ints, skipped: Skipped) -> Ints:
        sorted_keys = keys[kept][:, [0, 2]]
        double = np.zeros(len(kept), bool)
        double[1:] = (sorted_keys[1:] == sorted_keys[:-1]).all(axis=1)
        self._count("second box of a track in one frame", kept[double], keys, skipped)
        return kept[~double]

    def _count(self, kind: str, rows: Ints, keys: Ints, skipped: Skipped) -> None:
        add_many(skipped, kind, len(rows), lambda i: f"{self._names[keys[rows[i], 0]]} frame {keys[rows[i], 2]}")


def add_many(skipped: Skipped, kind: str, count: int, name: Callable[[int], str]) -> None:
    """Count `count` of a kind at once; `name(i)` is asked only for those that are told in full."""
    if not count:
        return
    for i in range(min(count, NAMED_PER_KIND)):
        skipped.add(kind, name(i))
    skipped.counts[kind] += count - min(count, NAMED_PER_KIND)
