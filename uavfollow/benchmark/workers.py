"""Jobs one after the other in this process, or in processes beside it. One that breaks spoils no other."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.sharedctypes import RawArray
from typing import Any, Protocol

import cv2

from uavfollow.benchmark.job import Job, JobError, Track, run_job
from uavfollow.interrupts import ENDING

POLL_S = 0.2  # as often as a progress line on a terminal is shown
STOP_S = 3.0  # for all together: a worker looks before every image whether it is to stop, and has nothing to save
THREAD_LIMITS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
DIED = "the process that tracked it died (killed, or out of memory), alone as well; try a smaller --max-frames"
EXIT_ORPHANED = 1

_STOP = 0  # place of the wish to stop in the shared numbers; those after it count images, one for each worker
_shared: Any = None  # in a worker: the numbers that it shares with its parent


class Report(Protocol):
    """Who wants to know. Told in the parent process only."""

    def done(self, job: Job, track: Track) -> None:
        """A job ended with a result."""

    def failed(self, job: Job, message: str) -> None:
        """A job broke."""

    def images(self, count: int) -> None:
        """So many images since the last time."""


def run_jobs(jobs: Sequence[Job], processes: int, report: Report) -> None:
    """Run every job and report it. With one process in this very one. KeyboardInterrupt drops what is unfinished."""
    if processes == 1:
        _run_here(jobs, report)
        return
    # The longest first: at the end nobody waits for one that was begun last.
    waiting = deque(sorted(jobs, key=lambda job: -len(job.sequence.images)))
    while waiting:
        for suspect in _run_beside(waiting, processes, report):  # one of them took its process with it
            for guilty in _run_beside(deque([suspect]), 1, report):
                report.failed(guilty, DIED)


def _run_here(jobs: Sequence[Job], report: Report) -> None:
    def tick() -> bool:
        report.images(1)
        return False

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        for job in jobs:
            try:
                track = run_job(job, tick)
            except JobError as error:
                report.failed(job, str(error))
            else:
                assert track is not None
                report.done(job, track)
    finally:
        cv2.setNumThreads(threads)


def _run_beside(waiting: deque[Job], processes: int, report: Report) -> list[Job]:
    """Empty `waiting` with a pool of its own. When it breaks: the jobs that were running, one of which is to blame."""
    flying: dict[Future[Track | None], tuple[Job, int]] = {}
    slots = list(range(1, processes + 1))
    seen = 0
    with _pool(processes) as (pool, shared):
        while waiting or flying:
            try:
                while waiting and slots:  # never more than run: of a broken pool the others need no second try
                    with _signals_held():
                        future = pool.submit(_work, waiting[0], slots[-1])
                    flying[future] = (waiting.popleft(), slots.pop())
            except BrokenProcessPool:
                pass  # the jobs that fly say the same
            ended, _ = wait(flying, timeout=POLL_S, return_when=FIRST_COMPLETED)
            count = sum(shared[_STOP + 1 :])
            report.images(count - seen)
            seen = count
            suspects = []
            for future in ended:
                job, slot = flying.pop(future)
                slots.append(slot)
                if not _tell(future, job, report):
                    suspects.append(job)
            if suspects:
                return [*suspects, *(job for job, _ in flying.values())]
    return []


def _tell(future: Future[Track | None], job: Job, report: Report) -> bool:
    """Report what became of a job; False when its pool broke."""
    try:
        track = future.result()
    except BrokenProcessPool:
        return False
    except JobError as error:
        report.failed(job, str(error))
    else:
        assert track is not None  # nobody has asked for an end
        report.done(job, track)
    return True


@contextmanager
def _pool(processes: int) -> Iterator[tuple[ProcessPoolExecutor, Any]]:
    """Workers with one thread each; none is left at the end."""
    context = multiprocessing.get_context("spawn")  # a forked PyTorch may hang
    shared = RawArray("q", 1 + processes)  # without a lock: a worker that is killed could not give it back
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(processes, context, _begin, (shared,))
    try:
        with _one_thread():
            yield pool, shared
    except BaseException:
        shared[_STOP] = 1
        pool.shutdown(wait=False, cancel_futures=True)
        _end(set(multiprocessing.active_children()) - before)
        raise
    finally:
        pool.shutdown(wait=True)


def _end(processes: set[Any]) -> None:
    """Give each the time to stop by itself, then end it."""
    for process in processes:
        process.join(STOP_S / len(processes))
        if process.is_alive():
            process.kill()


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


def _begin(shared: Any) -> None:
    """First of all in a worker."""
    global _shared
    _shared = shared
    cv2.setNumThreads(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A parent that was killed cannot tell its workers to stop."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(EXIT_ORPHANED)


def _work(job: Job, slot: int) -> Track | None:
    """In a worker."""

    def tick() -> bool:
        _shared[slot] += 1
        return bool(_shared[_STOP])

    return run_job(job, tick)
