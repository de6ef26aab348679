"""A recipe cut to a time or to a number of pairs: its stages keep their proportions."""

from __future__ import annotations

import math
from collections.abc import Sequence

from tracker.siamapnpp.crop import EXEMPLAR_PX
from tracker.training.errors import TrainingError
from tracker.training.recipe import Recipe, Stage

WARMUP_SHARE = 0.1  # of a stage at most: a warm-up as long as its stage would never let it learn


def rescale(recipe: Recipe, minutes: float | None = None, pairs: int | None = None) -> Recipe:
    """The same recipe for `minutes` or `pairs` in all, one of them; without any the recipe itself.

    Every stage keeps its share. From pairs to minutes, a pair counts by its pixels, as its cost grows with them; from
    minutes to pairs the shares of the time become those of the pairs. Warm-ups shrink with their stages.
    Raises TrainingError when both are given, when a value is not positive, or when the stages are of both kinds.
    """
    if minutes is None and pairs is None:
        return recipe
    if minutes is not None and pairs is not None:
        raise TrainingError("give minutes or pairs for the length of the run, not both")
    wanted = minutes if minutes is not None else pairs
    if wanted is None or not (math.isfinite(wanted) and wanted > 0):
        raise TrainingError(f"the length of a run must be above 0, got {wanted}")
    shares = _shares(recipe, in_time=minutes is not None)
    if minutes is not None:
        stages = [_of_minutes(s, minutes * share) for s, share in zip(recipe.stages, shares, strict=True)]
    else:
        stages = [_of_pairs(s, wanted * share) for s, share in zip(recipe.stages, shares, strict=True)]
    return recipe.model_copy(update={"stages": tuple(stages)})


def planned_pairs(stages: Sequence[Stage]) -> int | None:
    """Pairs of whole batches that the stages will see; None when one of them goes by the clock."""
    total = 0
    for stage in stages:
        steps = steps_of(stage)
        if steps is None:
            return None
        total += steps * stage.batch
    return total


def steps_of(stage: Stage) -> int | None:
    """Steps of a stage counted in pairs, the last batch whole; None for one that goes by the clock."""
    return None if stage.pairs is None else -(-stage.pairs // stage.batch)


def _shares(recipe: Recipe, in_time: bool) -> list[float]:
    by_pairs = [s.pairs is not None for s in recipe.stages]
    if any(by_pairs) and not all(by_pairs):
        raise TrainingError(
            f"recipe {recipe.name}: some stages are given in pairs and some in minutes, so there is no proportion "
            "to keep; give all of them in the same unit"
        )
    if all(by_pairs):
        weights = [float(s.pairs or 0) * (_pixels(s) if in_time else 1.0) for s in recipe.stages]
    else:
        weights = [float(s.minutes or 0.0) for s in recipe.stages]
    return [w / sum(weights) for w in weights]


def _pixels(stage: Stage) -> float:
    return float(EXEMPLAR_PX**2 + stage.search_px**2)


def _of_minutes(stage: Stage, minutes: float) -> Stage:
    warmup = stage.warmup_pairs
    if stage.minutes is not None and minutes < stage.minutes:  # the same machine makes fewer pairs in less time
        warmup = int(warmup * minutes / stage.minutes)
    return _checked(stage, minutes=minutes, pairs=None, warmup_pairs=warmup)


def _of_pairs(stage: Stage, pairs: float) -> Stage:
    count = max(stage.batch, round(pairs))
    warmup = min(stage.warmup_pairs, int(WARMUP_SHARE * count))
    if stage.pairs is not None and count >= stage.pairs:
        warmup = stage.warmup_pairs
    return _checked(stage, minutes=None, pairs=count, warmup_pairs=warmup)


def _checked(stage: Stage, **changes: float | int | None) -> Stage:
    try:
        return Stage.model_validate({**stage.model_dump(), **changes})
    except ValueError as error:
        raise TrainingError(f"stage {stage.name or '?'} cannot be made that short or long: {error}") from error
