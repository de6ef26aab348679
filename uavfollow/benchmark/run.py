"""A benchmark from options: find, plan, track what is missing, score, write."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path

from tracker.benchmark.readers import find_sequences
from tracker.benchmark.sequence import Problem
from tracker.engines.cpu import describe_cpu
from uavfollow.benchmark.files import write_report
from uavfollow.benchmark.job import Job, Track, run_job
from uavfollow.benchmark.options import BenchOptions
from uavfollow.benchmark.plan import Plan, make_plan
from uavfollow.benchmark.report import Failure, Report
from uavfollow.benchmark.scoring import SequenceScore, score_sequence
from uavfollow.benchmark.store import Result, Store, opened
from uavfollow.errors import InputError
from uavfollow.progress import ProgressLine
from uavfollow.tell import tell
from uavfollow.workers import run_beside, run_here

STOP_S = 3.0  # a worker looks before every image whether it is to stop, and has nothing to save
DIED = "the process that tracked it died (killed, or out of memory), alone as well; try a smaller --max-frames"


@dataclass(frozen=True, slots=True)
class BenchResult:
    """A benchmark that ran to its end, and the files that tell of it."""

    report: Report
    files: tuple[Path, ...]


def run_bench(options: BenchOptions) -> BenchResult:
    """Run what is not there yet, and write tables and plots over all of it.

    Raises InputError: no sequence, a tracker or a folder that cannot be used, a file that cannot be written. After it,
    and after KeyboardInterrupt at any time, every finished sequence is kept; the same options go on from there.
    """
    sequences, problems = find_sequences(options.paths)
    if not sequences:
        raise InputError(_nothing(options, problems))
    plan, unnamed = make_plan(options, sequences)
    failures = [Failure(problem.where, problem.message) for problem in [*problems, *unnamed]]
    for failure in failures:
        tell(f"left out: {failure}")
    with opened(options.out) as store:
        missing = [job for job in plan.jobs if store.read(job) is None]
        store.check_replaces(missing)
        watcher = Watcher(store, missing)
        try:
            _track(missing, options.jobs, watcher)
            report = _report(options, plan, store, [*failures, *watcher.failures], len(plan.jobs) - len(missing))
            if not report.scores:
                raise InputError(f"no sequence could be tracked; the first: {report.failures[0]}")
            files = write_report(report, options.out, watcher.plotting)
        finally:
            watcher.close()
    return BenchResult(report, tuple(files))


def _track(jobs: list[Job], processes: int, watcher: Watcher) -> None:
    processes = min(processes, len(jobs))
    if processes <= 1:
        run_here(jobs, run_job, watcher)
        return
    # The longest first: at the end nobody waits for one that was begun last.
    longest_first = sorted(jobs, key=lambda job: -len(job.sequence.images))
    run_beside(longest_first, run_job, processes, watcher, stop_s=STOP_S, died=DIED)


class Watcher:
    """Keeps every result as it comes, collects failures, and shows how far it is."""

    def __init__(self, store: Store, jobs: list[Job]) -> None:
        self._store = store
        self._line = ProgressLine()
        self._jobs = len(jobs)
        self._total = sum(len(job.sequence.images) for job in jobs)
        self._images = self._ended = 0
        self.failures: list[Failure] = []

    def done(self, job: Job, track: Track) -> None:
        """Keep a result."""
        self._ended += 1
        self._store.write(job, track)

    def failed(self, job: Job, message: str) -> None:
        """Say at once what broke."""
        self._ended += 1
        self.failures.append(Failure(f"{job.name} with {job.spec.label}", message))
        self._line.close()
        tell(f"failed: {self.failures[-1]}")

    def steps(self, count: int) -> None:
        """So many images more."""
        self._images += count
        spent_s = self._line.due_s()
        if spent_s is None:
            return
        rate = self._images / spent_s
        left_s = round(max(self._total - self._images, 0) / rate) if rate > 0 else None
        left = f"  {timedelta(seconds=left_s)} left" if left_s is not None else ""
        tracks = f"{self._ended}/{self._jobs} tracks"
        self._line.write(f"{tracks}  {self._images}/{self._total} frames  {rate:.1f} frames/s{left}")

    def plotting(self, done: int, of: int) -> None:
        """While the plots are drawn."""
        if self._line.due_s() is not None:
            self._line.write(f"{done}/{of} plots")

    def close(self) -> None:
        """Clear the line."""
        self._line.close()


def _report(options: BenchOptions, plan: Plan, store: Store, failures: list[Failure], reused: int) -> Report:
    found = [(job, store.read(job)) for job in plan.jobs]
    scores = tuple(_scored(job, result, options) for job, result in found if result is not None)
    return Report(
        mode=options.mode,
        engines=plan.engines,
        cpu=describe_cpu(),
        scores=scores,
        failures=tuple(failures),
        reused=reused,
        max_frames=options.max_frames,
        fps=options.fps,
        further=store.further({spec.label for spec in options.trackers}),
    )


def _scored(job: Job, result: Result, options: BenchOptions) -> SequenceScore:
    return score_sequence(job, result, options.mode)


def _nothing(options: BenchOptions, problems: list[Problem]) -> str:
    if not problems:
        return f"{options.paths[0]}: no sequence is there; give a sequence, a data set, or a folder of them"
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    return f"{problems[0]}{more}"
