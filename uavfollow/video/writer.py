"""Overlay video out."""

from __future__ import annotations

from pathlib import Path

import cv2

from tracker.messages import ImageU8
from uavfollow.errors import InputError

CODEC = "mp4v"  # MPEG-4 part 2: the one MP4 codec that every opencv-python-headless wheel can write


class VideoSink:
    """Writes an MP4 of equally sized frames. The file is complete after `close`."""

    def __init__(self, path: Path, fps: float, size_px: tuple[int, int]) -> None:
        self._path = path
        self._size_px = size_px
        fourcc = cv2.VideoWriter.fourcc(*CODEC)
        self._writer = cv2.VideoWriter(str(path), fourcc, fps, size_px)
        if not self._writer.isOpened():
            raise InputError(f"{path}: cannot write a video of {size_px[0]} x {size_px[1]} px there")

    def write(self, image_bgr_u8: ImageU8) -> None:
        """Append one frame; one of another size is scaled to that of the first."""
        if (image_bgr_u8.shape[1], image_bgr_u8.shape[0]) != self._size_px:
            self._writer.write(cv2.resize(image_bgr_u8, self._size_px, interpolation=cv2.INTER_AREA))
        else:
            self._writer.write(image_bgr_u8)

    def close(self) -> None:
        """Finish the file."""
        self._writer.release()
