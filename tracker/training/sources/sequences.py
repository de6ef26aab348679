"""Sequences that are folders of pictures with a row of truth for each: to train on, or whole for validation."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import overload

from tracker.box import Box
from tracker.messages import ImageU8
from tracker.training.errors import TrainingError
from tracker.training.recipe import SourceBase
from tracker.training.sources.limits import Choice
from tracker.training.sources.pictures import SUFFIXES, picture_size, read_picture
from tracker.training.sources.table import UNKNOWN_SIZE, Rows, add_many
from tracker.training.sources.table_source import TableSource, finish
from tracker.training.sources.text import XYWH
from tracker.training.types import Footage, Skipped

UNREADABLE = "unreadable sequence"
EMPTY = "sequence without a picture with a box"
_DIGITS = re.compile(r"(\d+)")


@dataclass(frozen=True, slots=True)
class SequenceFiles:
    """A sequence on disk: its pictures in order, relative to the source's folder, and where the target is in each."""

    name: str
    label: str | None
    pictures: tuple[str, ...]
    truth: tuple[XYWH | None, ...]


class PictureFiles(Sequence[ImageU8]):
    """Pictures that are read when asked for. Raises TrainingError for one that cannot be read."""

    def __init__(self, folder: Path, names: Sequence[str]) -> None:
        self._folder, self._names = folder, tuple(names)

    def __len__(self) -> int:
        return len(self._names)

    @overload
    def __getitem__(self, index: int) -> ImageU8: ...
    @overload
    def __getitem__(self, index: slice) -> PictureFiles: ...
    def __getitem__(self, index: int | slice) -> ImageU8 | PictureFiles:
        if isinstance(index, slice):
            return PictureFiles(self._folder, self._names[index])
        image = read_picture(self._folder / self._names[index])
        if isinstance(image, str):
            raise TrainingError(f"{image}; validation needs every picture of a sequence")
        return image


def join(
    folder: Path,
    name: str,
    label: str | None,
    inside: str,
    truth: list[XYWH | None],
    absent: set[int],
    skipped: Skipped,
) -> SequenceFiles:
    """Pictures and truth of a sequence as far as both go; a surplus of either is counted.

    `inside`: the folder of the pictures relative to `folder`; `absent`: frames without the target whatever their row.
    """
    pictures = list_pictures(folder, inside)
    length = min(len(pictures), len(truth))
    add_many(skipped, "picture without a row", len(pictures) - length, lambda i: str(folder / pictures[length + i]))
    add_many(skipped, "row without a picture", len(truth) - length, lambda i: f"{name} row {length + i + 1}")
    boxes = (None if i in absent else box for i, box in enumerate(truth[:length]))
    return SequenceFiles(name, label, tuple(pictures[:length]), tuple(boxes))


def list_pictures(folder: Path, inside: str) -> list[str]:
    """The picture files of a folder relative to `folder`, in the order of their numbers (2.jpg before 10.jpg)."""
    names = [e.name for e in (folder / inside).iterdir() if e.suffix.lower() in SUFFIXES and e.name[0] != "."]
    return [f"{inside}/{name}" for name in sorted(names, key=natural)]


def natural(name: str) -> list[tuple[int, str]]:
    """A sort key that takes runs of digits as numbers."""
    return [(int(part), part) if part.isdecimal() else (0, part) for part in _DIGITS.split(name)]


def source_of(
    sequences: Iterable[SequenceFiles], name: str, spec: SourceBase, folder: Path, skipped: Skipped
) -> TableSource:
    """A source of these sequences, a track each. Raises TrainingError when nothing is left."""
    rows = Rows()
    for sequence in sequences:
        size = picture_size(folder / sequence.pictures[0]) or UNKNOWN_SIZE  # one size in the whole of a video
        track = rows.track(sequence.name, sequence.name, sequence.label)
        for frame, (path, box) in enumerate(zip(sequence.pictures, sequence.truth, strict=True)):
            if box is not None:
                rows.add(track, rows.picture(path), frame, box, size)
    return TableSource(name, spec, finish(rows, spec, skipped, str(folder)), folder, skipped)


def read_all(
    names: Iterable[str], read: Callable[[str], SequenceFiles], folder: Path, skipped: Skipped
) -> Iterator[SequenceFiles]:
    """The sequences that can be read and have a box; the others are counted."""
    for name in names:
        try:
            sequence = read(name)
        except (OSError, TrainingError) as error:
            skipped.add(UNREADABLE, f"{name} in {folder} ({error})")
            continue
        if any(sequence.truth):
            yield sequence
        else:
            skipped.add(EMPTY, f"{name} in {folder}")


def footage_of(sequences: Iterable[SequenceFiles], folder: Path, skipped: Skipped) -> list[Footage]:
    """The sequences whole. Raises TrainingError when one was left out, or there is none: scores must mean the same set.

    `skipped`: what the reading of `sequences` counts.
    """
    out = []
    for sequence in sequences:
        truth = tuple(None if box is None else Box.from_xywh(*box) for box in sequence.truth)
        out.append(Footage(sequence.name, truth, PictureFiles(folder, sequence.pictures)))
    lost = [line for line in skipped.lines() if UNREADABLE in line or EMPTY in line]
    if lost or not out:
        why = "; ".join(lost) or "nothing is left"
        raise TrainingError(f"{folder}: cannot validate on it: {why}. Repair it, or choose with only and exclude")
    return out


def is_one_sequence(folder: Path) -> TrainingError:
    """What to say of a sequence that was given in place of the folder of sequences that it lies in."""
    place = folder.resolve()
    return TrainingError(
        f"path {folder}: is a sequence itself; give its parent, path: {place.parent}, and only: [{place.name}]"
    )


def chosen(names: Iterable[str], choice: Choice, where: str) -> list[str]:
    """The names that a source may use, in the given order. Raises TrainingError for one in `only` that is not there."""
    known = list(names)
    admitted = [name for name in known if choice.admits(name)]
    choice.close(where, known)
    return admitted
