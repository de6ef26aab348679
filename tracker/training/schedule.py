"""The learning rate over a stage."""

from __future__ import annotations

import math

from tracker.training.recipe import Curve, Stage


def rate_at(stage: Stage, progress: float, pairs_done: int) -> float:
    """Learning rate of the step that follows `pairs_done` pairs of this stage.

    `progress`: the part of the stage that is over, 0 to 1 (by pairs or by time, the caller knows); values beyond are
    cut. The curve runs over the whole stage; a linear warm-up from `warmup_from` to 1 is a factor on it. The step's own
    batch counts as done in the warm-up: a first step at rate 0 would be a step for nothing.
    """
    progress = min(max(progress, 0.0), 1.0)
    return _curve(stage, progress) * _warmth(stage, pairs_done)


def _warmth(stage: Stage, pairs_done: int) -> float:
    if stage.warmup_pairs == 0:
        return 1.0
    done = min((pairs_done + stage.batch) / stage.warmup_pairs, 1.0)
    return stage.warmup_from + (1.0 - stage.warmup_from) * done


def _curve(stage: Stage, progress: float) -> float:
    if stage.curve is Curve.COSINE:
        return stage.lr_end + (stage.lr - stage.lr_end) * 0.5 * (1.0 + math.cos(math.pi * progress))
    if stage.curve is Curve.LOG and stage.lr > 0:
        return float(stage.lr * (stage.lr_end / stage.lr) ** progress)
    return stage.lr
