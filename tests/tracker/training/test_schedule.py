"""Learning rates over a stage."""

from __future__ import annotations

from itertools import pairwise

import pytest

from tracker.training.recipe import Curve, Stage
from tracker.training.schedule import rate_at


def _stage(**values: object) -> Stage:
    return Stage.model_validate({"pairs": 100_000, "batch": 16, "lr": 0.01, "warmup_pairs": 0, **values})


@pytest.mark.parametrize(("progress", "rate"), [(0.0, 0.01), (0.5, 0.006), (1.0, 0.002), (2.0, 0.002), (-1.0, 0.01)])
def test_cosine(progress: float, rate: float) -> None:
    assert rate_at(_stage(lr_end=0.002), progress, 50_000) == pytest.approx(rate)


def test_cosine_is_flat_at_both_ends_and_falls() -> None:
    rates = [rate_at(_stage(), i / 100, 50_000) for i in range(101)]
    assert all(a > b for a, b in pairwise(rates))
    assert rates[0] - rates[1] < 0.1 * (rates[50] - rates[51])
    assert rates[99] - rates[100] < 0.1 * (rates[50] - rates[51])


def test_log_has_equal_ratios() -> None:
    """The published schedule: 0.01 to 0.0005 in equal steps of the logarithm."""
    stage = _stage(curve=Curve.LOG, lr_end=0.0005)
    rates = [rate_at(stage, i / 4, 50_000) for i in range(5)]
    assert rates[0] == pytest.approx(0.01)
    assert rates[4] == pytest.approx(0.0005)
    assert [b / a for a, b in pairwise(rates)] == pytest.approx([0.05**0.25] * 4)


def test_constant() -> None:
    assert {rate_at(_stage(curve=Curve.CONSTANT), p, 50_000) for p in (0.0, 0.3, 1.0)} == {0.01}


def test_warm_up_is_linear_counts_its_own_batch_and_meets_the_curve() -> None:
    stage = _stage(curve=Curve.CONSTANT, warmup_pairs=160, warmup_from=0.2)
    rates = [rate_at(stage, 0.0, 16 * step) for step in range(12)]
    assert rates[0] == pytest.approx(0.01 * (0.2 + 0.8 * 0.1))
    assert rates[4] == pytest.approx(0.01 * (0.2 + 0.8 * 0.5))
    assert rates[9:] == pytest.approx([0.01] * 3)
    falling = _stage(warmup_pairs=50_000)
    jumps = [rate_at(falling, i / 100_000, i) for i in range(49_000, 51_000, 16)]
    assert max(abs(a - b) for a, b in pairwise(jumps)) < 1e-4 * 0.01 * 16


def test_a_rate_of_zero_is_zero_on_every_curve() -> None:
    for curve in Curve:
        assert rate_at(_stage(lr=0.0, lr_end=0.0 if curve is not Curve.LOG else 1e-6, curve=curve), 0.0, 0) == 0.0
