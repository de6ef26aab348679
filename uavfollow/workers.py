"""Jobs one after the other in this process, or in processes beside it. One that breaks spoils no other.

A worker process has a pipe of its own: one that dies tells by that which job it had, and holds no lock that another
waits for. Signals do not reach workers (Ctrl-C of a terminal goes to the whole group): the parent tells them to stop,
ends those that do not, and waits until every one is gone.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from multiprocessing.resource_tracker import ensure_running
from multiprocessing.sharedctypes import RawArray
from typing import Any, Generic, Protocol, TypeVar

import cv2

from uavfollow.interrupts import ENDING

POLL_S = 0.2  # as often as a progress line on a terminal is shown
THREAD_LIMITS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
EXIT_ORPHANED = 1

_STOP = 0  # place of the wish to stop in the shared numbers; those after it count steps, one for each worker

J = TypeVar("J")
R = TypeVar("R")
J_contra = TypeVar("J_contra", contravariant=True)
R_contra = TypeVar("R_contra", contravariant=True)

Tick = Callable[[], bool]  # a job calls it at each of its steps; True: end at once, nobody wants the result any more
Work = Callable[[J, Tick], "R | None"]  # None when a tick has asked for the end. Raises JobError


class JobError(Exception):
    """A job that could not be done; one line that says where it broke. Carries over from a process to its parent."""


class Report(Protocol[J_contra, R_contra]):
    """Who wants to know. Told in the parent process only."""

    def done(self, job: J_contra, result: R_contra) -> None:
        """A job ended with a result."""

    def failed(self, job: J_contra, message: str) -> None:
        """A job broke."""

    def steps(self, count: int) -> None:
        """So many ticks since the last time; also none, now and then while all are busy."""


def run_here(jobs: Sequence[J], work: Work[J, R], report: Report[J, R]) -> None:
    """Do every job in this process, by one thread, and report it. What `report` raises, and a signal, ends it."""

    def tick() -> bool:
        report.steps(1)
        return False

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        for job in jobs:
            try:
                result = work(job, tick)
            except JobError as error:
                report.failed(job, str(error))
            else:
                assert result is not None  # nobody has asked for an end
                report.done(job, result)
    finally:
        cv2.setNumThreads(threads)


def run_beside(
    jobs: Sequence[J], work: Work[J, R], processes: int, report: Report[J, R], *, stop_s: float, died: str
) -> None:
    """Do every job in a worker process of one thread, in order as workers get free, and report it.

    `work` and the jobs go by pickle, `work` as a function of a module. A job whose process dies is tried once more
    when all others are through, alone, for those beside it may have had its memory; then it failed with `died`. When
    anything is raised (KeyboardInterrupt, or by `report`) unfinished jobs are dropped, and workers that are not gone
    after `stop_s` in all are killed. No process is left, however it ends.
    """
    for suspect in _run(deque(jobs), work, processes, report, stop_s):
        for guilty in _run(deque([suspect]), work, 1, report, stop_s):
            report.failed(guilty, died)


def _run(waiting: deque[J], work: Work[J, R], processes: int, report: Report[J, R], stop_s: float) -> list[J]:
    """Empty `waiting`; returns the jobs whose process died."""
    lost: list[J] = []
    with _team(work, processes, stop_s) as team:
        while waiting or team.busy:
            while waiting and len(team.busy) < processes:
                team.begin(waiting.popleft())
            ended = team.ended(POLL_S)
            report.steps(team.new_steps())
            for job, answer in ended:
                if answer is None:
                    lost.append(job)
                elif answer.message is not None:
                    report.failed(job, answer.message)
                else:
                    report.done(job, answer.result)
    return lost


@dataclass(frozen=True, slots=True)
class _Answer:
    """What a worker says of a job: its result, or why there is none."""

    result: Any
    message: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Worker:
    process: SpawnProcess
    pipe: Connection
    slot: int


class _Team(Generic[J, R]):
    """Worker processes, started when there is work for them."""

    def __init__(self, work: Work[J, R], size: int) -> None:
        self._work = work
        self._context = multiprocessing.get_context("spawn")  # a forked PyTorch may hang
        self._shared = RawArray("q", 1 + size)  # without a lock: a worker that is killed could not give it back
        self._slots = list(range(1, size + 1))
        self._workers: list[_Worker] = []  # all that may run
        self._idle: list[_Worker] = []
        self._seen = 0
        self.busy: dict[Connection, tuple[_Worker, J]] = {}

    def begin(self, job: J) -> None:
        """Give a job to a worker. There must be one that is not busy, or room for one."""
        worker = self._idle.pop() if self._idle else self._start()
        self.busy[worker.pipe] = (worker, job)
        with suppress(OSError):  # it died: its pipe says so again where the answers come
            worker.pipe.send(job)

    def ended(self, timeout_s: float) -> list[tuple[J, _Answer | None]]:
        """Jobs that ended with their answers, None when the process died. Waits for one no longer than that."""
        found = []
        for pipe in wait(list(self.busy), timeout_s):
            assert isinstance(pipe, Connection)
            worker, job = self.busy.pop(pipe)
            answer = _answer_in(pipe)
            if answer is None:
                self._drop(worker)
            else:
                self._idle.append(worker)
            found.append((job, answer))
        return found

    def new_steps(self) -> int:
        """Ticks of all workers since the last call."""
        count: int = sum(self._shared[_STOP + 1 :])
        new, self._seen = count - self._seen, count
        return new

    def end(self, stop_s: float) -> None:
        """Idle ones go at once; busy ones have so long, all together, to see that they are to stop."""
        self._shared[_STOP] = 1
        for worker in self._workers:
            worker.pipe.close()
        deadline_s = time.monotonic() + stop_s
        for worker in self._workers:
            worker.process.join(max(deadline_s - time.monotonic(), 0.0))
            if worker.process.is_alive():
                worker.process.kill()
                worker.process.join()

    def _start(self) -> _Worker:
        ours, theirs = self._context.Pipe()
        slot = self._slots.pop()
        process = self._context.Process(target=_serve, args=(theirs, self._shared, slot, self._work))
        ensure_running()  # by itself `start` would do that, and lift the block of the signals with it
        with _signals_held(), _one_thread():
            process.start()
            worker = _Worker(process, ours, slot)
            self._workers.append(worker)
        theirs.close()  # else its end would not end the pipe
        return worker

    def _drop(self, worker: _Worker) -> None:
        """One whose pipe ended: whatever is left of it goes too, and another may take its place."""
        worker.process.kill()
        worker.process.join()
        worker.pipe.close()
        self._workers.remove(worker)
        self._slots.append(worker.slot)


@contextmanager
def _team(work: Work[J, R], size: int, stop_s: float) -> Iterator[_Team[J, R]]:
    """A team of which nobody is left at the end."""
    team = _Team(work, size)
    try:
        yield team
    finally:
        team.end(stop_s)


def _answer_in(pipe: Connection) -> _Answer | None:
    try:
        answer: _Answer = pipe.recv()
    except (EOFError, OSError):
        return None
    return answer


@contextmanager
def _one_thread() -> Iterator[None]:
    """Processes that are started inside compute with one thread each."""
    before = {name: os.environ.get(name) for name in THREAD_LIMITS}
    os.environ.update(dict.fromkeys(THREAD_LIMITS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextmanager
def _signals_held() -> Iterator[None]:
    """A process started inside never gets the signals of a terminal, which reach the whole group: we stop it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(pipe: Connection, shared: Any, slot: int, work: Work[J, R]) -> None:
    """All that a worker process does: a job, its answer, the next one, until the pipe ends."""
    cv2.setNumThreads(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()

    def tick() -> bool:
        shared[slot] += 1
        return bool(shared[_STOP])

    with suppress(EOFError, OSError):  # the parent has no more jobs, or wants no more answers
        while not shared[_STOP]:
            pipe.send(_done(pipe.recv(), work, tick))


def _done(job: J, work: Work[J, R], tick: Tick) -> _Answer:
    try:
        return _Answer(work(job, tick))
    except JobError as error:
        return _Answer(None, str(error))
    except Exception as error:  # a mistake in `work`: told for this job, and the others go on
        return _Answer(None, " ".join(f"{type(error).__name__}: {error}".split()))


def _end_with_parent() -> None:
    """A parent that was killed cannot tell its workers to stop."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(EXIT_ORPHANED)
