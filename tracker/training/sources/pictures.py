"""Picture files: read whole, their size from the header, their mean colour, which of them are there."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import BinaryIO

import cv2
import numpy as np

from tracker.messages import ImageU8

SUFFIXES = frozenset((".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff", ".ppm"))
MEAN_SAMPLES = 64  # along each side: the mean colour is then known to about one grey level
_READ = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION  # published boxes mean the pixels as stored
_JPEG_END = b"\xff\xd9"
_JPEG_ALONE = frozenset((0x01, *range(0xD0, 0xD9)))  # markers without a length
_JPEG_SIZE = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # start of frame, any coding


def read_picture(path: Path) -> ImageU8 | str:
    """The picture as stored, (H, W, 3) BGR, EXIF orientation ignored; or path and fault in one line."""
    try:
        data = path.read_bytes()
    except OSError as error:
        return f"{path}: {error.strerror or error}"
    if data[:2] == b"\xff\xd8" and _JPEG_END not in data[-len(data) // 2 :]:
        return f"{path}: truncated JPEG ({len(data)} bytes without an end)"
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), _READ) if data else None
    except cv2.error:
        image = None
    if image is None:
        return f"{path}: not a picture that OpenCV can read ({len(data)} bytes)"
    return np.asarray(image, np.uint8)


def mean_colour(image_bgr_u8: ImageU8) -> tuple[float, float, float]:
    """The mean of a grid of pixels over the whole picture: what stands for the outside of it."""
    height, width = image_bgr_u8.shape[:2]
    grid = image_bgr_u8[:: max(1, height // MEAN_SAMPLES), :: max(1, width // MEAN_SAMPLES)]
    blue, green, red = grid.mean(axis=(0, 1))
    return float(blue), float(green), float(red)


def picture_size(path: Path) -> tuple[int, int] | None:
    """Width and height as the header of a JPEG or PNG tells them, without decoding; None when it does not."""
    try:
        with path.open("rb") as file:
            head = file.read(24)
            if head[:8] == b"\x89PNG\r\n\x1a\n" and len(head) == 24:
                width, height = struct.unpack(">II", head[16:24])
                return width, height
            return _jpeg_size(file) if head[:2] == b"\xff\xd8" else None
    except (OSError, struct.error, IndexError):
        return None


def _jpeg_size(file: BinaryIO) -> tuple[int, int] | None:
    file.seek(2)
    while True:
        byte, marker = struct.unpack("BB", file.read(2))
        if byte != 0xFF:
            return None
        while marker == 0xFF:  # fill bytes
            marker = file.read(1)[0]
        if marker in _JPEG_ALONE:
            continue
        (length,) = struct.unpack(">H", file.read(2))
        if marker in _JPEG_SIZE:
            height, width = struct.unpack(">xHH", file.read(5))
            return width, height
        file.seek(length - 2, os.SEEK_CUR)


class Listing:
    """Which files are there, asked once for each folder instead of once for each of a million files."""

    def __init__(self, folder: Path) -> None:
        self._folder = str(folder)
        self._names: dict[str, frozenset[str]] = {}

    def has(self, name: str) -> bool:
        """Is there an entry `name`, relative to the folder?"""
        parent, last = os.path.split(os.path.join(self._folder, name))  # noqa: PTH118  (hot: pathlib is 10x slower)
        if parent not in self._names:
            try:
                self._names[parent] = frozenset(os.listdir(parent))  # noqa: PTH208
            except (OSError, ValueError):  # ValueError: a name with a zero byte
                self._names[parent] = frozenset()
        return last in self._names[parent]
