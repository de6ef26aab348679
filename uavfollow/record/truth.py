"""Ground-truth files: a row x,y,w,h per frame, NaN (or no positive size) where the target is absent."""

from __future__ import annotations

import math
import re
from pathlib import Path

from tracker.box import Box
from uavfollow.errors import InputError

COLUMNS = 4
MAX_PX = 1e6  # no picture is so large


def read_truth(path: Path) -> list[Box | None]:
    """One box per row, None where absent; separators are commas, blanks or tabs. Raises InputError."""
    try:
        text = path.read_text(encoding="utf-8-sig")  # spreadsheets write a byte-order mark
    except OSError as error:
        raise InputError(f"--truth {path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise InputError(f"--truth {path}: cannot be read: it is not UTF-8 text") from error
    rows = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    if not rows:
        raise InputError(f"--truth {path}: the file is empty")
    return [_row(path, number, line) for number, line in rows]


def _row(path: Path, number: int, line: str) -> Box | None:
    parts = [p for p in re.split(r"[,\s]+", line.strip()) if p]
    try:
        values = [float(p) for p in parts]
    except ValueError as error:
        raise InputError(f"--truth {path}, line {number}: {line.strip()!r} is not x,y,w,h") from error
    if len(values) != COLUMNS:
        raise InputError(f"--truth {path}, line {number}: {len(values)} numbers, expected x,y,w,h")
    if any(math.isinf(v) or abs(v) > MAX_PX for v in values):
        raise InputError(f"--truth {path}, line {number}: {line.strip()!r} is no place in a picture; absent is nan")
    box = Box.from_xywh(*values)
    return box if box.is_valid else None


def check_length(path: Path, truth: list[Box | None], frames: int) -> None:
    """Raise InputError unless there is a row for each frame."""
    if len(truth) != frames:
        raise InputError(f"--truth {path}: {len(truth)} rows for {frames} frames; there must be one row per frame")
