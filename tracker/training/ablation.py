"""The paper's component study on one's own data: each variant trained for equally many pairs, and the w1 sweep.

The numbers stand beside the paper's and are never called a reproduction: the paper's networks saw some 15 million
pairs of other data and were scored on UAV20L.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import nn

from tracker.siamapnpp.network import SIZES, SiamAPNpp
from tracker.siamapnpp.settings import TrackerSettings
from tracker.training.ablation_report import write_report
from tracker.training.ablation_results import Ablation, SweepPoint, VariantResult
from tracker.training.errors import TrainingError
from tracker.training.recipe import Recipe, Stage, Start, Variant
from tracker.training.sources.packed import without_places
from tracker.training.types import Footage
from tracker.training.validate import SETTINGS, SequenceScore, Tracks, mean_score, validate

__all__ = ["W1_VALUES", "Ablation", "SweepPoint", "TrainedVariant", "VariantResult", "run_ablation", "sweep_w1"]

W1_VALUES = tuple(round(0.5 + 0.1 * i, 1) for i in range(11))  # the paper's range; its best is 1.2
RESULT, WEIGHTS, SWEEP = "result.json", "weights.safetensors", "w1.json"


@dataclass(frozen=True, slots=True, eq=False)
class TrainedVariant:
    """What training made: the network to be judged (the average of its weights where there is one) and its cost."""

    network: nn.Module
    pairs: int
    pairs_per_s: float | None


Train = Callable[[Recipe, Path], TrainedVariant | None]

WHOLE = Tracks()


def run_ablation(
    recipe: Recipe,
    pairs: int,
    variants: Sequence[Variant],
    train: Train,
    footage: Sequence[Footage],
    folder: Path,
    *,
    settings: TrackerSettings = SETTINGS,
    w1_values: Sequence[float] = W1_VALUES,
    sweep_network: nn.Module | None = None,
    should_stop: Callable[[], bool] = lambda: False,
    report: Callable[[str], None] = lambda line: None,
) -> Ablation | None:
    """Train and score each variant, sweep w1, write ablation.json, ablation.md and ablation.png; None when stopped.

    `train(recipe, folder)` trains a whole recipe (that of `variant_recipe`) with checkpoints in a folder of its own and
    gives None when it was stopped. `footage` is what is tracked, as the recipe's validation says.
    w1 is swept on `sweep_network`, else on the `aan` variant; with no `w1_values` not at all. What is complete in
    `folder` is not done again. Raises TrainingError without footage or variants, for results of another recipe in
    `folder`, and when the variants' numbers of pairs differ.
    """
    if not footage or not variants:
        raise TrainingError("an ablation needs variants, and sequences to track: name some in the recipe's validation")
    key = _key(recipe, pairs, settings, footage)
    tracks = Tracks.of(recipe.validation)
    results: list[VariantResult] = []
    for variant in (v for v in Variant if v in variants):
        own = folder / "variants" / variant.value
        result = _stored(own, variant, key)
        if result is None:
            report(f"{variant.value}: training {pairs} pairs")
            trained = train(variant_recipe(recipe, variant, pairs), own)
            result = None if trained is None else _judge(variant, trained, footage, settings, tracks, should_stop)
            if trained is None or result is None:
                return None
            _store(own, result, key, trained.network)
        report(f"{variant.value}: {_brief(result)}")
        results.append(result)
    _check_equal(results)
    sweep = _sweep(recipe, sweep_network, footage, settings, w1_values, folder, key, should_stop)
    if sweep is None:
        return None
    names = tuple(item.name for item in footage)
    ablation = Ablation(recipe.name, recipe.size, names, tracks, tuple(results), sweep)
    write_report(ablation, folder)
    return ablation


def variant_recipe(recipe: Recipe, variant: Variant, pairs: int) -> Recipe:
    """The same recipe for another variant and `pairs` pairs, shared among its stages in their proportions.

    Whole weights to start from become their backbone alone, and a teacher is left out: both hold the attention that
    some variants lack. Raises TrainingError when stages mix pairs and minutes, or for a start by widening.
    """
    start = recipe.start
    if start.widen:
        raise TrainingError(
            f"recipe {recipe.name}: start.widen makes a network of variant aan, which the others cannot start from; "
            "give start.backbone, or nothing"
        )
    if start.model:
        start = Start(backbone=start.backbone or start.model)
    lengths = [stage.pairs if stage.pairs is not None else stage.minutes for stage in recipe.stages]
    if len({stage.pairs is None for stage in recipe.stages}) > 1:
        raise TrainingError(f"recipe {recipe.name}: give all stages pairs or all minutes, to share {pairs} pairs out")
    total = sum(float(length or 0) for length in lengths)
    stages = tuple(
        _shortened(stage, pairs * float(length or 0) / total, pairs / total)
        for stage, length in zip(recipe.stages, lengths, strict=True)
    )
    changed = {"variant": variant, "stages": stages, "start": start, "teacher": None}
    return recipe.model_copy(update=changed)


def sweep_w1(
    network: nn.Module,
    footage: Sequence[Footage],
    settings: TrackerSettings,
    values: Sequence[float] = W1_VALUES,
    tracks: Tracks = WHOLE,
    should_stop: Callable[[], bool] = lambda: False,
) -> tuple[SweepPoint, ...] | None:
    """Scores of the raw tracker for each weight of the first classification map (inference only); None when stopped."""
    points = []
    for value in values:
        _, w2, w3 = settings.class_weights
        scores = validate(network, footage, replace(settings, class_weights=(value, w2, w3)), tracks, should_stop)
        mean = None if scores is None else _mean(scores)
        if mean is None:
            return None
        points.append(SweepPoint(value, mean[0], mean[1]))
    return tuple(points)


def _shortened(stage: Stage, pairs: float, factor: float) -> Stage:
    whole = max(1, round(pairs / stage.batch)) * stage.batch
    # A stage in minutes says nothing of pairs, so its warm-up is kept within a tenth of the new length.
    most = stage.warmup_pairs * min(1.0, factor) if stage.pairs is not None else min(stage.warmup_pairs, whole / 10)
    return stage.model_copy(update={"pairs": whole, "minutes": None, "warmup_pairs": round(most)})


def _judge(
    variant: Variant,
    trained: TrainedVariant,
    footage: Sequence[Footage],
    settings: TrackerSettings,
    tracks: Tracks,
    should_stop: Callable[[], bool],
) -> VariantResult | None:
    scores = validate(trained.network, footage, settings, tracks, should_stop)
    if scores is None:
        return None
    auc, p20 = _mean(scores)
    count = sum(p.numel() for p in trained.network.parameters())
    return VariantResult(variant, trained.pairs, trained.pairs_per_s, count, auc, p20, scores)


def _mean(scores: Sequence[SequenceScore]) -> tuple[float, float]:
    mean = mean_score(scores)
    if mean is None or mean.auc is None or mean.p20 is None:
        names = ", ".join(score.name for score in scores)
        raise TrainingError(f"no frame with a target in the validation sequences {names}; name other ones")
    return mean.auc, mean.p20


def _sweep(
    recipe: Recipe,
    network: nn.Module | None,
    footage: Sequence[Footage],
    settings: TrackerSettings,
    values: Sequence[float],
    folder: Path,
    key: str,
    should_stop: Callable[[], bool],
) -> tuple[SweepPoint, ...] | None:
    """Empty when there is nothing to sweep, None when stopped; an earlier sweep of the variant's is taken as it is."""
    trained, stored = folder / "variants" / Variant.AAN.value / WEIGHTS, folder / SWEEP
    if not values or (network is None and not trained.is_file()):
        return ()
    key = f"{key} {list(values)} {network is not None}"
    if network is None:
        points = _stored_sweep(stored, key)
        if points is not None:
            return points
        network = _trained_aan(trained, recipe)
    points = sweep_w1(network, footage, settings, values, Tracks.of(recipe.validation), should_stop)
    if points is not None:
        _write(stored, {"key": key, "points": [point.as_json() for point in points]})
    return points


