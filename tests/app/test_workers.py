"""Processes beside this one: what they answer, one that breaks or dies, an interruption, and that none is left."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable
from pathlib import Path

import cv2
import pytest

from uavfollow.interrupts import ENDING, orderly_end
from uavfollow.workers import JobError, Tick, run_beside, run_here

FOR_EVER_S = 60.0  # only a worker that ends by itself ends sooner
Job = tuple[str, str]  # what to do, and a file to write its own number to


class Notes:
    """A report that keeps everything; `full`: a job after whose result the disk is full."""

    def __init__(self, full: Job | None = None) -> None:
        self.results: dict[str, object] = {}
        self.failures: dict[str, str] = {}
        self.count = 0
        self._full = full

    def done(self, job: Job, result: object) -> None:
        self.results[job[0]] = result
        if job == self._full:
            raise OSError("no space")

    def failed(self, job: Job, message: str) -> None:
        self.failures[job[0]] = message

    def steps(self, count: int) -> None:
        self.count += count


def work(job: Job, tick: Tick) -> object | None:
    """One kind of job for each thing that can happen."""
    made = KINDS[job[0].split()[0]](job, tick)
    return None if tick() else made


def _about(job: Job, tick: Tick) -> object:
    """A worker has one thread and hears no signal of the terminal."""
    masked = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    return os.environ["OMP_NUM_THREADS"], cv2.getNumThreads(), set(ENDING) <= masked


def _breaks(job: Job, tick: Tick) -> object:
    raise JobError("at the third image")


def _errs(job: Job, tick: Tick) -> object:
    raise KeyError("a\nb")


def _dies(job: Job, tick: Tick) -> object:
    with Path(job[1]).open("a") as file:
        file.write("x")
    os.kill(os.getpid(), signal.SIGKILL)
    return None


def _dies_once(job: Job, tick: Tick) -> object:
    return "second try" if Path(job[1]).exists() else _dies(job, tick)


def _listens(job: Job, tick: Tick) -> object:
    _number(job)
    while not tick():
        pass
    return None


def _interrupts(job: Job, tick: Tick) -> object:
    _number(job)
    os.kill(os.getppid(), signal.SIGINT)
    return _listens(job, tick)


def _interrupts_deaf(job: Job, tick: Tick) -> object:
    _number(job)
    os.kill(os.getppid(), signal.SIGINT)
    threading.Event().wait()
    return None


def _number(job: Job) -> None:
    Path(job[1]).write_text(str(os.getpid()))


KINDS: dict[str, Callable[[Job, Tick], object]] = {
    "about": _about, "breaks": _breaks, "errs": _errs, "dies": _dies, "dies-once": _dies_once, "listens": _listens,
    "interrupts": _interrupts, "deaf": _interrupts_deaf, "plain": lambda job, tick: job[0][::-1],
}  # fmt: skip


def _beside(jobs: list[Job], notes: Notes, processes: int = 2, stop_s: float = FOR_EVER_S) -> None:
    run_beside(jobs, work, processes, notes, stop_s=stop_s, died="it died, alone as well")


def _is_gone(path: Path) -> bool:
    """Also waited for: a zombie has its number yet."""
    try:
        os.kill(int(path.read_text()), 0)
    except ProcessLookupError:
        return True
    return False


def test_one_that_breaks_or_dies_spoils_no_other(tmp_path: Path) -> None:
    threads = os.environ.get("OMP_NUM_THREADS")
    notes = Notes()
    dying, shy = str(tmp_path / "dying"), str(tmp_path / "shy")
    names = (("plain 1", ""), ("dies", dying), ("breaks", ""), ("about", ""), ("dies-once", shy), ("errs", ""))
    _beside([*names, ("plain 2", "")], notes)
    assert notes.failures == {
        "breaks": "at the third image", "errs": "KeyError: 'a\\nb'", "dies": "it died, alone as well",
    }  # fmt: skip
    assert notes.results == {
        "plain 1": "1 nialp", "plain 2": "2 nialp", "about": ("1", 1, True), "dies-once": "second try",
    }  # fmt: skip
    assert list(notes.results)[-1] == "dies-once", "alone, when the others are through"
    assert Path(dying).read_text() == "xx", "tried twice, not more often"
    assert notes.count == 4, "one tick of each that came to its end"
    assert os.environ.get("OMP_NUM_THREADS") == threads
    assert multiprocessing.active_children() == []


def test_an_interruption_ends_those_that_listen_by_themselves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    killed: list[object] = []
    monkeypatch.setattr(multiprocessing.context.SpawnProcess, "kill", killed.append)
    notes = Notes()
    with pytest.raises(KeyboardInterrupt), orderly_end():
        _beside([("interrupts", str(tmp_path / "one")), ("plain", "")], notes, processes=1)
    assert _is_gone(tmp_path / "one")
    assert (notes.results, notes.failures, killed) == ({}, {}, [])


def test_an_interruption_kills_those_that_do_not_listen_and_waits_for_them(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), orderly_end():
        _beside([("deaf", str(tmp_path / "one"))], Notes(), stop_s=0.05)
    assert _is_gone(tmp_path / "one")


def test_what_the_report_raises_ends_the_workers(tmp_path: Path) -> None:
    notes = Notes(full=("plain", ""))
    with pytest.raises(OSError, match="no space"):
        _beside([("listens", str(tmp_path / "one")), ("plain", ""), ("plain 2", "")], notes)
    assert list(notes.results) == ["plain"]
    assert not (tmp_path / "one").exists() or _is_gone(tmp_path / "one")
    assert multiprocessing.active_children() == []


def test_nothing_to_do_starts_no_process() -> None:
    notes = Notes()
    _beside([], notes)
    assert (notes.results, notes.failures, notes.count) == ({}, {}, 0)


def test_in_this_process() -> None:
    threads = cv2.getNumThreads()
    try:
        cv2.setNumThreads(3)
        notes = Notes()
        run_here([("plain 1", ""), ("breaks", ""), ("plain 2", "")], work, notes)
        assert notes.results == {"plain 1": "1 nialp", "plain 2": "2 nialp"}
        assert notes.failures == {"breaks": "at the third image"}
        assert notes.count == 2
        assert cv2.getNumThreads() == 3
        with pytest.raises(OSError, match="no space"):
            run_here([("plain 1", ""), ("plain 2", "")], work, Notes(full=("plain 1", "")))
        assert cv2.getNumThreads() == 3
    finally:
        cv2.setNumThreads(threads)


def test_an_error_goes_between_processes() -> None:
    assert str(pickle.loads(pickle.dumps(JobError("why")))) == "why"
