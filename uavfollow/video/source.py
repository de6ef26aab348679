"""Frame sources for recorded material and local cameras: a video file, a folder of images, a camera index.

A source yields a Frame, or None for one picture that cannot be decoded: the loop goes on and says so.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np

from tracker.messages import Frame
from uavfollow.errors import InputError

# Our errors say what is wrong with a file; FFmpeg's and OpenCV's own lines would only stand around them.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # AV_LOG_QUIET
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)

IMAGE_SUFFIXES = {".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".ppm", ".webp"}
GENERIC_NAMES = {"img", "imgs", "image", "images", "frames"}
DEFAULT_FPS = 30.0
FPS_RANGE = (0.1, 1000.0)
MAX_CAMERA_INDEX = 63
HEAD_BYTES = 4096  # enough to tell text from a container
TAIL_FRAMES = 2  # containers announce up to this many frames that no decoder delivers


class FrameSource(Protocol):
    """`count` is None when it is not known (a camera). `origin` is where the frames come from, `name` a short label."""

    name: str
    origin: str
    fps: float
    count: int | None

    def frames(self) -> Iterator[Frame | None]:
        """Frames in order; None for one that cannot be read."""


class ImageFolder:
    """Images of a folder (or of its `img` folder) in numeric order, as if taken at `fps`."""

    def __init__(self, folder: Path, fps: float) -> None:
        inner = folder / "img"
        self._folder = inner if inner.is_dir() and not _images(folder) else folder
        self._paths = _images(self._folder)
        if not self._paths:
            raise InputError(f"{folder}: holds no images ({', '.join(sorted(IMAGE_SUFFIXES))})")
        self.name = _telling_name(folder.resolve())
        self.origin = str(folder)
        self.fps = fps
        self.count: int | None = len(self._paths)
        if _read_image(self._paths[0]) is None:
            raise InputError(f"{self._paths[0]}: the first image cannot be read; is it damaged?")

    def frames(self) -> Iterator[Frame | None]:
        """Frames in order; None for an image that cannot be read."""
        for seq, path in enumerate(self._paths):
            image = _read_image(path)
            t_s = seq / self.fps
            yield None if image is None else Frame(image, seq, t_s, t_s)


class VideoFile:
    """A video file, checked to hold the frames that it announces before the first is used."""

    def __init__(self, path: Path, fps: float | None) -> None:
        self._path = path
        capture = self._open()
        stated = capture.get(cv2.CAP_PROP_FPS)
        self.fps = fps or (stated if FPS_RANGE[0] <= stated <= FPS_RANGE[1] else DEFAULT_FPS)
        self.name, self.origin = path.stem, str(path)
        self.count: int | None = self._checked_count(capture)
        capture.release()

    def _open(self) -> Any:
        capture = cv2.VideoCapture(str(self._path), cv2.CAP_FFMPEG)
        if not capture.isOpened():
            raise InputError(f"{self._path}: not a readable video (damaged, truncated or of an unknown format)")
        return capture

    def _checked_count(self, capture: Any) -> int:
        announced = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        if announced > 0 and capture.set(cv2.CAP_PROP_POS_FRAMES, announced - 1) and capture.grab():
            return announced
        # The end cannot be reached by seeking: count what is really there.
        capture = self._open()
        present = 0
        while capture.grab():
            present += 1
        capture.release()
        if present == 0:
            raise InputError(f"{self._path}: no frame of this video can be decoded")
        if present < announced - TAIL_FRAMES:
            raise InputError(
                f"{self._path}: truncated or damaged: {present} of {announced} frames can be decoded; "
                "re-encode it to track what is there"
            )
        return present

    def frames(self) -> Iterator[Frame | None]:
        """Frames in order. Raises InputError when the file ends early all the same."""
        capture = self._open()
        try:
            for seq in range(self.count or 0):
                ok, image = capture.read()
                if not ok:
                    if seq < (self.count or 0) - TAIL_FRAMES:
                        raise InputError(
                            f"{self._path}: damaged: no frame after number {seq - 1}; "
                            f"--max-frames {seq} tracks what comes before"
                        )
                    return
                t_s = seq / self.fps
                yield Frame(np.asarray(image, dtype=np.uint8), seq, t_s, t_s)
        finally:
            capture.release()


class Camera:
    """A local camera by index; its frames carry the monotonic time since the first one."""

    def __init__(self, index: int, fps: float | None) -> None:
        self._capture = cv2.VideoCapture(index)
        if not self._capture.isOpened():
            raise InputError(f"camera {index}: cannot be opened; is it connected and not used by another program?")
        stated = self._capture.get(cv2.CAP_PROP_FPS)
        self.fps = fps or (stated if FPS_RANGE[0] <= stated <= FPS_RANGE[1] else DEFAULT_FPS)
        self.name, self.origin = f"camera-{index}", f"camera {index}"
        self.count: int | None = None

    def frames(self) -> Iterator[Frame | None]:
        """Frames until the camera stops delivering or the user interrupts."""
        start: float | None = None
        seq = 0
        try:
            while True:
                ok, image = self._capture.read()
                now = time.monotonic()
                if not ok:
                    return
                start = now if start is None else start
                yield Frame(np.asarray(image, dtype=np.uint8), seq, now - start, now - start)
                seq += 1
        finally:
            self._capture.release()


def open_source(text: str, fps: float | None) -> FrameSource:
    """A source from what the user gave. Raises InputError."""
    if fps is not None and not FPS_RANGE[0] <= fps <= FPS_RANGE[1]:
        raise InputError(f"--fps {fps:g} is out of range, must lie in {FPS_RANGE[0]:g}..{FPS_RANGE[1]:g}")
    path = Path(text)
    if path.is_dir():
        return ImageFolder(path, fps or DEFAULT_FPS)
    if path.is_file():
        _check_binary(path)
        return VideoFile(path, fps)
    if re.fullmatch(r"\d{1,2}", text) and int(text) <= MAX_CAMERA_INDEX:
        return Camera(int(text), fps)
    raise InputError(
        f"{text}: no such file or folder (a source is a video file, an image folder, or a camera index "
        f"0..{MAX_CAMERA_INDEX})"
    )


def _check_binary(path: Path) -> None:
    """Refuse empty files and text: FFmpeg plays text as ANSI art, and follows the addresses in playlists."""
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    if not head:
        raise InputError(f"{path}: the file is empty")
    if b"\0" not in head and head.isascii():
        raise InputError(f"{path}: not a readable video but a text file")


def _telling_name(folder: Path) -> str:
    """The folder's name; its parent's when it is only called "images"."""
    return folder.parent.name if folder.name.lower() in GENERIC_NAMES and folder.parent.name else folder.name


def _numeric(path: Path) -> tuple[list[int], str]:
    return [int(n) for n in re.findall(r"\d+", path.stem)], path.name


def _images(folder: Path) -> list[Path]:
    try:
        return sorted((p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES), key=_numeric)
    except OSError as error:
        raise InputError(f"{folder}: cannot be listed ({error.strerror})") from error


def _read_image(path: Path) -> Any:
    try:
        # imdecode and not imread: imread reports a damaged file on standard error and knows no error of its own.
        data = np.frombuffer(path.read_bytes(), np.uint8)
        return cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    except (OSError, cv2.error):
        return None
