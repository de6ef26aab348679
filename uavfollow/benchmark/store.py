"""The folder of results: grows with every command, each result whole and with the key that it was made for."""

from __future__ import annotations

import csv
import json
from collections.abc import Container, Iterable, Iterator
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
COLUMNS = {
    "frame": "number of the image, from 0",
    "x": "left edge of the reported box, px; empty: no box",
    "y": "its top edge, px",
    "w": "its width, px",
    "h": "its height, px",
    "status": "of the target's estimate (docs/interfaces.md, section 4)",
    "reason": "why it is this status",
    "confidence": "0 to 1, of a bare tracker (+raw) its score; empty for frame 0, whose box was given, not measured",
    "alarms": "raised at this image, with blanks between them",
    "memory": "which exemplar was replaced at this image; empty: none",
    "memory_x": "left edge of the box that was written to it, px",
    "memory_y": "its top edge, px",
    "memory_w": "its width, px",
    "memory_h": "its height, px",
}
NO_BOX = ("", "", "", "")


@dataclass(frozen=True, slots=True)
class Header:
    """What stands beside the rows of a result: `SEQUENCE.json`. `images` is the folder of its images."""

    key: str
    tracker: str
    sequence: str
    images: str
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
                rows = tuple(_row(number, values) for number, values in enumerate(csv.DictReader(file)))
        except (OSError, ValueError, TypeError, KeyError):
            return None
        return Result(header, rows) if len(rows) == header.frames else None

    def write(self, job: Job, track: Track) -> None:
        """Put a result into place. The header comes last: without it there is no result.

        Raises InputError, which names the file, when it cannot be written.
        """
        header = Header(
            key=job.key,
            tracker=str(job.spec),
            sequence=job.name,
            images=_images(job),
            frames=len(track.rows),
            fps=job.sequence.fps,
            seconds=track.seconds,
            unread=track.unread,
            engine=track.engine,
            cpu=describe_cpu(),
            version=__version__,
        )
        path = self._path(job, ".json")
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.unlink(missing_ok=True)  # first: an old header must not vouch for new rows
        with placed(self._path(job, ".csv")) as part, part.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(COLUMNS)
            writer.writerows(_values(number, row) for number, row in enumerate(track.rows))
        with placed(self._path(job, ".txt")) as part:
            part.write_text("".join(f"{_xywh(row.box)}\n" for row in track.rows), encoding="utf-8")
        write_json(path, {name: getattr(header, name) for name in Header.__slots__})

    def check_replaces(self, jobs: Iterable[Job]) -> None:
        """Raise InputError when the result of one of them would replace that of another sequence of the same name."""
        for job in jobs:
            path = self._path(job, ".json")
            try:
                there = Path(json.loads(path.read_text(encoding="utf-8"))["images"])
            except (OSError, ValueError, TypeError, KeyError):
                continue
            if there.is_dir() and str(there) != _images(job):  # one that was moved is not there any more
                raise InputError(
                    f"{path}: holds the result of another sequence with this name, {there}, and that of {_images(job)} "
                    "would replace it; choose another --out, or delete it"
                )

    def further(self, labels: Container[str]) -> tuple[str, ...]:
        """Trackers that have results in the folder and are none of these."""
        found = {path.parent.parent.name for path in self.folder.glob("*/*/*.json")}
        return tuple(sorted(name for name in found if name not in labels))

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
            with writing(left):
                left.unlink(missing_ok=True)
        yield Store(folder)


@contextmanager
def placed(path: Path) -> Iterator[Path]:
    """A name to write to, moved to `path` when complete; nothing is left after an error. Raises InputError."""
    part = path.with_name(f"{PART}{path.name}")
    with writing(path):
        try:
            yield part
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """For what writes `path`: raises InputError, which names it, in place of OSError (a full disk, no rights)."""
    try:
        yield
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror or error}); make room or rights there, or choose another "
            "--out. What was finished is kept, and the same command goes on from there"
        ) from error


def write_json(path: Path, values: dict[str, Any]) -> None:
    """Plain values as a file, replaced whole."""
    with placed(path) as part:
        part.write_text(json.dumps(values, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _images(job: Job) -> str:
    return str(job.sequence.images[0].parent.resolve())


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
    confidence = "" if row.confidence is None else f"{row.confidence:.6f}"
    return (number, *_cells(row.box), row.status.value, row.reason.value, confidence, alarms, *memory)


def _cells(box: Box | None) -> tuple[str, ...]:
    return NO_BOX if box is None else tuple(f"{v:.4f}" for v in box.to_xywh())


def _xywh(box: Box | None) -> str:
    """As the field's result files have it."""
    return ",".join(_cells(box)) if box is not None else "nan,nan,nan,nan"


def _row(number: int, values: dict[str, str]) -> Row:
    """Raises ValueError or KeyError when it is no row of ours."""
    box = _box(values["x"], values["y"], values["w"], values["h"])
    memory_box = _box(*(values[f"memory_{side}"] for side in "xywh"))
    memory = None if memory_box is None else MemoryWrite(MemorySlot(values["memory"]), memory_box)
    return Row(
        box=box,
        status=TargetStatus(values["status"]),
        reason=TargetReason(values["reason"]),
        confidence=float(values["confidence"]) if number or values["confidence"] else None,
        alarms=tuple(TargetAlarm(name) for name in values["alarms"].split()),
        memory=memory,
    )


def _box(x: str, y: str, w: str, h: str) -> Box | None:
    return Box.from_xywh(float(x), float(y), float(w), float(h)) if x else None
