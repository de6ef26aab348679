"""Work that other processes do ahead of time and that arrives in order: batches of a training, crops of a pack."""

from __future__ import annotations

import itertools
import multiprocessing.util
import os
import signal
from collections.abc import Callable, Iterator
from ctypes import c_bool
from dataclasses import dataclass
from functools import partial
from multiprocessing.sharedctypes import RawValue
from typing import Any, Generic, TypeVar

import cv2
import torch
from torch.utils.data import DataLoader, Dataset, Sampler

from tracker.training.errors import TrainingError
from tracker.training.types import Batch, Batches

AHEAD_PER_WORKER = 2  # items made ahead by each worker
DIED = "DataLoader worker"  # how torch begins the message about a process that is gone

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class _Failure:
    """An error of a worker by its own words; as an exception it would arrive with the worker's whole stack in it."""

    message: str


class _Numbers(Sampler[int]):
    def __init__(self, first: int, count: int | None) -> None:
        self._first, self._count = first, count

    def __iter__(self) -> Iterator[int]:
        if self._count is None:
            return itertools.count(self._first)
        return iter(range(self._first, self._first + self._count))


class _Work(Dataset[Any], Generic[T]):
    def __init__(self, work: Callable[[int], T]) -> None:
        self._work = work

    def __getitem__(self, number: int) -> T | _Failure:
        try:
            return self._work(number)
        except TrainingError as error:
            return _Failure(str(error))


class _Parts:
    """A batch as a plain tuple, whose tensors the loader can pin."""

    def __init__(self, batches: Batches) -> None:
        self._batches = batches

    def __call__(self, step: int) -> tuple[Any, ...]:
        batch = self._batches.batch(step)
        return batch.exemplar, batch.search, batch.box, batch.negative, batch.skipped


def load(batches: Batches, first_step: int, steps: int | None, workers: int) -> Iterator[Batch]:
    """Batches number `first_step` and following, in order; without end when `steps` is None.

    `workers` processes make them ahead (0: this process makes each when it is asked for). Their tensors are pinned
    where there is a CUDA device. Raises TrainingError, also for one that a worker met and for a worker that died.
    """
    if workers == 0:
        for step in _Numbers(first_step, steps):
            yield batches.batch(step)
        return
    for parts in in_order(_Parts(batches), first_step, steps, workers, pin=torch.cuda.is_available()):
        yield Batch(*parts)


def in_order(work: Callable[[int], T], first: int, count: int | None, workers: int, pin: bool = False) -> Iterator[T]:
    """`work(first)`, `work(first + 1)`, ... made by `workers` processes; `work` must be picklable.

    Closing the iterator ends the workers. Raises TrainingError as `load` does.
    """
    if workers == 0:
        yield from map(work, _Numbers(first, count))
        return
    closing = RawValue(c_bool, False)
    loader: DataLoader[Any] = DataLoader(
        _Work(work),
        sampler=_Numbers(first, count),
        batch_size=None,
        collate_fn=_as_it_is,
        num_workers=workers,
        prefetch_factor=AHEAD_PER_WORKER,
        worker_init_fn=partial(_start_worker, closing),
        pin_memory=pin,
        generator=torch.Generator(),  # its own, so that the loader takes nothing from the global one
    )
    # At exit Python terminates what still runs, and waits: for ever, if the workers stayed deaf to it.
    multiprocessing.util.Finalize(loader, partial(setattr, closing, "value", True), exitpriority=0)
    try:
        for item in loader:
            if isinstance(item, _Failure):
                raise TrainingError(item.message)
            yield item
    except RuntimeError as error:
        if not str(error).startswith(DIED):
            raise
        reason = str(error).splitlines()[0]
        raise TrainingError(f"{reason}; out of memory? try fewer than {workers} workers") from error


def _as_it_is(item: T) -> T:
    return item


def _start_worker(closing: Any, number: int) -> None:
    """One thread each, and deaf to the signals that a terminal sends to the whole group: the parent decides when to
    stop, and may still need the next batch while it saves. SIGTERM ends a worker once the parent is `closing`."""

    def on_terminate(signum: int, frame: object) -> None:
        if closing.value:
            os._exit(0)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, on_terminate)
    cv2.setNumThreads(0)
    torch.set_num_threads(1)
