"""Text files as people publish them: any separator, byte order marks, Windows line ends, rows that are broken."""

from __future__ import annotations

import csv
import gzip
import io
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TextIO

from tracker.training.errors import TrainingError
from tracker.training.types import Skipped

XYWH = tuple[float, float, float, float]

SEPARATORS = ",;\t"
POLYGON_NUMBERS = 8  # VOT publishes four corners; their hull is the box
LARGEST_PX = 1e6  # no picture is larger; keeps what is read within single precision
LARGEST_FRAME = 2**31 - 1  # frame numbers are kept in 32 bits
_SPLIT = re.compile(r"[\s,;]+")


def need_folder(path: Path, key: str, expected: str) -> Path:
    """The path itself. Raises TrainingError naming it and the recipe's key when it is no folder."""
    if not path.is_dir():
        fault = "is a file, not a folder" if path.exists() else "no such folder"
        raise TrainingError(f"{key} {path}: {fault}; expected {expected}")
    return path


def need_file(path: Path, key: str, expected: str) -> Path:
    """The path itself. Raises TrainingError naming it and the recipe's key when it is no file."""
    if not path.is_file():
        fault = "is a folder, not a file" if path.exists() else "no such file"
        raise TrainingError(f"{key} {path}: {fault}; expected {expected}")
    return path


def open_text(path: Path) -> TextIO:
    """The file as text: UTF-8 with or without mark, wrong bytes replaced; `.gz` unpacked. Raises OSError."""
    raw = gzip.open(path, "rb") if path.suffix == ".gz" else path.open("rb")  # noqa: SIM115  (the caller closes it)
    return io.TextIOWrapper(raw, "utf-8-sig", "replace", newline="")


def read_text(path: Path) -> str:
    """The whole file. Raises OSError."""
    with open_text(path) as file:
        return file.read()


def read_lines(path: Path) -> list[tuple[int, str]]:
    """Number (from 1) and text of every line that is not blank. Raises OSError."""
    numbered = enumerate(read_text(path).splitlines(), 1)
    return [(number, line.strip()) for number, line in numbered if line.strip()]


def read_truth(path: Path, skipped: Skipped) -> list[XYWH | None]:
    """Boxes of a sequence, one row a frame: x, y, w, h or the four corners of a polygon; None where it is absent.

    NaN or a size that is not positive means absent. A row that is no row of numbers is counted and taken as absent.
    """
    boxes: list[XYWH | None] = []
    for number, line in read_lines(path):
        try:
            values = [float(token) for token in _SPLIT.split(line) if token]
        except ValueError:
            values = []
        if len(values) < 4:
            skipped.add("corrupt row", f"{path}:{number}")
            boxes.append(None)
        else:
            boxes.append(valid_box(_hull(values) if len(values) >= POLYGON_NUMBERS else values))
    return boxes


def valid_box(values: Sequence[float]) -> XYWH | None:
    """The first four numbers as a box, or None unless all are finite, sane and the size is positive."""
    x, y, w, h = values[:4]
    sane = all(math.isfinite(v) and abs(v) < LARGEST_PX for v in (x, y, w, h))
    if not sane or w <= 0 or h <= 0:
        return None
    return x, y, w, h


def whole_px(value: object) -> int:
    """A width or height as a whole number, 0 (unknown) for what is none."""
    try:
        size = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return 0
    return int(size) if 0 < size < LARGEST_PX else 0


def _hull(values: Sequence[float]) -> list[float]:
    xs, ys = values[0:POLYGON_NUMBERS:2], values[1:POLYGON_NUMBERS:2]
    return [min(xs), min(ys), max(xs) - min(xs), max(ys) - min(ys)]


def read_flags(path: Path) -> list[int]:
    """Whole numbers with any separators, as the label files have them; nothing when there is no such file.

    Raises TrainingError naming the file for anything that is no number.
    """
    if not path.is_file():
        return []
    try:
        return [int(float(token)) for token in _SPLIT.split(read_text(path)) if token]
    except (ValueError, OverflowError):
        raise TrainingError(f"{path}: expected whole numbers, one for each frame") from None


def read_table(
    path: Path, aliases: Mapping[str, Sequence[str]], needed: Sequence[str]
) -> Iterator[tuple[int, dict[str, str]]]:
    """Line number and known columns of each row; columns that a row lacks are missing in its dict.

    `aliases`: the names that each column may have in the header. Raises TrainingError without a usable header.
    """
    with open_text(path) as file:
        head = file.readline()
        while head and not head.strip():
            head = file.readline()
        separator = max(SEPARATORS, key=head.count)
        header = [cell.strip().lower() for cell in _header(path, head, separator)]
        places = {key: i for key, names in aliases.items() for i, cell in enumerate(header) if cell in names}
        missing = [key for key in needed if key not in places]
        if missing:
            raise TrainingError(
                f"{path}:1: no column {', '.join(missing)}; the first line must be a header with {', '.join(needed)}"
            )
        for number, row in read_rows(file, separator, first_line=2):
            yield number, {key: row[place] for key, place in places.items() if place < len(row)}


def _header(path: Path, head: str, separator: str) -> list[str]:
    try:
        return next(csv.reader([head], delimiter=separator), [])
    except csv.Error as error:
        raise TrainingError(f"{path}:1: no header of a CSV ({error}); is it another kind of file?") from error


def read_rows(file: TextIO, separator: str = ",", first_line: int = 1) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of each row that is not blank; a row that cannot be split has no cells."""
    reader = csv.reader(file, delimiter=separator)
    while True:
        try:
            row = [cell.strip() for cell in next(reader)]
        except StopIteration:
            return
        except csv.Error:
            row = []
        else:
            if not any(row):
                continue
        yield reader.line_num + first_line - 1, row
