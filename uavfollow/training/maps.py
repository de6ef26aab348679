"""Feature maps of a model in one picture of a sequence: tracked there, then watched."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from pathlib import Path

import cv2

from tracker.box import Box
from tracker.engines.torch_engine import TorchEngine
from tracker.messages import Frame, ImageU8
from tracker.siamapnpp.crop import EXEMPLAR_PX, CropGeometry, crop_square, exemplar_side_px
from tracker.siamapnpp.tracker import SiamAPNTracker
from tracker.training.feature_maps import draw_maps
from tracker.weights.store import load
from uavfollow.errors import InputError
from uavfollow.video.source import FrameSource


def write_maps(model: str, source: FrameSource, box: Box, number: int, out: Path) -> Path:
    """Track from `box` in the first picture to picture `number` (from 1, at least 2); draw what the network sees there.

    Raises InputError: too few pictures, one that cannot be read, a box that cannot start a track, a place that cannot
    be written.
    """
    _check_place(out)
    if source.count is not None and source.count < number:
        raise InputError(f"--frame {number}: there are only {source.count} pictures")
    weights = load(model)
    settings = weights.settings()
    tracker = SiamAPNTracker(TorchEngine(weights.network(), device="cpu"), settings)
    first, last, found = _tracked(tracker, source.frames(), box, number)
    exemplar = _crop(first, box, EXEMPLAR_PX, first)
    search = _crop(last, found, settings.search_px, first)
    if not cv2.imwrite(str(out), draw_maps(weights.network(), exemplar, search, settings)):
        raise InputError(f"--out {out}: cannot be written; choose another place")
    return out


def _check_place(out: Path) -> None:
    """Before the tracking. Raises InputError."""
    if not out.parent.is_dir():
        raise InputError(f"--out {out}: there is no folder {out.parent}; make it first")
    if out.is_dir():
        raise InputError(f"--out {out}: is a folder; name a file in it")
    if not cv2.haveImageWriter(out.name):
        raise InputError(f"--out {out}: no picture can be written there; let the name end in .png or .jpg")


def _tracked(
    tracker: SiamAPNTracker, frames: Iterable[Frame | None], box: Box, number: int
) -> tuple[ImageU8, ImageU8, Box]:
    """First and last picture, and the tracker's box before the last one, around which it would look there.

    No more than two pictures are held at a time. A picture between them that cannot be read is passed over.
    """
    first: Frame | None = None
    read = 0
    for read, frame in enumerate(itertools.islice(frames, number), 1):
        if frame is None and read in (1, number):
            raise InputError(f"--frame {number}: picture {read} cannot be read")
        if frame is None:
            continue
        if first is None:
            first = frame
            _start(tracker, frame, box)
        elif read < number:
            candidates = tracker.update(frame)
            box = candidates[0].box if candidates else box
        else:
            return first.image_bgr_u8, frame.image_bgr_u8, box
    raise InputError(f"--frame {number}: there are only {read} pictures")


def _start(tracker: SiamAPNTracker, frame: Frame, box: Box) -> None:
    try:
        tracker.init(frame, box)
    except ValueError as error:
        raise InputError(f"--box: {error}") from error


def _crop(image: ImageU8, box: Box, out_px: int, first: ImageU8) -> ImageU8:
    """As the tracker cuts it: outside is the first picture's mean colour."""
    blue, green, red, _ = cv2.mean(first)
    side = exemplar_side_px(box.w_px, box.h_px) * out_px / EXEMPLAR_PX
    return crop_square(image, CropGeometry(box.cx_px, box.cy_px, side, out_px), (blue, green, red))
