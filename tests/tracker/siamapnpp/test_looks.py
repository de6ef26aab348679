"""Looks of places and the memory of them."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from tracker.engines.torch_engine import Precision, TorchEngine
from tracker.messages import MemorySlot
from tracker.siamapnpp.embedding import of_exemplar, of_place
from tracker.siamapnpp.memory import MAX_ANCHORS, ExemplarMemory
from tracker.siamapnpp.network import NetworkSize, SiamAPNpp

TINY = NetworkSize((4, 8, 8, 8, 8), 8)


def _axis(k: int) -> np.ndarray:
    return np.eye(8)[k]


def test_the_first_look_is_kept_for_ever() -> None:
    memory = ExemplarMemory()
    assert memory.likeness(_axis(0)) == (None, None)
    memory.start(_axis(0))
    assert memory.likeness(_axis(0)) == (1.0, None)
    for k in (1, 2, 3):
        memory.keep(_axis(k), MemorySlot.RECENT)
        memory.keep(_axis(k), MemorySlot.ANCHOR)
    assert memory.likeness(_axis(0)) == (1.0, 0.0)
    assert memory.likeness(None) == (None, None)


def test_recent_is_replaced_and_the_oldest_anchor_goes() -> None:
    memory = ExemplarMemory()
    memory.start(_axis(0))
    memory.keep(_axis(1), MemorySlot.RECENT)
    memory.keep(_axis(2), MemorySlot.RECENT)
    assert memory.likeness(_axis(1))[1] == 0.0
    assert memory.likeness(_axis(2))[1] == 1.0
    assert MAX_ANCHORS == 3
    for k in range(3, 3 + MAX_ANCHORS + 1):
        memory.keep(_axis(k), MemorySlot.ANCHOR)
    assert memory.likeness(_axis(3))[1] == 0.0
    assert [memory.likeness(_axis(k))[1] for k in range(4, 4 + MAX_ANCHORS)] == [1.0] * MAX_ANCHORS
    assert memory.likeness(_axis(2))[1] == 1.0
    memory.keep(None, MemorySlot.RECENT)
    assert memory.likeness(_axis(2))[1] == 1.0


def test_a_new_target_starts_with_an_empty_memory() -> None:
    memory = ExemplarMemory()
    memory.start(_axis(0))
    memory.keep(_axis(1), MemorySlot.RECENT)
    memory.keep(_axis(1), MemorySlot.ANCHOR)
    memory.start(_axis(2))
    assert memory.likeness(_axis(1)) == (0.0, None)
    memory.start(None)
    assert not memory.has_first
    assert memory.likeness(_axis(1)) == (None, None)


@pytest.mark.parametrize(("row", "column"), [(10, 10), (4, 13), (0, 20)])
def test_a_place_in_a_search_crop_looks_as_its_exemplar_crop_does(row: int, column: int) -> None:
    """At a cell's centre to rounding, because the network has no padding; a third of a cell beside it nearly."""
    torch.manual_seed(0)
    engine = TorchEngine(SiamAPNpp(TINY), Precision.FP32, "cpu")
    rng = np.random.default_rng(2)
    search = np.kron(rng.integers(0, 256, (41, 41, 3), np.uint8), np.ones((7, 7, 1), np.uint8))
    exemplar = search[8 * row : 8 * row + 127, 8 * column : 8 * column + 127]
    look = of_exemplar(engine.set_exemplar(exemplar))
    features = engine.search(search).features
    assert look is not None
    assert features is not None
    x, y = 8.0 * column - 80, 8.0 * row - 80
    there, beside, elsewhere = (
        of_place(features, x + dx, y) for dx in (0.0, np.sign(-x or 1) * 2.7, 48.0 * np.sign(-x or 1))
    )
    assert there is not None
    assert beside is not None
    assert elsewhere is not None
    assert there @ look == pytest.approx(1.0, abs=1e-4)
    assert 1.0 - 1e-6 > beside @ look > elsewhere @ look
    assert np.array_equal(of_exemplar(engine.embed(exemplar)), look)


def test_no_look_far_outside_or_of_nothing_finite() -> None:
    features = np.random.default_rng(0).standard_normal((4, 26, 26)).astype(np.float32)
    at_the_last = of_place(features, 88.0, 0.0)
    assert at_the_last is not None
    assert np.array_equal(at_the_last, of_place(features, 95.0, 0.0))  # up to a cell beyond
    assert of_place(features, 97.0, 0.0) is None
    assert of_place(features, 0.0, -97.0) is None
    assert of_place(features, float("nan"), 0.0) is None
    assert of_place(features * np.float32("nan"), 0.0, 0.0) is None
    assert of_exemplar(np.zeros((4, 6, 6), np.float32)) is None
