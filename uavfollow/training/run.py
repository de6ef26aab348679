"""A training run from options: folder, data, network, trainer, and what came out."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import nn

from tracker.training.budget import rescale
from tracker.training.checkpoint import has_checkpoint
from tracker.training.distributed import World, joined
from tracker.training.loop import Trainer
from tracker.training.pairs import HostBatches
from tracker.training.progress import Outcome
from tracker.training.recipe import Packed, Recipe
from tracker.training.resident import resident_batches
from tracker.training.sources.mix import Mix
from tracker.training.sources.packed import packed_recipe
from tracker.training.start import start_network
from tracker.training.teacher import Teacher
from tracker.training.types import Batches, Footage
from tracker.training.validate import mean_score
from uavfollow.errors import InputError
from uavfollow.interrupts import orderly_end
from uavfollow.tell import tell
from uavfollow.training.folder import run_folder
from uavfollow.training.lock import held
from uavfollow.training.material import open_sources, open_validation, tell_sources
from uavfollow.training.progress import TrainProgress
from uavfollow.training.stop import stop_on_signal

MOST_WORKERS = 8  # with a GPU: more processes than that read no faster from one disk


@dataclass(frozen=True, slots=True)
class RunOptions:
    """What the command line says of a run beside the recipe. None: to be chosen here.

    `minutes` or `pairs` rescale the recipe's stages; `packed` is a folder made by `train prepare`; `resident` keeps its
    crops in the device's memory.
    """

    data: Path = Path()
    out: Path | None = None
    resume: bool = False
    minutes: float | None = None
    pairs: int | None = None
    packed: Path | None = None
    workers: int | None = None
    threads: int | None = None
    device: str = "auto"
    resident: bool = False


@dataclass(frozen=True, slots=True)
class RunResult:
    """A run that ended. `leads`: this process is the one that tells of it."""

    folder: Path
    outcome: Outcome
    leads: bool

    def as_json(self) -> dict[str, Any]:
        """For --json."""
        outcome = self.outcome
        return {
            "folder": str(self.folder),
            "finished": outcome.finished,
            "pairs": outcome.pairs,
            "seconds": round(outcome.seconds, 1),
            "skipped_steps": outcome.skipped_steps,
            "unused_data": outcome.unused.lines(),
            "validations": [
                {"pairs": v.pairs, "sequences": {s.name: {"auc": s.auc, "p20": s.p20} for s in v.scores}, **_mean(v)}
                for v in outcome.validations
            ],
            "notes": list(outcome.notes),
            "files": [str(path) for path in outcome.files],
        }


def effective_recipe(recipe: Recipe, options: RunOptions) -> Recipe:
    """The recipe as it will be run: shortened or lengthened, from packed crops. Raises TrainingError."""
    recipe = rescale(recipe, options.minutes, options.pairs)
    return packed_recipe(recipe, options.packed) if options.packed else recipe


def run_training(recipe: Recipe, options: RunOptions) -> RunResult:
    """Train until the recipe is done or a signal asks to stop. Raises InputError, TrainingError, WeightsError."""
    device = choose_device(options.device)
    recipe = effective_recipe(recipe, options)
    _check_resident(recipe, options)
    with orderly_end(), joined(device.type == "cuda") as world:
        if device.type == "cuda":
            device = torch.device("cuda", world.local_rank)
        with _agreed_folder(world, recipe, options) as folder:
            parts = _parts(recipe, options, device)  # before the data, whose opening takes minutes
            data = (open_sources(recipe, options.data), open_validation(recipe, options.data))
            if world.leads:
                tell_sources(data[0])
                tell(f"{recipe.name} on {device} in {folder}{_from_where(folder, options)}")
            outcome = _train(folder, recipe, options, parts, data, device, world, options.resume)
            return RunResult(folder, outcome, world.leads)


def train_in(
    folder: Path,
    recipe: Recipe,
    options: RunOptions,
    mix: Mix,
    footage: list[Footage],
    device: torch.device,
    world: World,
    should_stop: Callable[[], bool] | None = None,
) -> Outcome:
    """A run in a folder, or the rest of the one that lies there, with what was opened for it.

    `should_stop` in place of signals. Raises InputError when another run is writing there.
    """
    _check_resident(recipe, options)
    with held(folder) if world.leads else nullcontext():
        parts = _parts(recipe, options, device)
        return _train(folder, recipe, options, parts, (mix, footage), device, world, True, should_stop)


def _train(
    folder: Path,
    recipe: Recipe,
    options: RunOptions,
    parts: tuple[nn.Module, Teacher | None],
    data: tuple[Mix, list[Footage]],
    device: torch.device,
    world: World,
    resume: bool,
    should_stop: Callable[[], bool] | None = None,
) -> Outcome:
    network, teacher = parts
    mix, footage = data
    batches_for, workers = _batches(recipe, options, mix, device, world)
    trainer = Trainer(
        recipe,
        network,
        batches_for,
        folder,
        device=device,
        world=world,
        footage=footage,
        workers=workers,
        teacher=teacher,
        resume=resume,
    )
    progress = TrainProgress(quiet=not world.leads)
    try:
        if should_stop is not None:
            return trainer.run(should_stop, time.monotonic, progress.show)
        with stop_on_signal() as stop:
            return trainer.run(stop, time.monotonic, progress.show)
    finally:
        progress.close()


def choose_device(name: str) -> torch.device:
    """`auto`: CUDA where there is one. Raises InputError for CUDA where there is none."""
    if name == "cuda" and not torch.cuda.is_available():
        raise InputError("--device cuda: PyTorch sees no CUDA device here; use --device cpu")
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    return torch.device(name)


def outcome_lines(result: RunResult) -> list[str]:
    """What a run has to say at its end."""
    outcome = result.outcome
    lines = [f"{result.folder}: {outcome.pairs} pairs in {outcome.seconds / 60:.1f} min"]
    if outcome.skipped_steps:
        lines.append(f"  {outcome.skipped_steps} steps were skipped: their loss or gradient was of no use")
    lines += [f"  not used: {line}" for line in outcome.unused.lines()]
    for validated in outcome.validations:
        mean = mean_score(validated.scores)
        if mean is not None:
            count = len(validated.scores)
            lines.append(
                f"  validation at {validated.pairs} pairs: AUC {mean.auc:.3f}, P20 {mean.p20:.3f} ({count} sequences)"
            )
    lines += [f"  note: {note}" for note in outcome.notes]
    return [*lines, *(f"  wrote {path}" for path in outcome.files)]


def _mean(validated: Any) -> dict[str, float | None]:
    mean = mean_score(validated.scores)
    return {"auc": mean.auc if mean else None, "p20": mean.p20 if mean else None}


@contextmanager
def _agreed_folder(world: World, recipe: Recipe, options: RunOptions) -> Iterator[Path]:
    """Process 0 chooses, for on other hosts the next free number may be another, and holds it inside."""
    with ExitStack() as stack:

        def choose() -> bytes:
            chosen = run_folder(recipe, options.out, options.resume)
            stack.enter_context(held(chosen))
            run_folder(recipe, chosen, options.resume)  # another run may have ended there before it was ours
            return os.fsencode(chosen)

        yield Path(os.fsdecode(world.led(choose) or b""))


def _from_where(folder: Path, options: RunOptions) -> str:
    if not options.resume:
        return ""
    return ", resumed" if has_checkpoint(folder) else ": it ended before its first checkpoint and begins anew at step 0"


def _parts(recipe: Recipe, options: RunOptions, device: torch.device) -> tuple[nn.Module, Teacher | None]:
    """The network to begin with and its teacher. Raises TrainingError when the recipe's weights cannot be had."""
    if options.threads is not None:
        torch.set_num_threads(options.threads)
    return start_network(recipe), Teacher(recipe.teacher, device) if recipe.teacher else None


def _check_resident(recipe: Recipe, options: RunOptions) -> None:
    if options.resident and not all(isinstance(spec, Packed) for spec in recipe.sources):
        raise InputError("--resident keeps packed crops on the device; give --packed DIR (made by train prepare)")


def _batches(
    recipe: Recipe, options: RunOptions, mix: Mix, device: torch.device, world: World
) -> tuple[Callable[[int], Batches], int]:
    """What makes the batches of a stage, and the processes that help it."""
    if not options.resident:
        return (lambda stage: HostBatches(mix, recipe, stage, world.rank, world.size)), _workers(options, device, world)
    return resident_batches(mix, recipe, device, world.rank, world.size), 0


def _workers(options: RunOptions, device: torch.device, world: World) -> int:
    """One beside the network on a CPU, which has work for every core; with a GPU what the cores give each process."""
    if options.workers is not None:
        return options.workers
    cores = os.cpu_count() or 1
    if device.type == "cpu":
        return 1 if cores > 1 else 0
    return max(1, min(MOST_WORKERS, cores // world.size - 1))
