"""Lines of annotation files: boxes, 0/1 flags. Errors name the file and the line."""

from __future__ import annotations

import math
import re
from pathlib import Path

from tracker.benchmark.sequence import ReadError
from tracker.box import Box

_SEPARATOR = re.compile(r"\s*[,;]\s*|\s+")
_ROW = 4


def read_boxes(path: Path) -> tuple[Box | None, ...]:
    """Rows `x,y,w,h` (comma, semicolon, tab or spaces); None where one is not finite or has no positive size.

    A byte-order mark, any line ends and blank lines at the end are accepted. Raises ReadError with file and line.
    """
    return tuple(_box(line, f"{path}:{number}") for number, line in enumerate(_lines(path), 1))


def read_flags(path: Path) -> tuple[bool, ...]:
    """Numbers 0 or 1, in one line or one a line. Raises ReadError with file and line."""
    flags: list[bool] = []
    for number, line in enumerate(_lines(path), 1):
        for word in _SEPARATOR.split(line.strip(" \t,;")):
            value = _number(word, f"{path}:{number}")
            if value not in (0.0, 1.0):
                raise ReadError(f"{path}:{number}", f"{word!r} where a 0 or a 1 must be")
            flags.append(value == 1.0)
    return tuple(flags)


def _box(line: str, where: str) -> Box | None:
    words = _SEPARATOR.split(line.strip(" \t,;"))
    if words == [""]:
        raise ReadError(where, "an empty line between rows: each image needs its row (NaN,NaN,NaN,NaN: no target)")
    if len(words) != _ROW:
        raise ReadError(where, f"{len(words)} numbers where 4 must be (x,y,w,h)")
    x, y, w, h = (_number(word, where) for word in words)
    box = Box.from_xywh(x, y, w, h) if all(math.isfinite(v) for v in (x, y, w, h)) else None
    return box if box is not None and box.is_valid else None


def _number(word: str, where: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise ReadError(where, f"{word!r} is not a number") from None


def _lines(path: Path) -> list[str]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ReadError(str(path), f"cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise ReadError(str(path), "is not a text file (UTF-8)") from None
    lines = text.rstrip().splitlines()
    if not lines:
        raise ReadError(str(path), "is empty")
    return lines
