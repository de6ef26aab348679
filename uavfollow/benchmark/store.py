"""The folder of results: grows with every command, each result whole and with the key that it was made for."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tracker.box import Box
from tracker.engines.cpu import describe_cpu
from tracker.messages import MemorySlot, MemoryWrite, TargetAlarm, TargetReason, TargetStatus
from uavfollow import __version__
from uavfollow.benchmark.job import Job, Row, Track
from uavfollow.errors import InputError
from uavfollow.training.lock import LOCK, held

MARKER = "bench.json"
MARK = {"what": "results of uavfollow bench track", "schema": 1}
PART = ".part-"
COLUMNS = (
    "frame", "x", "y", "w", "h", "status", "reason", "confidence", "alarms",
    "memory", "memory_x", "memory_y", "memory_w", "memory_h",
)  # fmt: skip
NO_BOX = ("", "", "", "")


@dataclass(frozen=True, slots=True)
class Header:
    """What stands beside the rows of a result: `SEQUENCE.json`."""

    key: str
    tracker: str
    sequence: str
    frames: int
    fps: float
    seconds: float
    unread: int
    engine: str
    cpu: str
    version: str


@dataclass(frozen=True, slots=True)
class Result:
    """A finished sequence as it lies in the folder."""

    header: Header
    rows: tuple[Row, ...]


class Store:
    """Results in a folder that is ours: TRACKER/DATASET/SEQUENCE.csv with .txt (x,y,w,h) and .json beside it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def read(self, job: Job) -> Result | None:
        """The result of a job, None when there is none for its key or it cannot be read: then it is made again."""
        try:
            header = Header(**json.loads(self._path(job, ".json").read_text(encoding="utf-8")))
            if header.key != job.key:
                return None
            with self._path(job, ".csv").open(newline="", encoding="utf-8") as file:
                rows = tuple(_row(values) for values in csv.DictReader(file))
        except (OSError, ValueError, TypeError, KeyError):
            return None
        return Result(header, rows) if len(rows) == header.frames else None

    def write(self, job: Job, track: Track) -> None:
        """Put a result into place. The header comes last: without it there is no result."""
        header = Header(
            key=job.key,
            tracker=str(job.spec),
            sequence=job.name,
            frames=len(track.rows),
            fps=job.sequence.fps,
            seconds=track.seconds,
            unread=track.unread,
            engine=track.engine,
            cpu=describe_cpu(),
            version=__version__,
        )
        path = self._path(job, ".json")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)  # first: an old header must not vouch for new rows
        with placed(self._path(job, ".csv")) as part, part.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(COLUMNS)
            writer.writerows(_values(number, row) for number, row in enumerate(track.rows))
        with placed(self._path(job, ".txt")) as part:
            part.write_text("".join(f"{_xywh(row.box)}\n" for row in track.rows), encoding="utf-8")
        write_json(path, {name: getattr(header, name) for name in Header.__slots__})

    def _path(self, job: Job, suffix: str) -> Path:
        return self.folder / job.spec.label / f"{job.name}{suffix}"


@contextmanager
def opened(folder: Path) -> Iterator[Store]:
    """The store of a folder, this process's alone inside. Raises InputError: files of something else, another run."""
    _check_ours(folder)
    with held(folder):
        _check_ours(folder)
        if not (folder / MARKER).exists():
            write_json(folder / MARKER, MARK)
        for left in folder.rglob(f"{PART}*"):  # of a run that was killed
            left.unlink(missing_ok=True)
        yield Store(folder)


@contextmanager
def placed(path: Path) -> Iterator[Path]:
    """A name to write to, moved to `path` when complete; nothing is left after an error."""
    part = path.with_name(f"{PART}{path.name}")
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def write_json(path: Path, values: dict[str, Any]) -> None:
    """Plain values as a file, replaced whole."""
    with placed(path) as part:
        part.write_text(json.dumps(values, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _check_ours(folder: Path) -> None:
    """Raise InputError when the folder holds files and is none of ours: sequences, say."""
    if not folder.is_dir():
        return  # what cannot be made is told by the lock
    names = sorted(p.name for p in folder.iterdir() if p.name != LOCK and not p.name.startswith(PART))
    if not names or _mark_of(folder) == MARK:
        return
    if MARKER in names:
        raise InputError(f"--out {folder}: its {MARKER} is not of this version of `bench track`; choose another folder")
    raise InputError(f"--out {folder}: files of something else lie there ({names[0]}, ...): choose another folder")


def _mark_of(folder: Path) -> Any:
    try:
        return json.loads((folder / MARKER).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _values(number: int, row: Row) -> tuple[object, ...]:
    memory = ("", *NO_BOX) if row.memory is None else (row.memory.slot.value, *_cells(row.memory.box))
    alarms = " ".join(alarm.value for alarm in row.alarms)
    return (
        number, *_cells(row.box), row.status.value, row.reason.value, f"{row.confidence:.6f}", alarms, *memory,
    )  # fmt: skip


def _cells(box: Box | None) -> tuple[str, ...]:
    return NO_BOX if box is None else tuple(f"{v:.4f}" for v in box.to_xywh())


def _xywh(box: Box | None) -> str:
    """As the field's result files have it."""
    return ",".join(_cells(box)) if box is not None else "nan,nan,nan,nan"


def _row(values: dict[str, str]) -> Row:
    """Raises ValueError or KeyError when it is no row of ours."""
    box = _box(values["x"], values["y"], values["w"], values["h"])
    memory_box = _box(*(values[f"memory_{side}"] for side in "xywh"))
    memory = None if memory_box is None else MemoryWrite(MemorySlot(values["memory"]), memory_box)
    return Row(
        box=box,
        status=TargetStatus(values["status"]),
        reason=TargetReason(values["reason"]),
        confidence=float(values["confidence"]),
        alarms=tuple(TargetAlarm(name) for name in values["alarms"].split()),
        memory=memory,
    )


def _box(x: str, y: str, w: str, h: str) -> Box | None:
    return Box.from_xywh(float(x), float(y), float(w), float(h)) if x else None
