"""Trackers without a network, and tiny sequences. Functions of a module, so that worker processes find them."""

from __future__ import annotations

import hashlib
import os
import signal
from pathlib import Path

import cv2
import numpy as np

from tracker.box import Box
from tracker.messages import Candidate, Frame, MemorySlot, SearchHint
from tracker.weights.build import BuiltTracker
from uavfollow.trackers import TrackerSpec

WIDTH_PX, HEIGHT_PX = 64, 48
SIZE_PX = 12.0
FRAMES = 12


def truth_box(k: int) -> Box:
    """A target that moves right by two pixels each frame."""
    return Box(14.0 + 2.0 * k, 24.0, SIZE_PX, SIZE_PX)


def write_sequence(folder: Path, frames: int = FRAMES, absent: range = range(0), rows: int | None = None) -> Path:
    """A bright square on black; in `absent` frames there is none, and the row is nan."""
    (folder / "img").mkdir(parents=True)
    lines = []
    for k in range(frames):
        image = np.zeros((HEIGHT_PX, WIDTH_PX, 3), np.uint8)
        x, y, w, h = truth_box(k).to_xywh()
        if k not in absent:
            image[int(y) : int(y + h), int(x) : int(x + w)] = 255
        cv2.imwrite(str(folder / "img" / f"{k + 1:04d}.png"), image)
        lines.append("nan,nan,nan,nan" if k in absent else f"{x:g},{y:g},{w:g},{h:g}")
    (folder / "groundtruth_rect.txt").write_text("\n".join(lines[:rows]) + "\n")
    return folder


class BrightTracker:
    """Finds the centre of what is bright; remembers what it was told to remember."""

    def __init__(self, offset_px: float = 0.0) -> None:
        self._offset_px = offset_px
        self._size_px = (0.0, 0.0)

    def init(self, frame: Frame, box: Box) -> None:
        self._size_px = (box.w_px, box.h_px)

    def update(self, frame: Frame, hint: SearchHint | None = None) -> tuple[Candidate, ...]:
        ys, xs = np.nonzero(frame.image_bgr_u8[:, :, 0] > 127)
        if not xs.size:
            return ()
        box = Box(float(xs.mean()) + 0.5 + self._offset_px, float(ys.mean()) + 0.5, *self._size_px)
        return (Candidate(box, score=0.9, peak=0.9, similarity=0.9),)

    def remember(self, frame: Frame, box: Box, slot: MemorySlot) -> None:
        """Nothing to do: it knows bright from dark."""


class Raises(BrightTracker):
    """Breaks in the fifth frame of a marked sequence."""

    def update(self, frame: Frame, hint: SearchHint | None = None) -> tuple[Candidate, ...]:
        if frame.seq == 4 and _mark(frame):
            raise RuntimeError("no more\nof this")
        return super().update(frame, hint)


class Interrupts(BrightTracker):
    """In a marked sequence the user presses Ctrl-C."""

    def update(self, frame: Frame, hint: SearchHint | None = None) -> tuple[Candidate, ...]:
        if frame.seq == 4 and _mark(frame):
            os.kill(os.getpid(), signal.SIGINT)
        return super().update(frame, hint)


KINDS = {"bright": BrightTracker, "raises": Raises, "interrupts": Interrupts}


def mark(folder: Path) -> Path:
    """Mark a sequence: the fakes above look for it in a corner of every image."""
    for path in (folder / "img").iterdir():
        image = cv2.imread(str(path))
        image[0, 0] = (0, 255, 0)
        cv2.imwrite(str(path), image)
    return folder


def _mark(frame: Frame) -> bool:
    return tuple(frame.image_bgr_u8[0, 0]) == (0, 255, 0)


def build(spec: TrackerSpec, precision: str, device: str, threads: int | None) -> BuiltTracker:
    """As `uavfollow.trackers.build`; a spec's model is the offset in pixels of everything it finds."""
    identity = hashlib.sha256(f"{spec.name} {spec.model}".encode()).hexdigest()
    tracker = KINDS[spec.name](float(spec.model or 0.0))
    return BuiltTracker(tracker, f"fake/{precision}", identity, None)


def factory(model: str, precision: str, device: str, threads: int | None) -> BuiltTracker:
    """As the registry calls it: for the command line."""
    return build(TrackerSpec("bright", model, False), precision, device, threads)


def interrupting(model: str, precision: str, device: str, threads: int | None) -> BuiltTracker:
    """The same of a tracker that presses Ctrl-C."""
    return build(TrackerSpec("interrupts", model, False), precision, device, threads)
