"""Single frames of video files, by number."""

from __future__ import annotations

import os
from collections import OrderedDict
from pathlib import Path

import cv2
import numpy as np

from tracker.messages import ImageU8

OPEN_CAPTURES = 4  # per process; each holds a decoder and a file
READ_ON_FRAMES = 24  # nearer than this ahead, decoding on is cheaper than seeking a key frame
OFF_BY_FRAMES = 0.5  # a frame whose time is further from number / rate is not the one that was asked for


class Captures:
    """Frames of videos. Opens what it needs, in every process for itself: an open decoder cannot be shared."""

    def __init__(self) -> None:
        self._process = os.getpid()
        self._open: OrderedDict[Path, _Capture] = OrderedDict()

    def __reduce__(self) -> tuple[type[Captures], tuple[()]]:
        return Captures, ()  # nothing of it travels to another process

    def read(self, path: Path, frame: int) -> ImageU8 | str:
        """Frame `frame` (from 0), (H, W, 3) BGR; or path and fault in one line."""
        if self._process != os.getpid():  # forked: the decoders are the parent's
            self._process, self._open = os.getpid(), OrderedDict()
        if path not in self._open:
            if not path.is_file():
                return f"{path}: no such file"
            self._open[path] = _Capture(path)
            while len(self._open) > OPEN_CAPTURES:
                self._open.popitem(last=False)[1].close()
        self._open.move_to_end(path)
        capture = self._open[path]
        if not capture.is_open:
            return f"{path}: not a video that OpenCV can read"
        image = capture.read(frame)
        return f"{path}: cannot decode frame {frame}" if image is None else image


class _Capture:
    """One open video. Seeks only where the frames' times prove that the seek was right; else decodes from the start."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._seekable = True
        self._length: int | None = None  # known once the end was met
        self._next: int | None = 0  # the frame that the next grab gives; None when that is not known
        self._start()

    def _start(self) -> None:
        self._capture = cv2.VideoCapture(str(self._path), cv2.CAP_FFMPEG)
        self._next = 0
        self._rate_hz = float(self._capture.get(cv2.CAP_PROP_FPS))

    @property
    def is_open(self) -> bool:
        """Is it a video at all?"""
        return bool(self._capture.isOpened())

    def close(self) -> None:
        """Let the file go."""
        self._capture.release()

    def read(self, frame: int) -> ImageU8 | None:
        """The frame, or None when it cannot be decoded."""
        if self._length is not None and frame >= self._length:
            return None
        if self._next is not None and 0 <= frame - self._next <= READ_ON_FRAMES:
            return self._decode_to(frame)
        image = self._seek(frame) if self._seekable else None
        if image is None:
            if self._next is None or frame < self._next:
                self.close()
                self._start()
            image = self._decode_to(frame)
            self._seekable = self._seekable and image is None  # what can be decoded but not sought
        return image

    def _seek(self, frame: int) -> ImageU8 | None:
        """The frame by a seek, or None when it is not there or may be another one."""
        self._next = None
        if self._rate_hz <= 0 or not self._capture.set(cv2.CAP_PROP_POS_FRAMES, frame):
            return None
        done, image = self._capture.read()
        at = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000 * self._rate_hz
        if not done or image is None or abs(at - frame) > OFF_BY_FRAMES:
            return None
        self._next = frame + 1
        return np.asarray(image, np.uint8)

    def _decode_to(self, frame: int) -> ImageU8 | None:
        """The frame by decoding from where the video is now, which must not be behind it."""
        at, self._next = self._next or 0, None
        while at < frame:
            if not self._capture.grab():
                self._length = at
                return None
            at += 1
        done, image = self._capture.read()
        if not done or image is None:
            self._length = at
            return None
        self._next = at + 1
        return np.asarray(image, np.uint8)
