"""A world of coloured rectangles and a network small enough to learn them in seconds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch

from tracker.box import Box
from tracker.siamapnpp.crop import EXEMPLAR_PX
from tracker.siamapnpp.network import NetworkSize, SiamAPNpp
from tracker.training.errors import TrainingError
from tracker.training.recipe import Recipe, Simulator, Stage
from tracker.training.types import Batch, Footage, Skipped, seed_of

TINY = NetworkSize((8, 16, 16, 16, 16), 16)
TARGET_PX = 63.5  # side of a square target in its exemplar


def tiny_network(seed: int = 0) -> SiamAPNpp:
    torch.manual_seed(seed)
    return SiamAPNpp(TINY)


def recipe(*stages: Stage, **changes: object) -> Recipe:
    values = {"name": "tiny", "description": "blobs", "ema": 0.9, "precision": "fp32", **changes}
    return Recipe(sources=(Simulator(kind="simulator"),), stages=stages, **values)


def stage(pairs: int, batch: int = 2, **changes: object) -> Stage:
    values = {"lr": 2e-3, "warmup_pairs": 0, "frozen_layers": 2, **changes}
    return Stage(pairs=pairs, batch=batch, **values)


@dataclass
class Blobs:
    """Batches of one colour per pair. The boxes of the steps in `poison` hold a NaN."""

    stage_index: int = 0
    rows: int = 2
    rank: int = 0
    world: int = 1
    search_px: int = 223
    poison: frozenset[int] = frozenset()
    drawn: list[int] = field(default_factory=list)

    def batch(self, step: int) -> Batch:
        self.drawn.append(step)
        mine = self.rows // self.world
        rows = [self._row(step, row) for row in range(self.rank * mine, (self.rank + 1) * mine)]
        box = torch.tensor([r[2] for r in rows], dtype=torch.float32)
        if step in self.poison:
            box[0] = float("nan")
        skipped = Skipped()
        if step == 1:
            skipped.add("unreadable image", "blob_1.png")
        exemplar, search = (torch.from_numpy(np.stack([r[i] for r in rows])) for i in (0, 1))
        return Batch(exemplar, search, box, torch.zeros(mine, dtype=torch.bool), skipped)

    def _row(self, step: int, row: int) -> tuple[np.ndarray, np.ndarray, tuple[float, float, float, float]]:
        rng = seed_of(7, self.stage_index, step, row)
        colour = rng.integers(120, 255, 3)
        cx, cy = rng.uniform(-30, 30, 2)
        w, h = TARGET_PX * np.exp(rng.uniform(-0.3, 0.3, 2))
        box = (cx - w / 2, cy - h / 2, cx + w / 2, cy + h / 2)
        half = TARGET_PX / 2
        exemplar = _painted(rng, EXEMPLAR_PX, (-half, -half, half, half), colour)
        return exemplar, _painted(rng, self.search_px, box, colour), box


def _painted(rng: np.random.Generator, side_px: int, box: Sequence[float], colour: np.ndarray) -> np.ndarray:
    image = rng.integers(0, 60, (3, side_px, side_px), dtype=np.uint8)
    x1, y1, x2, y2 = (round(v + side_px / 2) for v in box)
    image[:, max(0, y1) : y2, max(0, x1) : x2] = colour[:, None, None]
    return image


class Pictures(Sequence[np.ndarray]):
    """A square that moves right by 3 px a frame; frames in `broken` cannot be read."""

    def __init__(self, count: int, broken: frozenset[int] = frozenset()) -> None:
        self.count, self.broken, self.read = count, broken, 0

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index):  # type: ignore[no-untyped-def]
        self.read += 1
        if index in self.broken:
            raise TrainingError(f"{index}.jpg: not a picture")
        image = np.full((120, 200, 3), 40, np.uint8)
        image[40:70, 30 + 3 * index : 60 + 3 * index] = (40, 200, 240)
        return image


def footage(name: str = "square", frames: int = 6, broken: frozenset[int] = frozenset()) -> Footage:
    truth = tuple(Box(45.0 + 3 * i, 55.0, 30.0, 30.0) for i in range(frames))
    return Footage(name, truth, Pictures(frames, broken))


class Clock:
    """Goes on by `step_s` each time it is looked at."""

    def __init__(self, step_s: float = 1.0) -> None:
        self.now_s, self.step_s = 1000.0, step_s

    def __call__(self) -> float:
        self.now_s += self.step_s
        return self.now_s


def never() -> bool:
    return False


def after(count: int) -> Callable[[], bool]:
    """Asks for a stop when it was asked `count` times before."""
    asked = [0]

    def should_stop() -> bool:
        asked[0] += 1
        return asked[0] > count

    return should_stop
