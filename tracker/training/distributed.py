"""Several processes that train one network: who is who, what they decide together, and the gradient's average.

Every process sees its own rows of the same batch. Gradients and the counts of the losses are those of the whole batch;
BatchNorm alone normalises by the rows of its own process (as the official two-GPU training does), and the running
statistics that are kept are those of process 0.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import timedelta

import numpy as np
import torch
import torch.distributed as dist
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel

from tracker.training.errors import TrainingError

PATIENCE = timedelta(hours=12)  # the others wait while process 0 validates whole data sets
FINE, FAILED = b"fine", b"failed"
BACKENDS = ("gloo", "NCCL", "Connection", "process group")  # whose errors inside backward() tell of the others
NUMBERS = ("RANK", "WORLD_SIZE", "LOCAL_RANK")


@dataclass(frozen=True, slots=True)
class World:
    """This process among all of them. `size` 1 needs no group and never communicates."""

    rank: int = 0
    size: int = 1
    local_rank: int = 0

    @property
    def leads(self) -> bool:
        """Process 0 alone writes files, validates and reports."""
        return self.rank == 0

    def highest(self, values: Sequence[float]) -> list[float]:
        """The largest of every value over all processes: flags (0 or 1) and times agreed by all."""
        if self.size == 1:
            return [float(v) for v in values]
        # On the CPU, thus by gloo: a flag must not wait for the GPU's queue.
        agreed = torch.tensor(values, dtype=torch.float64)
        with _together():
            dist.all_reduce(agreed, op=dist.ReduceOp.MAX)
        return [float(v) for v in agreed]

    def mean(self, value: Tensor) -> Tensor:
        """Mean over all processes, without gradient.

        Given the count of a loss it makes local sum / mean count, whose average over the processes, which is what
        DistributedDataParallel takes of the gradients, is that of the whole batch.
        """
        if self.size == 1:
            return value
        total = value.detach().clone()
        with _together():
            dist.all_reduce(total)
        return total / self.size

    def wait(self) -> None:
        """Return when all processes are here."""
        self.highest([0.0])

    def share(self, data: bytes | None) -> bytes | None:
        """What process 0 gives, on every process; nothing needs a folder that all hosts see."""
        if self.size == 1:
            return data
        length = torch.tensor([-1 if data is None else len(data)], dtype=torch.int64)
        with _together():
            dist.broadcast(length, src=0)
        if int(length) < 0:
            return None
        if data is not None and self.leads:
            content = torch.from_numpy(np.frombuffer(data, np.uint8).copy())
        else:
            content = torch.empty(int(length), dtype=torch.uint8)
        with _together():
            dist.broadcast(content, src=0)
        return content.numpy().tobytes()

    def led(self, make: Callable[[], bytes | None]) -> bytes | None:
        """What `make` gives on process 0, where alone it is called, on every process.

        What it raises goes on there; the others raise a TrainingError without text, for it is told once.
        """
        if not self.leads:
            if self.share(None) != FINE:
                raise TrainingError("")
            return self.share(None)
        try:
            made = make()
        except Exception:
            self.share(FAILED)
            raise
        self.share(FINE)
        return self.share(made)

    def lost(self, error: Exception) -> bool:
        """Whether an error in the middle of a step says that another process is not there any more."""
        return self.size > 1 and any(word in str(error) for word in BACKENDS)

    def wrap(self, network: nn.Module) -> nn.Module:
        """The module whose backward pass averages the gradients over all processes; itself when it is alone."""
        if self.size == 1:
            return network
        device = next(network.parameters()).device
        with _together():
            return DistributedDataParallel(network, device_ids=[device.index] if device.type == "cuda" else None)


def others_ended(error: Exception) -> TrainingError:
    """What to say when the others are not there any more."""
    reason = (str(error).splitlines() or [type(error).__name__])[0]
    return TrainingError(f"another process of this run ended ({reason}); its message says why; go on with --resume")


@contextmanager
def _together() -> Iterator[None]:
    """Inside, all processes act as one."""
    try:
        yield
    except RuntimeError as error:
        raise others_ended(error) from error


@contextmanager
def joined(use_cuda: bool, init_method: str = "env://") -> Iterator[World]:
    """The world that torchrun's environment describes, or this process alone; the group ends with the block.

    Sets the CUDA device of this process. Raises TrainingError when the environment is incomplete.
    """
    world = world_of_environment()
    if world.size == 1:
        yield world
        return
    if use_cuda:
        torch.cuda.set_device(world.local_rank)
    backend = "cpu:gloo,cuda:nccl" if use_cuda else "gloo"
    try:
        dist.init_process_group(
            backend, init_method=init_method, rank=world.rank, world_size=world.size, timeout=PATIENCE
        )
    except (ValueError, RuntimeError) as error:
        raise TrainingError(
            f"the {world.size} processes did not find each other: {error}; start by torchrun"
        ) from error
    try:
        yield world
    finally:
        with suppress(RuntimeError):  # there is nobody to part from where the others ended before
            dist.destroy_process_group()


def world_of_environment() -> World:
    """From RANK, WORLD_SIZE and LOCAL_RANK as torchrun sets them; alone without them."""
    if "WORLD_SIZE" not in os.environ:
        return World()
    try:
        rank, size, local_rank = (int(os.environ[name]) for name in NUMBERS)
    except (KeyError, ValueError) as error:
        raise TrainingError(f"{', '.join(NUMBERS)} must be whole numbers as torchrun sets them: {error}") from error
    if not 0 <= rank < size or local_rank < 0:
        raise TrainingError(f"RANK {rank} does not fit WORLD_SIZE {size}: start by torchrun")
    return World(rank, size, local_rank)
