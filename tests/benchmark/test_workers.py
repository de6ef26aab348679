"""Processes beside this one: the same results, one that dies, an interruption."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing.context import SpawnProcess
from pathlib import Path

import pytest

from tests.benchmark import fakes
from tests.benchmark.fakes import FRAMES, mark, write_sequence
from tracker.benchmark.readers import find_sequences
from uavfollow.benchmark import workers
from uavfollow.benchmark.job import Job, JobError, Row, Track, run_job
from uavfollow.benchmark.workers import DIED, run_jobs
from uavfollow.interrupts import orderly_end
from uavfollow.trackers import TrackerSpec

ENDLESS = 1_000_000  # images: minutes, were the worker not told to stop


class Notes:
    """A report that keeps everything."""

    def __init__(self) -> None:
        self.tracks: dict[str, tuple[Row, ...]] = {}
        self.failures: dict[str, str] = {}
        self.count = 0

    def done(self, job: Job, track: Track) -> None:
        self.tracks[job.name] = track.rows

    def failed(self, job: Job, message: str) -> None:
        self.failures[job.name] = message

    def images(self, count: int) -> None:
        self.count += count


def _job(folder: Path, kind: str) -> Job:
    sequence = find_sequences((folder,))[0][0]
    return Job(TrackerSpec(kind, "", True), sequence, f"{kind} {folder.name}", "key", "auto", "cpu", fakes.build)


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    return write_sequence(tmp_path / "plain"), mark(write_sequence(tmp_path / "marked", frames=FRAMES + 1))


def test_beside_as_here_and_one_that_dies_spoils_nothing(folders: tuple[Path, Path]) -> None:
    plain, marked = folders
    bright = _job(plain, "bright")
    beside, here = Notes(), Notes()
    run_jobs([bright, _job(marked, "dies")], 2, beside)
    run_jobs([bright], 1, here)
    assert beside.failures == {"dies marked": DIED}
    assert beside.tracks == here.tracks
    assert here.tracks.keys() == {"bright plain"}
    assert here.count == FRAMES
    assert beside.count >= FRAMES
    assert multiprocessing.active_children() == []


def test_an_error_comes_back_from_a_worker_as_it_was(folders: tuple[Path, Path]) -> None:
    notes = Notes()
    run_jobs([_job(folders[1], "raises")], 1, notes)
    (told,) = notes.failures.values()
    assert "RuntimeError: no more of this" in told
    assert str(pickle.loads(pickle.dumps(JobError(told)))) == told


class Breaks:
    """A pool without processes: it breaks with `dies`, while a job before it is still running."""

    def __init__(self) -> None:
        self.broken = False

    def submit(self, work: object, job: Job, slot: int) -> Future[Track | None]:
        future: Future[Track | None] = Future()
        if self.broken:
            raise BrokenProcessPool
        if job.spec.name == "dies":
            self.broken = True
            future.set_exception(BrokenProcessPool())
        elif job.name != "bright marked":  # that one never ends by itself
            try:
                future.set_result(run_job(job, lambda: False))
            except JobError as error:
                future.set_exception(error)
        return future


def test_of_a_broken_pool_every_running_job_is_tried_alone(
    folders: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    plain, marked = folders
    pools: list[tuple[int, Breaks]] = []

    @contextmanager
    def pool(processes: int) -> Iterator[tuple[Breaks, list[int]]]:
        pools.append((processes, Breaks()))
        yield pools[-1][1], [0] * (processes + 1)

    monkeypatch.setattr(workers, "_pool", pool)
    tried: list[str] = []
    inside = workers._run_beside

    def watched(waiting: deque[Job], processes: int, report: Notes) -> list[Job]:
        if processes == 1:
            tried.append(waiting[0].name)
            if waiting[0].name == "bright marked":
                report.done(waiting.popleft(), Track((), 0.0, 0, ""))
                return []
        return inside(waiting, processes, report)

    monkeypatch.setattr(workers, "_run_beside", watched)
    notes = Notes()
    jobs = [_job(marked, "bright"), _job(marked, "dies"), _job(plain, "bright"), _job(marked, "raises")]
    run_jobs(jobs, 2, notes)
    assert sorted(tried) == ["bright marked", "dies marked"]
    assert "RuntimeError: no more of this" in notes.failures.pop("raises marked")
    assert notes.failures == {"dies marked": DIED}
    assert notes.tracks.keys() == {"bright marked", "bright plain"}
    assert [processes for processes, _ in pools] == [2, 1, 2]


def test_an_interruption_stops_a_worker_in_the_middle(
    folders: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    job = _job(folders[1], "interrupts")
    images = (*job.sequence.images[:5], *(job.sequence.images[5],) * ENDLESS)
    endless = replace(job, sequence=replace(job.sequence, images=images))
    killed = []

    def kill(process: SpawnProcess) -> None:
        assert process.pid is not None
        killed.append(process.pid)
        os.kill(process.pid, signal.SIGKILL)

    monkeypatch.setattr(workers, "STOP_S", 30.0)  # as good as for ever: only the worker itself can end it sooner
    monkeypatch.setattr(SpawnProcess, "kill", kill)
    notes = Notes()
    with pytest.raises(KeyboardInterrupt), orderly_end():
        run_jobs([endless], 2, notes)
    assert not killed
    assert notes.tracks == notes.failures == {}
    assert multiprocessing.active_children() == []
