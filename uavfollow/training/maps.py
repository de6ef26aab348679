"""Feature maps of a model in one picture of a sequence: tracked there, then watched."""

from __future__ import annotations

import itertools
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

    Raises InputError: too few pictures, a box that cannot start a track, a place that cannot be written.
    """
    weights = load(model)
    settings = weights.settings()
    frames = [f for f in itertools.islice(source.frames(), number) if f is not None]
    if len(frames) < number:
        raise InputError(f"--frame {number}: there are only {len(frames)} pictures that can be read")
    found = _tracked(SiamAPNTracker(TorchEngine(weights.network(), device="cpu"), settings), frames, box)
    exemplar = _crop(frames[0].image_bgr_u8, box, EXEMPLAR_PX, frames[0].image_bgr_u8)
    search = _crop(frames[-1].image_bgr_u8, found, settings.search_px, frames[0].image_bgr_u8)
    try:
        written = cv2.imwrite(str(out), draw_maps(weights.network(), exemplar, search, settings))
    except cv2.error as error:
        raise InputError(f"--out {out}: no picture can be written there; let the name end in .png or .jpg") from error
    if not written:
        raise InputError(f"--out {out}: cannot be written; choose another place")
    return out


def _tracked(tracker: SiamAPNTracker, frames: list[Frame], box: Box) -> Box:
    """The tracker's box before the last picture, around which it would look there."""
    try:
        tracker.init(frames[0], box)
    except ValueError as error:
        raise InputError(f"--box: {error}") from error
    for frame in frames[1:-1]:
        candidates = tracker.update(frame)
        box = candidates[0].box if candidates else box
    return box


def _crop(image: ImageU8, box: Box, out_px: int, first: ImageU8) -> ImageU8:
    """As the tracker cuts it: outside is the first picture's mean colour."""
    blue, green, red, _ = cv2.mean(first)
    side = exemplar_side_px(box.w_px, box.h_px) * out_px / EXEMPLAR_PX
    return crop_square(image, CropGeometry(box.cx_px, box.cy_px, side, out_px), (blue, green, red))
