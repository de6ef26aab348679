from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from tracker.box import Box
from tracker.messages import ImageU8
from tracker.siamapnpp.decode import ANCHOR_PX, grid
from tracker.siamapnpp.network import Maps
from tracker.siamapnpp.settings import TrackerSettings
from tracker.training.diagnose import FRAME_RANGE, diagnose
from tracker.training.diagnosis import Diagnosis, Line, Measured
from tracker.training.errors import TrainingError
from tracker.training.types import Footage

SETTINGS = TrackerSettings(search_px=287)
Size = tuple[float, float]
Answer = Callable[[Size, Size], Size]  # sizes of the exemplar's and of the search crop's target to the answered one


class Knowing(nn.Module):
    """Sees the bright target in both crops and answers with its place and the size that `answer` makes of both."""

    def __init__(self, answer: Answer, shift_px: float = 0.0) -> None:
        super().__init__()
        self.answer, self.shift_px = answer, shift_px
        self.modes: list[bool] = []

    def forward(self, exemplar: Tensor, search: Tensor) -> Maps:
        self.modes.append(self.training)
        rows = [self._row(z, x) for z, x in zip(exemplar, search, strict=True)]
        return Maps(*(torch.stack(part) for part in zip(*rows, strict=True)))

    def _row(self, exemplar: Tensor, search: Tensor) -> tuple[Tensor, ...]:
        _, _, *old = bright(exemplar)
        cx, cy, *now = bright(search)
        w, h = self.answer((old[0], old[1]), (now[0], now[1]))
        cells = (search.shape[-1] - 287) // 8 + 21
        gx, gy = (torch.from_numpy(v).float().reshape(cells, cells) for v in grid(cells))
        cx, cy = cx + self.shift_px, cy + self.shift_px
        best = ((gx - cx) ** 2 + (gy - cy) ** 2).argmin()
        cls1 = torch.zeros(2, cells, cells)
        cls1[1].view(-1)[best] = 5.0
        anchor = torch.stack([torch.full_like(gx, v / 2 / ANCHOR_PX) for v in (w, w, h, h)])
        loc = torch.stack([(cx - gx) / w, (cy - gy) / h, torch.zeros_like(gx), torch.zeros_like(gx)])
        return anchor, cls1, torch.zeros(2, cells, cells), torch.zeros(1, cells, cells), loc


def bright(crop: Tensor) -> tuple[float, float, float, float]:
    """Middle from the crop's centre and size of what is brighter than half, with shares of the pixels at its edges."""
    level = (crop[0] / 255 - 0.1).clamp(min=0) / 0.9  # what lies outside of the picture is not quite black
    along_x, along_y = level.amax(0), level.amax(1)
    middle = (crop.shape[-1] - 1) / 2
    numbers = torch.arange(crop.shape[-1])
    x, y = (float((line.round() * numbers).sum() / line.round().sum()) - middle for line in (along_x, along_y))
    return x, y, float(along_x.sum()), float(along_y.sum())


class Pictures(Sequence[ImageU8]):
    """A white rectangle on black in each frame; remembers what was read."""

    def __init__(self, boxes: Sequence[Box], broken: frozenset[int] = frozenset()) -> None:
        self.boxes, self.broken = boxes, broken
        self.read: list[int] = []

    def __len__(self) -> int:
        return len(self.boxes)

    def __getitem__(self, index):  # type: ignore[no-untyped-def]
        self.read.append(index)
        if index in self.broken:
            raise TrainingError(f"img/{index}.jpg: cannot be read")
        image = np.zeros((240, 320, 3), np.uint8)
        x1, y1, x2, y2 = (round(v) for v in self.boxes[index].to_corners())
        image[y1:y2, x1:x2] = 255
        return image


def footage(name: str = "white", count: int = 30, broken: frozenset[int] = frozenset()) -> Footage:
    """Sizes change by up to 1.4 and aspects by up to 1.5 from frame to frame."""
    rng = np.random.default_rng(3)
    boxes = []
    for _ in range(count):
        size, aspect = 40 * math.exp(rng.uniform(-0.35, 0.35)), math.exp(rng.uniform(-0.4, 0.4))
        w, h = 2 * round(size * math.sqrt(aspect) / 2), 2 * round(size / math.sqrt(aspect) / 2)
        boxes.append(Box(float(rng.integers(120, 200)), float(rng.integers(90, 150)), w, h))
    return Footage(name, tuple(boxes), Pictures(boxes, broken))


def run(answer: Answer, pairs: int = 64, shift_px: float = 0.0, **more: object) -> Diagnosis:
    return diagnose(Knowing(answer, shift_px), [footage()], SETTINGS, pairs, 7, **more)  # type: ignore[arg-type]


def true_size(old: Size, now: Size) -> Size:
    return now


def test_a_network_that_sees_sizes_has_slopes_of_one() -> None:
    found = run(true_size).overall
    assert found.hits == found.found == 1.0
    assert found.centre_error_px is not None
    assert found.centre_error_px < 1.0
    for line in (found.scale, found.aspect):
        assert line is not None
        assert line.slope == pytest.approx(1.0, abs=0.04)
        assert line.intercept == pytest.approx(0.0, abs=0.03)
        assert line.correlation > 0.99
        assert line.spread < 0.03
    assert "nothing stands out" in run(true_size).verdict()[0]


