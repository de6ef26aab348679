from __future__ import annotations

import math
from itertools import pairwise

import pytest

from sitl.plant.wind import Wind


def test_without_gusts_it_is_the_mean() -> None:
    assert Wind((1.0, -2.0, 0.5)).at(7.3) == (1.0, -2.0, 0.5)
    assert Wind((1.0, -2.0, 0.5), mirrored=True).at(7.3) == (1.0, 2.0, 0.5)


def test_it_depends_on_time_and_seed_alone() -> None:
    times = [0.0, 0.013, 0.5, 3.999, 4.0]
    every_step = Wind(gust_sigma_m_s=2.0, seed=4)
    for index in range(1601):
        every_step.at(index / 400.0)
    there = [Wind(gust_sigma_m_s=2.0, seed=4).at(t) for t in times]
    assert [every_step.at(t) for t in times] == there  # back in time, too
    assert Wind(gust_sigma_m_s=2.0, seed=5).at(3.0) != every_step.at(3.0)


def test_gusts_have_the_asked_size_and_memory() -> None:
    wind = Wind((3.0, 0.0, 0.0), gust_sigma_m_s=2.0, gust_time_s=1.5, seed=11)
    series = [wind.at(0.1 * k) for k in range(20000)]
    for axis, (mean, sigma) in enumerate([(3.0, 2.0), (0.0, 2.0), (0.0, 1.0)]):
        values = [v[axis] for v in series]
        centre = sum(values) / len(values)
        spread = math.sqrt(sum((v - centre) ** 2 for v in values) / len(values))
        assert centre == pytest.approx(mean, abs=0.3)
        assert spread == pytest.approx(sigma, rel=0.1)
        later = sum((a - centre) * (b - centre) for a, b in zip(values, values[15:], strict=False)) / len(values)
        assert later / spread**2 == pytest.approx(math.exp(-1.0), abs=0.08)


def test_it_is_continuous() -> None:
    wind = Wind(gust_sigma_m_s=2.0, gust_time_s=1.0, seed=2)
    series = [wind.at(k / 1000.0) for k in range(3000)]
    assert max(math.dist(a, b) for a, b in pairwise(series)) < 0.15


def test_the_mirror_flips_east_only() -> None:
    straight = Wind((1.0, 2.0, 0.1), 1.5, 2.0, seed=9)
    mirrored = Wind((1.0, 2.0, 0.1), 1.5, 2.0, seed=9, mirrored=True)
    for k in range(100):
        north, east, down = straight.at(0.07 * k)
        assert mirrored.at(0.07 * k) == (north, -east, down)


@pytest.mark.parametrize(
    "bad",
    [
        {"mean_ned_m_s": (math.nan, 0.0, 0.0)},
        {"gust_sigma_m_s": -1.0},
        {"gust_time_s": 0.0},
        {"gust_sigma_m_s": math.inf},
    ],
)
def test_refuses_nonsense(bad: dict) -> None:
    with pytest.raises(ValueError, match="wind"):
        Wind(**bad)
