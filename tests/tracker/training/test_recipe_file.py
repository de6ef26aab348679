"""Recipes: built in and from files, what is wrong with one, and what the built-in ones promise."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from tracker.training.recipe import Curve, Labels, Recipe, Variant
from tracker.training.recipe_file import (
    RecipeError,
    builtin_names,
    load_recipe,
    parse_recipe,
    recipe_text,
)
from tracker.training.source_names import source_name

SMALL = """
name: small
description: for a test
sources:
  - kind: folders
    path: videos/otb
stages:
  - pairs: 100
"""

# Validation of the embedded weights: never trained on (TRAINING.md).
RESERVED = {
    "Basketball", "Human7", "MotorRolling", "Woman", "Drone1", "MotorcycleChase", "bmx-trees", "car-roundabout",
    "parkour", "dog", "drift-chicane", "bag",
}  # fmt: skip


def problems(text: str) -> tuple[str, ...]:
    with pytest.raises(RecipeError) as caught:
        parse_recipe(text, "some.yaml")
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("some.yaml: ")
    return caught.value.problems


def test_a_small_recipe_has_the_defaults() -> None:
    recipe = parse_recipe(SMALL, "some.yaml")
    assert recipe.variant is Variant.AAN
    assert recipe.stages[0].pairs == 100
    assert recipe.teacher is None


def test_empty_optional_sections() -> None:
    assert parse_recipe(SMALL + "teacher:\nema:\n", "some.yaml").ema is None
    assert problems(SMALL + "validation:\n") == ("line 9: validation: empty: must be a section with keys of its own",)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("kind: folders", "kind: foldrs", "line 5: sources[0].kind: 'foldrs' is not one of folders, got10k, vid"),
        ("kind: folders", "kind: foldrs", "did you mean folders?"),
        ("path: videos/otb", "pth: videos/otb", "line 6: sources[0].pth: unknown key; did you mean path?"),
        ("pairs: 100", "pairs: 100\n    minutes: 3", "line 8: stages[0]: give pairs or minutes, one of them"),
        ("pairs: 100", "pairs: 100\n    search_px: 230", "stages[0]: search_px 230 must be 127 + a multiple of 8"),
        ("stages:", "pairing: {negative: 0.8, patch: 0.3}\nstages:", "add up to 1.12; they are shares of all pairs"),
        ("path: videos/otb", 'path: "a\\nb"', r"line 6: sources[0].path: 'a\nb': holds the control character '\n'"),
        ("path: videos/otb", 'path: "a\\0b"', r"sources[0].path: 'a\x00b': holds the control character '\x00'"),
        ("description: for a test", 'description: "\\x1b[2J"', "line 3: description: '\\x1b[2J': holds the control"),
        ("pairs: 100", "pairs: 0", "line 8: stages[0].pairs: 0: must be a whole number from 1"),
        ("stages:", "augmentation: {gain: [2, 1]}\nstages:", "augmentation: gain must be a low and a high factor"),
        ("name: small", "name: Small Recipe", "line 2: name: 'Small Recipe': must match"),
        ("sources:", "size: full\nstart: {model: s, widen: s}\nsources:", "start: give model or widen, not both"),
        ("sources:", "start: {widen: s}\nsources:", "start.widen makes a network of size full"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(old: str, new: str, expected: str) -> None:
    assert any(expected in problem for problem in problems(SMALL.replace(old, new, 1)))


@pytest.mark.parametrize("start", ["model: s", "widen: s"])
def test_whole_weights_fit_no_other_variant(start: str) -> None:
    text = SMALL + f"size: full\nvariant: apn_df\nstart:\n  {start}\n"
    (problem,) = problems(text)
    assert problem.startswith(f"line 12: start.{start.split(':')[0]}: weights of SiamAPN++ do not fit variant apn_df")
    assert parse_recipe(text.replace("apn_df", "aan"), "some.yaml").variant is Variant.AAN


def test_a_backbone_fits_every_variant_and_a_teacher_none() -> None:
    text = SMALL + "variant: siamapn\nstart: {backbone: s}\n"
    assert parse_recipe(text, "some.yaml").start.backbone == "s"
    assert problems(text + "teacher: {model: full}\n")[0].startswith("line 11: teacher: SiamAPN++ would teach")


def test_two_sources_of_one_name() -> None:
    text = SMALL.replace("stages:", "  - {kind: got10k, path: elsewhere/otb/}\nstages:")
    assert problems(text) == ("line 7: sources[1]: is called otb, as sources[0] is; give one another name:",)
    parse_recipe(text.replace("elsewhere/otb/", "elsewhere/otb/, name: other"), "some.yaml")


def test_validation_needs_whole_sequences() -> None:
    text = SMALL + "validation:\n  sources:\n    - {kind: stills, annotations: a.csv}\n"
    (problem,) = problems(text)
    assert problem.startswith("line 11: validation.sources[0].kind: stills has no whole sequences")


@pytest.mark.parametrize(
    ("source", "name"),
    [
        ("{kind: folders, path: a/b/, name: mine}", "mine"),
        ("{kind: folders, path: a/b/}", "b"),
        ("{kind: vid, path: .}", "vid"),
        ("{kind: stills, annotations: a/voc/annotations.csv}", "voc"),
        ("{kind: stills, annotations: a/cars.v2.csv}", "cars"),
        ("{kind: coco, annotations: a/instances_val.json, images: a}", "instances_val"),
        ("{kind: simulator}", "simulator"),
        ("{kind: packed, path: p, set_name: voc}", "voc"),
    ],
)
def test_default_names(source: str, name: str) -> None:
    recipe = parse_recipe(SMALL.replace("  - kind: folders\n    path: videos/otb", f"  - {source}"), "some.yaml")
    assert source_name(recipe.sources[0]) == name


def test_a_file_that_is_there_comes_before_a_built_in_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert load_recipe("recipes/smoke.yaml").name == load_recipe("smoke").name == "smoke"
    (tmp_path / "recipes").mkdir()
    (tmp_path / "recipes" / "smoke.yaml").write_text(SMALL)
    assert load_recipe("recipes/smoke.yaml").name == "small"
    assert load_recipe("smoke").name == "smoke"


def test_what_is_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RecipeError, match=r"did you mean smoke\?"):
        load_recipe("smok")
    with pytest.raises(RecipeError, match=r"nowhere\.yaml: cannot be read: No such file"):
        load_recipe("nowhere.yaml")
    with pytest.raises(RecipeError, match="cannot be read: Is a directory"):
        load_recipe(tmp_path)
    (tmp_path / "bytes.yaml").write_bytes(b"\xff\xfe")
    with pytest.raises(RecipeError, match="not text in UTF-8"):
        load_recipe("bytes.yaml")


@pytest.mark.parametrize("name", builtin_names())
def test_built_in_recipes_are_whole_and_say_why(name: str) -> None:
    recipe = load_recipe(name)
    assert recipe.name == name
    assert recipe_text(name).startswith("# ")
    assert all(len(line) <= 120 for line in recipe_text(name).splitlines())
    assert recipe.validation.sources


@pytest.mark.parametrize("name", ["cpu", "full", "ablation"])
def test_the_reserved_sequences_are_those_validated_on(name: str) -> None:
    recipe = load_recipe(name)
    assert {only for spec in recipe.validation.sources for only in spec.only} == RESERVED
    assert all(not spec.only for spec in recipe.sources)


def test_the_paper_s_schedule() -> None:
    """Facts of the published code: rates as applied, 600,000 pairs an epoch, 50 epochs, the model of epoch 25."""
    recipe = load_recipe("paper")
    epochs = [(stage.pairs or 0) / 600_000 for stage in recipe.stages]
    assert epochs == [5, 5, 16, 24]
    assert [stage.frozen_layers for stage in recipe.stages] == [5, 5, 2, 2]
    assert all(s.batch == 220 and s.search_px == 287 and s.warmup_pairs == 0 for s in recipe.stages)
    assert all(s.curve is Curve.LOG and s.jitter == recipe.stages[0].jitter for s in recipe.stages)
    assert recipe.labels is Labels.PAPER
    assert recipe.ema is None
    assert (recipe.optimiser.kind, recipe.optimiser.decay_all) == ("sgd", True)
    # From epoch 5 on half of 0.01 to 0.0005 in logarithmic steps; stages are continuous where the code has epochs.
    for stage, first in zip(recipe.stages[1:], (5, 10, 26), strict=True):
        assert math.isclose(stage.lr, _applied(first), rel_tol=0.03)
    for stage, following in zip(recipe.stages[1:], recipe.stages[2:], strict=False):
        assert stage.lr_end == following.lr
    assert math.isclose(recipe.stages[-1].lr_end, _applied(49), rel_tol=0.03)
    assert recipe.stages[0].lr == 0.0025
    assert math.isclose(recipe.stages[0].lr_end, 0.5 * 0.0087, rel_tol=0.01)


def _applied(epoch: int) -> float:
    return 0.5 * 0.01 * (0.0005 / 0.01) ** ((epoch - 5) / 44)


def test_the_smoke_recipe_needs_no_data_and_is_short() -> None:
    recipe: Recipe = load_recipe("smoke")
    assert {spec.kind for spec in (*recipe.sources, *recipe.validation.sources)} == {"simulator"}
    # Three minutes at 8 pairs/s (two AVX2 cores), less half a minute to draw and to validate.
    assert sum(stage.pairs or 0 for stage in recipe.stages) <= 150 * 8


def test_the_simulator_does_not_train_on_the_worlds_that_are_kept_for_validation() -> None:
    text = SMALL.replace("kind: folders\n    path: videos/otb", "{kind: simulator, seed: 1, sequences: 8}")
    kept = "validation: {sources: [{kind: simulator, name: kept, seed: %d, sequences: 2}]}\n"
    parse_recipe(text + kept % 9, "some.yaml")
    assert "worlds [8] are both trained and validated on" in problems(text + kept % 8)[0]
