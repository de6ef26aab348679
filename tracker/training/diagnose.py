"""What a network gets wrong: does it find the target, how exactly, and does it understand changes of size and shape?

Single pairs of crops, jittered as in training, not tracks: an error of tracking has many causes, one of these has one.
A young network hits the target long before it has learned the size; the slope of the predicted against the true change
shows it (0: it always answers the exemplar's size, 1: it sees the size).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import cv2
import numpy as np
import torch
from torch import nn

from tracker.box import Box
from tracker.messages import ImageU8
from tracker.siamapnpp.crop import EXEMPLAR_PX, exemplar_side_px
from tracker.siamapnpp.decode import ResponseMaps, decode
from tracker.siamapnpp.network import Maps
from tracker.siamapnpp.settings import TrackerSettings
from tracker.training.augment.plan import draw_plan
from tracker.training.augment.render import render_pair
from tracker.training.diagnosis import Diagnosis, Measured
from tracker.training.errors import TrainingError
from tracker.training.recipe import Augmentation, Jitter
from tracker.training.types import Footage, Skipped, View

FRAME_RANGE = 50  # as most training sources have it
BATCH = 16
MIN_TARGET_PX = 4.0  # what a tracker accepts as a target
CLEAN = Augmentation(
    flip=0, gray=0, colour=0, gamma=0, motion_blur=0, blur=0, low_resolution=0, noise=0, fog=0, jpeg=0,
    exemplar_low_resolution=0, occlusion=0, lookalike=0,
)  # fmt: skip
# The exemplar is clean, as the tracker takes it; no rotation, so that the true box is the box.
JITTER = Jitter(
    shift_px=38.0, log_scale=0.5, log_aspect=0.18, angle_deg=0.0,
    exemplar_shift_px=0.0, exemplar_log_scale=0.0, exemplar_log_aspect=0.0, exemplar_angle_deg=0.0,
)  # fmt: skip


def diagnose(
    network: nn.Module,
    footage: Sequence[Footage],
    settings: TrackerSettings,
    pairs: int,
    seed: int,
    *,
    jitter: Jitter = JITTER,
    report: Callable[[int], None] = lambda done: None,
) -> Diagnosis:
    """Measure `pairs` pairs, shared evenly among the sequences.

    Each is a random exemplar frame and a random search frame at most 50 frames away, the target present in both; the
    answer is the cell of the highest confidence, without window and penalty. `settings` gives search_px and the class
    weights; `report` is told how many pairs are done. The network is used as it is, in eval mode, on its device, and
    left in the mode it was in. Pictures that cannot be read are counted and replaced. Raises TrainingError when no
    sequence can give a pair.
    """
    usable = [(item, present) for item in footage if len(present := _present(item)) > 1]
    if not usable:
        told = ", ".join(item.name for item in footage) or "none were given"
        raise TrainingError(f"no sequence with a target in two frames ({told}); name sequences with ground truth")
    was_training = network.training
    network.eval()
    skipped = Skipped()
    measured: list[Measured] = []
    try:
        for number, (item, present) in enumerate(usable):
            count = pairs // len(usable) + (number < pairs % len(usable))
            rng = np.random.default_rng([seed, number])
            for first in range(0, count, BATCH):
                size = min(BATCH, count - first)
                measured += _measure(network, item, present, settings, jitter, size, rng, skipped)
                report(len(measured))
    finally:
        network.train(was_training)
    if not measured:
        raise TrainingError(f"no pair could be made: {'; '.join(skipped.lines())}")
    return Diagnosis.of(measured, tuple(skipped.lines()))


def _present(item: Footage) -> list[int]:
    return [
        frame
        for frame, box in enumerate(item.truth)
        if box is not None and box.is_valid and min(box.w_px, box.h_px) >= MIN_TARGET_PX
    ]


def _measure(
    network: nn.Module,
    item: Footage,
    present: Sequence[int],
    settings: TrackerSettings,
    jitter: Jitter,
    count: int,
    rng: np.random.Generator,
    skipped: Skipped,
) -> list[Measured]:
    """`count` pairs of a sequence, less those whose pictures cannot be read."""
    plan = draw_plan(rng, count, CLEAN, jitter, settings.search_px)
    crops, wanted = [], []
    for row in range(count):
        i = present[int(rng.integers(len(present)))]
        near = [frame for frame in present if abs(frame - i) <= FRAME_RANGE]
        j = near[int(rng.integers(len(near)))]
        try:
            views = _view(item, i), _view(item, j)
        except TrainingError as error:
            skipped.add("unreadable picture", str(error))
            continue
        exemplar, search, corners = render_pair(*views, plan, row, settings.search_px, seed=0)
        crops.append((exemplar, search))
        wanted.append((_size_in_exemplar(views[0].box), Box.from_corners(*corners)))
    if not crops:
        return []
    answers = _answers(network, [c[0] for c in crops], [c[1] for c in crops], settings)
    return [Measured(item.name, truth, answer, size) for (size, truth), answer in zip(wanted, answers, strict=True)]


def _view(item: Footage, frame: int) -> View:
    image, box = item.images[frame], item.truth[frame]
    assert box is not None, "only frames with the target are picked"
    blue, green, red, _ = cv2.mean(image)
    return View(image, box, (blue, green, red))


def _size_in_exemplar(box: Box) -> tuple[float, float]:
    scale = EXEMPLAR_PX / exemplar_side_px(box.w_px, box.h_px)
    return box.w_px * scale, box.h_px * scale


def _answers(
    network: nn.Module, exemplars: Sequence[ImageU8], searches: Sequence[ImageU8], settings: TrackerSettings
) -> list[Box | None]:
    """The most confident cell's box of each pair, in search pixels from the centre; None when no cell is usable."""
    some = next(network.parameters(), torch.zeros(1))
    with torch.inference_mode():
        maps = network(*(_tensor(crops, some) for crops in (exemplars, searches)))
    return [_best(maps, row, settings) for row in range(len(exemplars))]


def _tensor(crops: Sequence[ImageU8], like: torch.Tensor) -> torch.Tensor:
    return torch.from_numpy(np.stack(crops)).permute(0, 3, 1, 2).to(device=like.device, dtype=like.dtype)


def _best(maps: Maps, row: int, settings: TrackerSettings) -> Box | None:
    one = {name: value[row].float().cpu().numpy() for name, value in maps._asdict().items()}
    decoded = decode(ResponseMaps(**one), settings)
    best = int(decoded.confidence.argmax())
    if not decoded.usable[best]:
        return None
    box = Box(float(decoded.cx[best]), float(decoded.cy[best]), float(decoded.w[best]), float(decoded.h[best]))
    return box if all(math.isfinite(v) for v in (box.cx_px, box.cy_px, box.w_px, box.h_px)) else None
