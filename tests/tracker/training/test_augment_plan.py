"""The plan keeps to the recipe, and a row depends on nothing but the seed and its number."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import pytest

from tests.tracker.training.augment_scene import NOTHING, STILL, only, plan_of
from tracker.training.augment import ranges
from tracker.training.augment.plan import Effect, Plan
from tracker.training.recipe import Augmentation, Jitter

MANY = 6000


def _arrays(part: Any, name: str = "") -> dict[str, np.ndarray]:
    out: dict[str, np.ndarray] = {}
    for field in fields(part):
        value = getattr(part, field.name)
        key = f"{name}{field.name}"
        out |= _arrays(value, f"{key}.") if is_dataclass(value) else {key: value}
    return out


def _different(a: Plan, b: Plan) -> set[str]:
    ours, theirs = _arrays(a), _arrays(b)
    return {name for name in ours if not np.array_equal(ours[name], theirs[name])}


def test_every_array_has_one_row_per_pair() -> None:
    plan = plan_of(Augmentation(), Jitter(), 7)
    assert len(plan) == 7
    assert {len(a) for a in _arrays(plan).values()} == {7}


def test_same_seed_same_plan_other_seed_another() -> None:
    plan = plan_of(Augmentation(), Jitter(), 50)
    assert not _different(plan, plan_of(Augmentation(), Jitter(), 50))
    assert _different(plan, plan_of(Augmentation(), Jitter(), 50, seed=4)) == set(_arrays(plan))


def test_a_row_does_not_depend_on_how_many_there_are() -> None:
    long = plan_of(Augmentation(), Jitter(), 64)
    assert not _different(plan_of(Augmentation(), Jitter(), 10), long.rows(slice(0, 10)))
    assert not _different(long.rows(np.array([5, 3])), long.rows(slice(5, 2, -2)))


def test_a_changed_share_leaves_the_other_draws() -> None:
    plan = plan_of(Augmentation(), Jitter(), 200)
    assert _different(plan, plan_of(Augmentation(occlusion=0.9), Jitter(), 200)) == {"occlusion.applied"}
    assert _different(plan, plan_of(Augmentation(), Jitter(log_scale=0.1), 200)) == {"search.log_scale"}
    assert _different(plan, plan_of(Augmentation(fog=0.3), Jitter(), 200)) == {"degradation.effect"}


def test_a_plan_of_nothing_does_nothing() -> None:
    plan = plan_of(NOTHING, STILL, 100)
    assert not (plan.flip | plan.gray | plan.occlusion.applied | plan.lookalike.applied).any()
    assert (plan.degradation.effect == Effect.NONE).all()
    assert (plan.exemplar_low_resolution == 1).all()
    for colour in (plan.exemplar_colour, plan.search_colour):
        assert (colour.gain == 1).all()
        assert (colour.gamma == 1).all()
        assert not colour.offset_bgr.any()
    for placement in (plan.exemplar, plan.search):
        assert not any(np.any(getattr(placement, f.name)) for f in fields(placement))


@pytest.mark.parametrize("which", ["search", "exemplar"])
def test_jitter_fills_its_ranges_and_stays_within(which: str) -> None:
    jitter = Jitter()
    prefix = "" if which == "search" else "exemplar_"
    part = getattr(plan_of(NOTHING, jitter, MANY), which)
    reaches = {
        "shift_px": getattr(jitter, f"{prefix}shift_px"),
        "log_scale": getattr(jitter, f"{prefix}log_scale"),
        "log_aspect": getattr(jitter, f"{prefix}log_aspect"),
        "angle_rad": np.radians(getattr(jitter, f"{prefix}angle_deg")),
    }
    for name, reach in reaches.items():
        values = getattr(part, name)
        assert np.abs(values).max() <= reach
        assert values.max() > 0.98 * reach
        assert values.min() < -0.98 * reach
        assert abs(values.mean()) < 0.04 * reach
    assert np.mean(part.angle_rad == 0) == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize(("search_px", "reach"), [(223, 48), (287, 80)])
def test_targets_stay_within_the_cells_of_the_map(search_px: int, reach: float) -> None:
    plan = plan_of(NOTHING, Jitter(shift_px=200), MANY, search=search_px)
    assert 0.98 * reach < np.abs(plan.search.shift_px).max() <= reach


def test_shares_are_those_of_the_recipe() -> None:
    recipe = Augmentation()
    plan = plan_of(recipe, Jitter(), MANY)
    for effect in Effect:
        if effect is not Effect.NONE:
            share = np.mean(plan.degradation.effect == effect)
            assert share == pytest.approx(getattr(recipe, effect.name.lower()), abs=0.015), effect
    drawn = {
        "flip": plan.flip,
        "gray": plan.gray,
        "occlusion": plan.occlusion.applied,
        "lookalike": plan.lookalike.applied,
        "exemplar_low_resolution": plan.exemplar_low_resolution < 1,
        "colour": plan.search_colour.gain != 1,
        "gamma": plan.exemplar_colour.gamma != 1,
    }
    for name, flags in drawn.items():
        assert np.mean(flags) == pytest.approx(getattr(recipe, name), abs=0.025), name


@pytest.mark.parametrize("effect", [e for e in Effect if e is not Effect.NONE])
def test_a_share_of_one_is_always(effect: Effect) -> None:
    assert (plan_of(only(effect.name.lower()), STILL, 500).degradation.effect == effect).all()


def test_colours_of_the_two_crops_are_independent_and_within_range() -> None:
    recipe = Augmentation(colour=1.0, gamma=1.0)
    plan = plan_of(recipe, STILL, MANY)
    ours, other = plan.search_colour, plan.exemplar_colour
    assert abs(np.corrcoef(ours.gain, other.gain)[0, 1]) < 0.05
    assert ours.gain.min() >= recipe.gain[0]
    assert ours.gain.max() <= recipe.gain[1]
    assert ours.gamma.min() >= ranges.GAMMA[0]
    assert ours.gamma.max() <= ranges.GAMMA[1]
    cast = ours.offset_bgr - ours.offset_bgr.mean(axis=1, keepdims=True)
    assert cast.std() == pytest.approx(recipe.cast * np.sqrt(2 / 3), rel=0.05)
    assert np.isfinite(ours.offset_bgr).all()
    assert np.median(np.abs(ours.offset_bgr.mean(axis=1))) == pytest.approx(recipe.offset / 2, rel=0.1)
