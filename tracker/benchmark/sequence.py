"""One annotated sequence of a tracking benchmark, whatever data set it comes from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from tracker.box import Box
from tracker.messages import ImageU8

DEFAULT_FPS = 30.0  # no layout states its rate; all but UAV123@10fps were filmed at 25 to 30


class ReadError(ValueError):
    """A file of a data set that cannot be used. `where` is the file, with the line after a colon where there is one."""

    def __init__(self, where: str, message: str) -> None:
        super().__init__(f"{where}: {message}")
        self.where = where
        self.message = message


@dataclass(frozen=True, slots=True)
class Problem:
    """Why a sequence, or a path given by the user, was left out: place, and what to do about it."""

    where: str
    message: str

    def __str__(self) -> str:
        return f"{self.where}: {self.message}"


@dataclass(frozen=True, slots=True)
class Sequence:
    """Images in their order with one row of truth each.

    `truth` is None where the target is absent (not finite, no positive size, or marked so). `first` is the box of the
    first image, with which a tracker starts. `attributes` are the short names of the data set in capitals, empty where
    it has none. `fps` is the rate of filming, assumed where the data set does not state one.
    """

    name: str
    dataset: str
    images: tuple[Path, ...]
    truth: tuple[Box | None, ...]
    fps: float
    attributes: frozenset[str]
    first: Box

    def time_s(self, index: int) -> float:
        """When the image with this index was taken, seconds after the first."""
        return index / self.fps


def make_sequence(
    name: str,
    dataset: str,
    images: tuple[Path, ...],
    truth: tuple[Box | None, ...],
    where: str,
    fps: float = DEFAULT_FPS,
    attributes: frozenset[str] = frozenset(),
) -> Sequence:
    """A checked sequence. Raises ReadError(`where`): no images, another number of rows, or no box in the first row."""
    if not images:
        raise ReadError(where, f"no images for sequence {name}")
    if len(truth) != len(images):
        message = f"{len(truth)} rows for {len(images)} images in {images[0].parent}: they must be as many"
        raise ReadError(f"{where}:{len(truth)}", message)
    first = truth[0]
    if first is None:
        raise ReadError(f"{where}:1", "no target in the first row: a tracker has nothing to start from")
    return Sequence(name, dataset, images, truth, fps, attributes, first)


def load_image(path: Path) -> ImageU8 | None:
    """The picture as (H, W, 3) BGR, or None when the file is missing or is no picture. Never raises."""
    try:
        data = np.frombuffer(path.read_bytes(), dtype=np.uint8)
        image = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    except (OSError, cv2.error):
        return None
    return None if image is None else np.asarray(image, dtype=np.uint8)
