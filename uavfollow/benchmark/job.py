"""One tracker over one sequence: the unit of work, in this process or in a worker."""

from __future__ import annotations

import time
import traceback
from dataclasses import dataclass, replace
from pathlib import Path

from tracker.benchmark.sequence import Sequence, load_image
from tracker.box import Box
from tracker.loop import TrackLoop
from tracker.messages import Frame, MemoryWrite, TargetAlarm, TargetReason, TargetState, TargetStatus
from uavfollow.benchmark.options import Builder
from uavfollow.trackers import TrackerSpec, make_target
from uavfollow.workers import JobError, Tick

EDGE_PX = 1e-6  # a box cut exactly at the border may lie beyond it after rounding
THREADS = 1  # speeds are those of one thread, so that they do not depend on what else the machine does
ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, slots=True)
class Job:
    """`name` is DATASET/SEQUENCE; `key` says what the result depends on (`uavfollow/benchmark/plan.py`).

    `whole_frames`: images that the data set has of the sequence, of which `sequence` may be the beginning.
    """

    spec: TrackerSpec
    sequence: Sequence
    name: str
    key: str
    precision: str
    device: str
    build: Builder
    whole_frames: int


@dataclass(frozen=True, slots=True)
class Row:
    """What the target's estimate said of one image, without what only control needs.

    `confidence` is None for the first image: its box was given, nothing was measured.
    """

    box: Box | None
    status: TargetStatus
    reason: TargetReason
    confidence: float | None
    alarms: tuple[TargetAlarm, ...] = ()
    memory: MemoryWrite | None = None

    @classmethod
    def of(cls, state: TargetState) -> Row:
        """From a target state."""
        return cls(state.box, state.status, state.reason, state.confidence, state.alarms, state.memory)


@dataclass(frozen=True, slots=True)
class Track:
    """A row for each image. `seconds` is tracker and target together, by the wall clock, without reading images.

    `unread` counts images that could not be read: steps without candidates.
    """

    rows: tuple[Row, ...]
    seconds: float
    unread: int
    engine: str


def run_job(job: Job, tick: Tick) -> Track | None:
    """Track the sequence from its first box; None when `tick`, asked before every image, wants an end.

    Raises JobError.
    """
    place = "before the first image"
    rows: list[Row] = []
    seconds, unread = 0.0, 0
    try:
        built = job.build(job.spec, job.precision, job.device, THREADS)
        loop = TrackLoop(built.tracker, make_target(job.spec, built))
        for index, path in enumerate(job.sequence.images):
            if tick():
                return None
            place = f"image {path}"
            image, t_s = load_image(path), index / job.sequence.fps
            unread += image is None
            frame = Frame(image, index, t_s, t_s) if image is not None else None
            begun_s = time.perf_counter()
            state = loop.step(frame, t_s) if rows else loop.start(*_start(frame, job.sequence.first))
            seconds += time.perf_counter() - begun_s
            row = Row.of(state)
            rows.append(row if rows else replace(row, confidence=None))
    except Exception as error:  # whatever a tracker does, the other sequences go on
        raise JobError(f"{place}: {_told(error)}") from error
    return Track(tuple(rows), seconds, unread, built.engine)


def _start(frame: Frame | None, box: Box) -> tuple[Frame, Box]:
    """The first image with its box cut to the picture: annotations often reach beyond it by a pixel or two."""
    if frame is None:
        raise ValueError("the first image cannot be read, and without it there is nothing to look for")
    height, width = frame.image_bgr_u8.shape[:2]
    x1, y1, x2, y2 = box.to_corners()
    corners = (max(x1, EDGE_PX), max(y1, EDGE_PX), min(x2, width - EDGE_PX), min(y2, height - EDGE_PX))
    if corners == (x1, y1, x2, y2):
        return frame, box
    cut = Box.from_corners(*corners)
    if not cut.is_valid:
        raise ValueError(f"the first box {x1:g},{y1:g} to {x2:g},{y2:g} lies outside of the picture")
    return frame, cut


def _told(error: Exception) -> str:
    """The error in one line, with the place in the code unless it speaks of what was given."""
    text = " ".join(str(error).split())
    if isinstance(error, ValueError):
        return text
    last = traceback.extract_tb(error.__traceback__)[-1]
    path = Path(last.filename)
    shown = path.relative_to(ROOT) if path.is_relative_to(ROOT) else path
    return f"{type(error).__name__}: {text} ({shown}:{last.lineno})"