def test_a_network_that_repeats_the_exemplars_size_has_slopes_of_zero() -> None:
    found = run(lambda old, now: old)
    for line in (found.overall.scale, found.overall.aspect):
        assert line is not None
        assert line.slope == pytest.approx(0.0, abs=0.05)
        assert line.spread < 0.03
    assert found.overall.found == 1.0
    assert found.overall.hits < 0.9  # sizes that are far off are no hits, and still count in the line
    told = " ".join(found.verdict())
    assert "under-estimated" in told
    assert "raise jitter.log_scale" in told
    assert "raise jitter.log_aspect" in told


def test_half_of_a_change_is_a_slope_of_a_half() -> None:
    found = run(lambda old, now: (math.sqrt(old[0] * now[0]), math.sqrt(old[1] * now[1]))).overall
    assert found.scale is not None
    assert found.scale.slope == pytest.approx(0.5, abs=0.03)


def test_boxes_that_are_too_large_everywhere_are_an_intercept() -> None:
    found = run(lambda old, now: (1.3 * now[0], 1.3 * now[1]))
    assert found.overall.scale is not None
    assert found.overall.scale.intercept == pytest.approx(math.log(1.3), abs=0.03)
    assert any("30% too large everywhere" in line or "31% too large everywhere" in line for line in found.verdict())


def test_a_network_that_misses_has_no_hits_and_no_lines() -> None:
    found = run(true_size, pairs=16, shift_px=150.0)
    assert found.overall.hits == found.overall.found == 0.0
    assert found.overall.scale is None
    assert found.overall.centre_error_px is None
    assert found.verdict()[0].startswith("hits 0%: 100% of the answers are elsewhere")


def test_a_network_beside_the_target_has_its_error() -> None:
    found = run(true_size, pairs=32, shift_px=9.0)
    assert found.overall.centre_error_px == pytest.approx(9.0 * math.sqrt(2), abs=1.0)
    assert any("centre error 1" in line for line in found.verdict())


def test_nothing_finite_is_a_miss() -> None:
    found = run(lambda old, now: (math.nan, math.nan), pairs=8)
    assert found.overall.hits == 0.0


def test_pairs_lie_near_each_other_and_follow_from_the_seed() -> None:
    item = footage(count=200)
    diagnose(Knowing(true_size), [item], SETTINGS, 40, 1)
    read = list(item.images.read)  # type: ignore[attr-defined]
    apart = [abs(a - b) for a, b in zip(read[::2], read[1::2], strict=True)]
    assert len(read) == 80
    assert 20 < max(apart) <= FRAME_RANGE
    assert run(true_size, pairs=12) == run(true_size, pairs=12)
    assert run(true_size, pairs=12).overall != diagnose(Knowing(true_size), [footage()], SETTINGS, 12, 8).overall


def test_sequences_share_the_pairs_and_are_told_apart() -> None:
    empty = Footage("empty", (None, None), Pictures([]))
    done: list[int] = []
    network = Knowing(true_size).train()
    found = diagnose(network, [footage("one"), empty, footage("two")], SETTINGS, 35, 1, report=done.append)
    assert [(part.name, part.pairs) for part in found.sequences] == [("one", 18), ("two", 17)]
    assert found.overall.pairs == 35
    assert done[-1] == 35
    assert network.modes == [False] * len(network.modes)
    assert network.training
    rows = found.table()
    assert [row.split()[0] for row in rows[1:]] == ["one", "two", "all"]
    assert len({row.index("|") for row in rows}) == 1
    assert json.loads(json.dumps(found.as_json(), allow_nan=False))["overall"]["pairs"] == 35


def test_a_weak_sequence_is_named() -> None:
    box = Box(0, 0, 40, 40)
    good = [Measured("good", box, box, (40, 40))] * 20
    weak = [Measured("weak", box, Box(100, 0, 40, 40), (40, 40))] * 10
    assert any("in weak:" in line and "good" not in line for line in Diagnosis.of(good + weak).verdict())


def test_pictures_that_cannot_be_read_are_counted() -> None:
    found = diagnose(Knowing(true_size), [footage(broken=frozenset(range(10)))], SETTINGS, 40, 1)
    assert 5 < found.overall.pairs < 40
    assert "unreadable picture: img/" in found.skipped[0]
    with pytest.raises(TrainingError, match=r"no pair could be made.*img/"):
        diagnose(Knowing(true_size), [footage(broken=frozenset(range(30)))], SETTINGS, 4, 1)


def test_without_a_target_there_is_nothing_to_diagnose() -> None:
    with pytest.raises(TrainingError, match=r"no sequence with a target in two frames \(empty\)"):
        diagnose(Knowing(true_size), [Footage("empty", (None, None), Pictures([]))], SETTINGS, 4, 1)


def test_a_line_is_the_least_squares_one() -> None:
    rng = np.random.default_rng(1)
    true = rng.uniform(-1, 1, 400)
    line = Line.fit(true, 0.3 + 0.7 * true + rng.normal(0, 0.1, 400))
    assert line is not None
    assert (line.slope, line.intercept) == (pytest.approx(0.7, abs=0.03), pytest.approx(0.3, abs=0.02))
    assert line.spread == pytest.approx(0.1, abs=0.02)
    assert Line.fit(true[:3], true[:3]) is None
    assert Line.fit(np.ones(50), true[:50]) is None