def _stored_sweep(path: Path, key: str) -> tuple[SweepPoint, ...] | None:
    """An earlier sweep of the same; None when there is none that can be read: it is the work of minutes."""
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        return tuple(SweepPoint.from_json(point) for point in told["points"]) if told["key"] == key else None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def _trained_aan(path: Path, recipe: Recipe) -> nn.Module:
    network = SiamAPNpp(SIZES[recipe.size])
    try:
        network.load_state_dict(load_file(path))
    except (OSError, SafetensorError, RuntimeError) as error:
        reason = str(error).splitlines()[0]
        raise TrainingError(
            f"{path}: not the trained weights ({reason}); delete {path.parent} to train anew"
        ) from error
    return network


def _check_equal(results: Sequence[VariantResult]) -> None:
    if len({result.pairs for result in results}) > 1:
        told = ", ".join(f"{result.variant.value} {result.pairs}" for result in results)
        raise TrainingError(f"the variants were not trained for equally many pairs ({told}); nothing can be compared")


def _key(recipe: Recipe, pairs: int, settings: TrackerSettings, footage: Sequence[Footage]) -> str:
    """What the results depend on; another variant of the same recipe has the same key."""
    whole = without_places(recipe.model_copy(update={"variant": Variant.AAN}))
    told = json.dumps([whole, pairs, repr(settings), [(f.name, len(f.truth)) for f in footage]], sort_keys=True)
    return hashlib.sha256(told.encode()).hexdigest()


def _stored(folder: Path, variant: Variant, key: str) -> VariantResult | None:
    path = folder / RESULT
    if not path.is_file():
        return None
    try:
        told: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if told["key"] == key:
            return VariantResult.from_json(variant, told["result"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise TrainingError(f"{path}: not a result of an ablation ({error}); delete it to train anew") from error
    raise TrainingError(f"{path}: from another recipe, length or validation; choose another folder or delete it")


def _store(folder: Path, result: VariantResult, key: str, network: nn.Module) -> None:
    """Weights first: a result says that everything else is there. Raises TrainingError when they cannot be written."""
    tensors = {name: value.detach().cpu().contiguous() for name, value in network.state_dict().items()}
    part = folder / f"{WEIGHTS}.part"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        save_file(tensors, part)
        part.replace(folder / WEIGHTS)
        _write(folder / RESULT, {"key": key, "result": result.as_json()})
    except (OSError, SafetensorError) as error:
        part.unlink(missing_ok=True)
        reason = getattr(error, "strerror", None) or error
        raise TrainingError(f"{folder}: cannot be written ({reason}); make room, then give the same command") from error


def _write(path: Path, what: dict[str, Any]) -> None:
    part = path.with_suffix(".part")
    part.write_text(json.dumps(what, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    part.replace(path)


def _brief(result: VariantResult) -> str:
    return f"{result.pairs} pairs, AUC {result.auc:.3f}, P20 {result.p20:.3f}"
