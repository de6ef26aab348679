"""The paper's component study with the trainer of the command line."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from torch import nn

from tracker.training.ablation import TrainedVariant, run_ablation
from tracker.training.ablation_results import Ablation
from tracker.training.average import Average
from tracker.training.checkpoint import LAST, read_checkpoint, read_recipe
from tracker.training.distributed import World
from tracker.training.recipe import Recipe, Variant
from tracker.training.start import start_network
from uavfollow.errors import InputError
from uavfollow.training.folder import difference
from uavfollow.training.material import open_sources, open_validation, tell_sources
from uavfollow.training.run import RunOptions, choose_device, effective_recipe, train_in
from uavfollow.training.stop import stop_on_signal


def ablate(
    recipe: Recipe, pairs: int, folder: Path, options: RunOptions, variants: Sequence[Variant] = tuple(Variant)
) -> Ablation | None:
    """Train and compare the variants for `pairs` pairs each; None when a signal stopped it (it can be run again).

    Raises InputError, TrainingError, WeightsError.
    """
    if os.environ.get("WORLD_SIZE", "1") != "1":
        raise InputError("bench ablation trains in one process: start it without torchrun")
    _check_place(folder)
    device = choose_device(options.device)
    recipe = effective_recipe(recipe, options)
    mix, footage = open_sources(recipe, options.data), open_validation(recipe, options.data)
    tell_sources(mix)
    with stop_on_signal() as stop:

        def train(variant: Recipe, own: Path) -> TrainedVariant | None:
            own.mkdir(parents=True, exist_ok=True)
            then = read_recipe(own)
            if then is not None and (changed := difference(then, variant)) is not None:
                raise InputError(f"--out {own}: its run has another recipe: {changed}; choose another folder")
            # Judged at the end by the study itself: a validation inside would cost as much again.
            outcome = train_in(own, variant, options, mix, [], device, World(), stop)
            if not outcome.finished:
                return None
            speed = outcome.pairs / outcome.seconds if outcome.seconds > 0 else None
            return TrainedVariant(_averaged(variant, own).to(device).eval(), outcome.pairs, speed)

        return run_ablation(recipe, pairs, variants, train, footage, folder, should_stop=stop, report=_say())


def _check_place(folder: Path) -> None:
    """Before hours of work: can the results be written there? Raises InputError."""
    nearest = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    try:
        if not nearest.is_dir():
            raise NotADirectoryError(f"{nearest} is a file")
        with tempfile.TemporaryFile(dir=nearest):
            pass
    except OSError as error:
        raise InputError(
            f"--out {folder}: cannot be written ({error.strerror or error}); choose another folder"
        ) from error


def _averaged(recipe: Recipe, folder: Path) -> nn.Module:
    """The network that a run made: the average of its weights, in full precision."""
    network = start_network(recipe)
    average = Average(network, recipe.ema)
    average.load_state_dict(read_checkpoint(folder / LAST).average)
    network.load_state_dict(average.tensors())
    return network


def _say() -> Callable[[str], None]:
    return lambda line: print(line, file=sys.stderr, flush=True)
