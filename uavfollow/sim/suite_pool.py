"""Runs of the suite in processes beside this one, one thread each. One that breaks spoils no other."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.sharedctypes import RawValue
from typing import Any

import cv2

from uavfollow.interrupts import ENDING
from uavfollow.sim.suite_job import Flown, SuiteError, SuiteJob, fly

POLL_S = 0.2  # as often as a progress line on a terminal is shown
STOP_S = 15.0  # a worker looks at each picture whether it is to stop; building a world takes a few seconds
THREAD_LIMITS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
DIED = "the process that flew it died (killed, or out of memory), alone as well; close other programs"
EXIT_ORPHANED = 1
# A job with its result, or with the line that says why there is none; None, None now and then while all are busy.
Tell = Callable[[SuiteJob | None, Flown | str | None], None]

_stop: Any = None  # in a worker: 1 when the parent wants an end


def run_jobs(jobs: Sequence[SuiteJob], processes: int, tell: Tell) -> None:
    """Run every job and tell of each. KeyboardInterrupt drops the unfinished ones and ends the processes.

    Always in other processes: the end of a run makes its process deaf to signals.
    """
    waiting = deque(jobs)
    while waiting:
        for suspect in _run(waiting, processes, tell):  # one of them took its process with it
            for guilty in _run(deque([suspect]), 1, tell):
                tell(guilty, DIED)


def _run(waiting: deque[SuiteJob], processes: int, tell: Tell) -> list[SuiteJob]:
    """Empty `waiting` with a pool. When it breaks: the jobs that were flying, one of which is to blame."""
    flying: dict[Future[Flown | None], SuiteJob] = {}
    with _pool(processes) as pool:
        while waiting or flying:
            try:
                while waiting and len(flying) < processes:
                    with _signals_held():
                        flying[pool.submit(_work, waiting[0])] = waiting[0]
                    waiting.popleft()
            except BrokenProcessPool:
                pass  # the jobs that fly say the same
            ended, _ = wait(flying, timeout=POLL_S, return_when=FIRST_COMPLETED)
            tell(None, None)
            suspects = [job for future in ended if not _told(future, job := flying.pop(future), tell)]
            if suspects:
                return [*suspects, *flying.values()]
    return []


def _told(future: Future[Flown | None], job: SuiteJob, tell: Tell) -> bool:
    """Tell what became of a job; False when its pool broke."""
    try:
        tell(job, future.result())
    except BrokenProcessPool:
        return False
    except SuiteError as error:
        tell(job, str(error))
    return True


@contextmanager
def _pool(processes: int) -> Iterator[ProcessPoolExecutor]:
    """Workers with one thread each; none is left at the end."""
    context = multiprocessing.get_context("spawn")  # a forked PyTorch may hang
    stop = RawValue("b", 0)  # without a lock: a worker that is killed could not give it back
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(processes, context, _begin, (stop,))
    try:
        with _one_thread():
            yield pool
    except BaseException:
        stop.value = 1
        pool.shutdown(wait=False, cancel_futures=True)
        for process in set(multiprocessing.active_children()) - before:
            process.join(STOP_S)
            if process.is_alive():
                process.kill()
                process.join()
        raise
    finally:
        pool.shutdown(wait=True)


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


def _begin(stop: Any) -> None:
    """First of all in a worker."""
    global _stop
    _stop = stop
    cv2.setNumThreads(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A parent that was killed cannot tell its workers to stop."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(EXIT_ORPHANED)


def _work(job: SuiteJob) -> Flown | None:
    """In a worker."""
    return fly(job, lambda: not _stop.value)
