"""One step of learning: a batch goes through the network, and the weights move, or they do not and nothing changed."""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.modules.batchnorm import _BatchNorm

from tracker.engines.cpu import has_native_bf16
from tracker.siamapnpp.network import Maps
from tracker.training.average import Average
from tracker.training.checkpoint import LAST, State
from tracker.training.distributed import World, others_ended
from tracker.training.errors import TrainingError
from tracker.training.frozen import freeze
from tracker.training.losses import losses
from tracker.training.optimise import make_optimiser, set_rate
from tracker.training.recipe import Recipe
from tracker.training.targets import draws_for, labels
from tracker.training.teacher import Teacher
from tracker.training.types import Batch

TOTAL = "total"  # names of losses beside those that `losses` gives
TEACHER = "teacher"
NO_MEMORY = ("out of memory", "can't allocate memory")  # CUDA's words and the CPU allocator's


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """What a step did: the losses of the whole batch by name, or `skipped` with the weights as they were."""

    losses: dict[str, Tensor]
    skipped: bool


class Learner:
    """The network with all that its training carries along: optimiser, average, scaler, statistics to fall back on."""

    def __init__(
        self, recipe: Recipe, network: nn.Module, device: torch.device, world: World, teacher: Teacher | None = None
    ) -> None:
        self.network = network.to(device=device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.average = Average(self.network, recipe.ema)
        self._recipe = recipe
        self._device = device
        self._world = world
        self._teacher = teacher
        self._dtype = autocast_dtype(recipe.precision, device)
        self._scaler = torch.amp.GradScaler(device.type, enabled=self._dtype is torch.float16)
        self._stage_index = 0
        self._optimiser: torch.optim.Optimizer | None = None
        self._forward: nn.Module = self.network
        self._statistics = Statistics(self.network)

    def begin(self, stage_index: int, optimiser: State | None = None) -> None:
        """Make ready for a stage: what is frozen, a new optimiser, or the one of a checkpoint."""
        stage = self._recipe.stages[stage_index]
        freeze(self.network, stage.frozen_layers)
        self.network.train()
        self._stage_index = stage_index
        self._optimiser = make_optimiser(self.network, self._recipe.optimiser, stage.lr)
        if optimiser is not None:
            self._restore(self._optimiser, optimiser)
        self._forward = self._world.wrap(self.network)
        self._statistics = Statistics(self.network)

    def learn(self, batch: Batch, step: int, rate: float) -> Step:
        """Step number `step` of the stage with the rows of this process at learning rate `rate`.

        Raises TrainingError when memory runs out or another process ended.
        """
        if self._optimiser is None:
            raise RuntimeError("learn() before begin()")
        try:
            return self._learn(self._optimiser, batch, step, rate)
        except (RuntimeError, MemoryError) as error:
            if is_out_of_memory(error):
                raise self._too_large() from error
            if self._world.lost(error):
                raise others_ended(error) from error
            raise

    def _learn(self, optimiser: torch.optim.Optimizer, batch: Batch, step: int, rate: float) -> Step:
        set_rate(optimiser, rate)
        optimiser.zero_grad(set_to_none=True)
        total, parts = self._loss(batch, step)
        self._scaler.scale(total).backward()  # type: ignore[no-untyped-call]
        self._scaler.unscale_(optimiser)
        learned = [p for group in optimiser.param_groups for p in group["params"]]
        norm = nn.utils.clip_grad_norm_(learned, self._recipe.optimiser.clip)
        bad = not (_below(total, self._recipe.optimiser.max_loss) and math.isfinite(float(norm)))
        skipped = self._world.highest([float(bad)])[0] > 0
        if not skipped:
            self._scaler.step(optimiser)
        self._scaler.update()
        if skipped:
            self._statistics.restore()
        else:
            self._statistics.keep()
            self.average.update(self.network)
        return Step(self._of_all(parts), skipped)

    def _too_large(self) -> TrainingError:
        stage = self._recipe.stages[self._stage_index]
        return TrainingError(
            f"out of memory at stage {self._stage_index + 1} (batch {stage.batch}, search {stage.search_px} px): make "
            "the batch smaller; the last checkpoint is kept"
        )

    def _restore(self, optimiser: torch.optim.Optimizer, state: State) -> None:
        try:
            optimiser.load_state_dict(state)
        except (ValueError, KeyError, TypeError) as error:
            reason = str(error).splitlines()[0]
            raise TrainingError(
                f"{LAST}: its optimiser's state is of another recipe ({reason}); resume it with its own recipe"
            ) from error

    def optimiser_state(self) -> State | None:
        """For a checkpoint; None before the first stage."""
        return None if self._optimiser is None else self._optimiser.state_dict()

    def scaler_state(self) -> State:
        """For a checkpoint; empty without fp16."""
        return self._scaler.state_dict()

    def load(self, network: State, average: State, scaler: State | None) -> None:
        """Take over the states of a checkpoint."""
        self.network.load_state_dict(network)
        self.average.load_state_dict(average)
        if scaler:
            self._scaler.load_state_dict(scaler)

    def _loss(self, batch: Batch, step: int) -> tuple[Tensor, dict[str, Tensor]]:
        recipe, search_px = self._recipe, self._recipe.stages[self._stage_index].search_px
        exemplar, search = self._image(batch.exemplar), self._image(batch.search)
        box, negative = (v.to(self._device, non_blocking=True) for v in (batch.box, batch.negative))
        with self._autocast():
            maps = Maps(*self._forward(exemplar, search))
        maps = Maps(*(m.float() for m in maps))
        draws = self._draws(step, len(box), maps)
        targets = labels(maps, box, negative, search_px, recipe.labels, draws)
        reduce = self._world.mean if self._world.size > 1 else None
        total, parts = losses(maps, targets, recipe.loss, reduce)
        if self._teacher is not None:
            with self._autocast():
                term = self._teacher.term(exemplar, search, maps, reduce)
            total = total + term
            parts = {**parts, TEACHER: term.detach()}
        return total, {TOTAL: total.detach(), **parts}

    def _draws(self, step: int, rows: int, maps: Maps) -> Tensor:
        """The draws of this process's rows of the whole batch: they do not depend on who draws them."""
        mine = range(self._world.rank * rows, (self._world.rank + 1) * rows)
        return draws_for(self._recipe.seed, self._stage_index, step, mine, maps.cls1.shape[-1] ** 2, self._device)

    def _image(self, crops_u8: Tensor) -> Tensor:
        on_device = crops_u8.to(self._device, non_blocking=True)
        return on_device.float().contiguous(memory_format=torch.channels_last)

    def _autocast(self) -> AbstractContextManager[Any]:
        return nullcontext() if self._dtype is None else torch.autocast(self._device.type, dtype=self._dtype)

    def _of_all(self, parts: dict[str, Tensor]) -> dict[str, Tensor]:
        if self._world.size == 1:
            return parts
        values = self._world.mean(torch.stack([v.float() for v in parts.values()]))
        return dict(zip(parts, values, strict=True))


class Statistics:
    """The BatchNorm statistics after the last good step: a skipped batch has already entered those of the network."""

    def __init__(self, network: nn.Module) -> None:
        modules = [m for m in network.modules() if isinstance(m, _BatchNorm)]
        self._live = list(_buffers(modules))
        self._kept = [b.clone() for b in self._live]

    def keep(self) -> None:
        """Those of now are good."""
        _copy(self._live, self._kept)

    def restore(self) -> None:
        """Back to the last good ones."""
        _copy(self._kept, self._live)


def autocast_dtype(precision: str, device: torch.device) -> torch.dtype | None:
    """What multiplications run in; None is fp32. Raises TrainingError for fp16 without CUDA."""
    if precision == "auto":
        return torch.bfloat16 if device.type == "cuda" or has_native_bf16() else None
    if precision == "fp16" and device.type != "cuda":
        raise TrainingError("precision fp16 needs a CUDA device; use precision auto")
    return {"fp32": None, "bf16": torch.bfloat16, "fp16": torch.float16}[precision]


def is_out_of_memory(error: Exception) -> bool:
    """Whether an allocation failed, on whatever device."""
    return isinstance(error, MemoryError) or any(w in str(error) for w in NO_MEMORY)


def _buffers(modules: Iterable[nn.Module]) -> Iterable[Tensor]:
    return (b for module in modules for b in module.buffers(recurse=False))


@torch.no_grad()
def _copy(source: list[Tensor], target: list[Tensor]) -> None:
    for a, b in zip(source, target, strict=True):
        b.copy_(a)


def _below(total: Tensor, limit: float) -> bool:
    value = float(total.detach())
    return math.isfinite(value) and value <= limit
