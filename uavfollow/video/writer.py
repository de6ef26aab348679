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
            raise InputError(
                f"{path.name}: a video of {size_px[0]} x {size_px[1]} px cannot be written; use --no-video"
            )
        self._frames = 0

    def write(self, image_bgr_u8: ImageU8) -> None:
        """Append one frame; one of another size is scaled to that of the first."""
        self._frames += 1
        if (image_bgr_u8.shape[1], image_bgr_u8.shape[0]) != self._size_px:
            self._writer.write(cv2.resize(image_bgr_u8, self._size_px, interpolation=cv2.INTER_AREA))
        else:
            self._writer.write(image_bgr_u8)

    def discard(self) -> None:
        """Give the file up and delete it."""
        self._writer.release()
        self._path.unlink(missing_ok=True)

    def close(self) -> None:
        """Finish the file. Raises InputError when it is not whole: OpenCV itself does not tell of a full disk."""
        self._writer.release()
        capture = cv2.VideoCapture(str(self._path), cv2.CAP_FFMPEG)
        written = int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) if capture.isOpened() else 0
        capture.release()
        if written != self._frames:
            raise InputError(
                f"{self._path.name}: {written} of {self._frames} frames were written; is the disk full? "
                "Free some space, or leave the video out with --no-video"
            )


def write_image(path: Path, image_bgr_u8: ImageU8) -> None:
    """Write a picture in the format of its name. Raises OSError when it cannot be written whole."""
    done, data = cv2.imencode(path.suffix, image_bgr_u8)
    if not done:
        raise OSError(None, "the picture cannot be encoded", str(path))
    path.write_bytes(data.tobytes())
