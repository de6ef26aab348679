"""Where the parts of one sequence lie, and how they become a Sequence: the same for every layout."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from tracker.benchmark.attributes import FLAGS
from tracker.benchmark.readers.rows import read_boxes, read_flags
from tracker.benchmark.sequence import DEFAULT_FPS, Problem, ReadError, Sequence, make_sequence
from tracker.box import Box

IMAGE_SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".bmp"})
_DIGITS = re.compile(r"(\d+)")


@dataclass(frozen=True, slots=True)
class Entry:
    """A sequence that was found but not read. `frames` are the numbers of its first and last image, both included;
    None: the whole folder. `absence` marks frames without a target by 1. `attributes` holds the data set's flags.
    """

    name: str
    dataset: str
    pictures: Path
    truth: Path
    fps: float = DEFAULT_FPS
    frames: tuple[int, int] | None = None
    absence: Path | None = None
    attributes: Path | None = None


def read_entry(entry: Entry) -> tuple[Sequence | None, list[Problem]]:
    """The sequence, and what was wrong. A sequence whose attributes cannot be read is kept, without attributes."""
    attributes, problems = _attributes(entry)
    try:
        images = images_of(entry.pictures, entry.frames)
        truth = _truth(entry)
        sequence = make_sequence(
            entry.name, entry.dataset, images, truth, str(entry.truth), fps=entry.fps, attributes=attributes
        )
    except ReadError as error:
        return None, [*problems, Problem(error.where, error.message)]
    return sequence, problems


def images_of(folder: Path, frames: tuple[int, int] | None = None) -> tuple[Path, ...]:
    """Pictures of a folder by number (2 before 10), of these numbers only when given. Raises ReadError."""
    try:
        names = [p.name for p in folder.iterdir()]
    except OSError as error:
        raise ReadError(str(folder), f"cannot be read: {error.strerror or error}") from None
    names = [n for n in names if not n.startswith(".") and Path(n).suffix.lower() in IMAGE_SUFFIXES]
    if not names:
        raise ReadError(str(folder), "holds no images (" + ", ".join(sorted(IMAGE_SUFFIXES)) + ")")
    if frames is not None:
        names = [n for n in names if frames[0] <= _number(n) <= frames[1]]
    return tuple(folder / n for n in sorted(names, key=_natural))


def has_images(folder: Path) -> bool:
    """At least one picture lies directly in the folder."""
    try:
        return any(p.suffix.lower() in IMAGE_SUFFIXES and not p.name.startswith(".") for p in folder.iterdir())
    except OSError:
        return False


def subfolders(folder: Path) -> list[Path]:
    """Folders in it by name, hidden ones left out; empty when it cannot be read."""
    try:
        return sorted(p for p in folder.iterdir() if not p.name.startswith(".") and p.is_dir())
    except OSError:
        return []


def first_file(*candidates: Path) -> Path | None:
    """The first of these that is a file."""
    return next((p for p in candidates if p.is_file()), None)


def _truth(entry: Entry) -> tuple[Box | None, ...]:
    if not entry.truth.exists():
        raise ReadError(str(entry.truth), f"no such file: the images in {entry.pictures} have no annotation")
    boxes = read_boxes(entry.truth)
    if entry.absence is None:
        return boxes
    absent = read_flags(entry.absence)
    if len(absent) != len(boxes):
        raise ReadError(str(entry.absence), f"{len(absent)} marks for {len(boxes)} rows of {entry.truth.name}")
    return tuple(None if gone else box for box, gone in zip(boxes, absent, strict=True))


def _attributes(entry: Entry) -> tuple[frozenset[str], list[Problem]]:
    names = FLAGS.get(entry.dataset)
    if entry.attributes is None or names is None:
        return frozenset(), []
    try:
        flags = read_flags(entry.attributes)
    except ReadError as error:
        return frozenset(), [Problem(error.where, f"{error.message}; the sequence is used without attributes")]
    if len(flags) != len(names):
        message = f"{len(flags)} flags where {entry.dataset} has {len(names)}; the sequence is used without attributes"
        return frozenset(), [Problem(str(entry.attributes), message)]
    return frozenset(name for name, flag in zip(names, flags, strict=True) if flag), []


def _number(name: str) -> int:
    digits = _DIGITS.findall(Path(name).stem)
    return int(digits[-1]) if digits else -1


def _natural(name: str) -> tuple[str | int, ...]:
    # words and numbers alternate, beginning with a word, so that two names compare piece by piece
    return tuple(int(part) if i % 2 else part for i, part in enumerate(_DIGITS.split(name)))
