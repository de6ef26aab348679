import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from control.range import MAX_RATIO, MIN_SIZE_PX, SizeRange, ground_range_m
from tests.control.builders import target
from tracker.box import Box

LAW = SizeRange(20.0, 40.0)


@given(st.floats(10, 150))
def test_half_the_size_is_twice_the_range(size_px):
    estimate = LAW.estimate(target(box=Box(320, 180, size_px * 2, size_px / 2)))
    assert estimate.valid
    assert estimate.range_m == pytest.approx(20.0 * 40.0 / size_px)


def test_sigma_follows_the_covariance_of_ln_size():
    cov = np.diag([1.0, 1.0, 0.02, 0.02])
    assert LAW.estimate(target(cov=cov)).sigma_m == pytest.approx(20.0 * 0.1)
    cov[2, 3] = cov[3, 2] = 0.02  # width and height wrong together do not average out
    assert LAW.estimate(target(cov=cov)).sigma_m == pytest.approx(20.0 * math.sqrt(0.02))


def test_sigma_is_the_spread_of_the_range():
    rng = np.random.default_rng(3)
    ln_size = rng.normal(0.0, 0.05, (4000, 2))
    ranges = [LAW.estimate(target(box=Box(0, 0, 40 * math.exp(w), 40 * math.exp(h)))).range_m for w, h in ln_size]
    claimed = LAW.estimate(target(cov=np.diag([1.0, 1.0, 0.0025, 0.0025]))).sigma_m
    assert np.std(ranges) == pytest.approx(claimed, rel=0.05)


@pytest.mark.parametrize(
    "changes",
    [
        {"box": None},
        {"cov": None},
        {"box": Box(320, 180, math.nan, 40)},
        {"box": Box(320, 180, math.inf, 40)},
        {"box": Box(320, 180, -4, 40)},
        {"box": Box(320, 180, 40 * MAX_RATIO * 1.01, 40 * MAX_RATIO * 1.01)},
        {"cov": np.diag([1.0, 1.0, 0.5, 0.5])},
        {"cov": np.diag([1.0, 1.0, -0.1, 0.1])},
        {"cov": np.diag([1.0, 1.0, math.nan, 0.1])},
        {"cov": np.diag([1.0, 1.0, math.inf, 0.1])},
    ],
)
def test_what_cannot_be_trusted_is_not_valid(changes):
    assert not LAW.estimate(target(**changes)).valid


def test_a_box_of_a_few_pixels_has_no_size():
    law = SizeRange(20.0, 8.0)
    assert law.estimate(target(box=Box(320, 180, MIN_SIZE_PX, MIN_SIZE_PX))).range_m == pytest.approx(40.0)
    assert not law.estimate(target(box=Box(320, 180, MIN_SIZE_PX * 0.99, MIN_SIZE_PX * 0.99))).valid


@pytest.mark.parametrize("values", [(0.0, 40.0), (20.0, math.nan), (-1.0, 40.0), (20.0, math.inf)])
def test_bad_references_are_refused(values):
    with pytest.raises(ValueError, match=r"SizeRange\.reference_"):
        SizeRange(*values)


@pytest.mark.parametrize(
    ("depression_deg", "height_m", "range_m"),
    [
        (30.0, 12.0, 24.0),
        (90.0, 12.0, 12.0),
        (10.01, 10.0, 10.0 / math.sin(math.radians(10.01))),
        (9.9, 10.0, None),  # too flat to say
        (-30.0, 12.0, None),  # the sky
        (30.0, 0.0, None),
        (30.0, -3.0, None),
        (30.0, 3.9, None),  # so low that the height of the target would be a large part of it
        (30.0, math.nan, None),
        (10.1, 100.0, None),  # further than anything that can be followed
    ],
)
def test_range_to_flat_ground(depression_deg, height_m, range_m):
    angle = math.radians(depression_deg)
    sight = np.array([math.cos(angle) * 0.6, math.cos(angle) * -0.8, math.sin(angle)])
    found = ground_range_m(sight, height_m)
    assert found == (None if range_m is None else pytest.approx(range_m))


@given(st.floats(0.2, 1.2), st.floats(6.0, 40.0), st.floats(0.3, 1.5))
def test_a_thing_that_stands_on_the_ground_is_not_taken_for_one_further_away(depression, height_m, half_height_m):
    """The line to its middle meets the ground behind it; the angle to its lower edge takes that out."""
    range_m = (height_m - half_height_m) / math.sin(depression)
    sight = np.array([math.cos(depression), 0.0, math.sin(depression)])
    half_height_rad = half_height_m / math.cos(depression) / range_m
    found = ground_range_m(sight, height_m, half_height_rad)
    assert found == pytest.approx(range_m, rel=1e-6)
    assert ground_range_m(sight, height_m) > range_m


@given(st.floats(0.1, 10.0), st.floats(10, 150))
def test_a_box_redrawn_larger_is_the_same_target_at_the_same_range(factor, size_px):
    before = LAW.estimate(target(box=Box(320, 180, size_px, size_px)))
    redrawn = LAW.resized(factor)
    after = redrawn.estimate(target(box=Box(320, 180, size_px * factor, size_px * factor)))
    if size_px * factor >= MIN_SIZE_PX:
        assert (after.valid, after.range_m) == (before.valid, pytest.approx(before.range_m))
    assert redrawn.reference_range_m == LAW.reference_range_m
    assert LAW.reference_size_px == 40.0


@pytest.mark.parametrize("factor", [0.0, -1.0, math.nan, math.inf])
def test_a_factor_that_cannot_be_is_refused(factor):
    with pytest.raises(ValueError, match="reference_size_px"):
        LAW.resized(factor)
