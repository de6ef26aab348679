"""The suite that the simulator renders: scenarios that a tracker has to survive, many seeds of each."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sitl.scenario import load_scenario
from tracker.engines.cpu import describe_cpu
from uavfollow.benchmark.store import placed, write_json, writing
from uavfollow.errors import InputError
from uavfollow.interrupts import orderly_end
from uavfollow.progress import ProgressLine
from uavfollow.sim.session import commit, versions
from uavfollow.sim.suite_aims import AIMS, BY_NAME, GEOMETRY, PIXELS
from uavfollow.sim.suite_job import Flown, SuiteJob, fly
from uavfollow.sim.suite_table import Line, Outcome, as_json, as_markdown, line_of
from uavfollow.training.lock import LOCK, held
from uavfollow.video.writer import write_image
from uavfollow.workers import run_beside

KEY_SCHEMA = 1
MARKER = "suite.json"
RUNS = "runs"
STRIPS = 2  # seeds of each scenario that get a strip of pictures
STOP_S = 15.0  # a worker looks at each picture whether it is to stop; building a world takes a few seconds
DIED = "the process that flew it died (killed, or out of memory), alone as well; close other programs"
ROOT = Path(__file__).resolve().parents[2]
# The code that a result depends on, and what of it does not matter.
CODE = ("tracker", "control", "sitl", "uavfollow")
NOT_OF_A_RESULT = (
    "tracker/benchmark/", "tracker/training/", "uavfollow/benchmark/", "uavfollow/cli/", "uavfollow/training/",
    "uavfollow/record/", "uavfollow/video/", "uavfollow/sim/suite", "uavfollow/workers.py", "sitl/scenarios/",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class SuiteOptions:
    """What the user chose. `model` None: by the geometry camera."""

    names: tuple[str, ...]
    seeds: tuple[int, ...]
    jobs: int
    model: str | None
    precision: str
    device: str
    out: Path

    @property
    def source(self) -> str:
        """Where the candidates come from."""
        return GEOMETRY if self.model is None else PIXELS


@dataclass(frozen=True, slots=True, eq=False)
class SuiteResult:
    """Every run, and a line for each scenario."""

    lines: tuple[Line, ...]
    outcomes: tuple[Outcome, ...]
    json: dict[str, Any]
    markdown: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """No floor is missed and every run was made."""
        return bool(self.json["passed"])


def run_suite(options: SuiteOptions) -> SuiteResult:
    """Fly what is not there yet and write suite.json, suite.md and a strip of pictures for each scenario.

    Raises InputError for names, models and folders that are no use, or a file that cannot be written, and
    KeyboardInterrupt; what is finished stays.
    """
    jobs = list(_jobs(options))
    with held(options.out):
        _check_ours(options.out)
        store = SuiteStore(options.out)
        found = {job.name: store.read(job) for job in jobs}
        waiting = [job for job in jobs if found[job.name] is None]
        report = _Report(store, waiting, len(jobs) - len(waiting))
        try:
            with orderly_end():
                # Always in other processes: the end of a run makes its process deaf to signals.
                run_beside(waiting, fly, options.jobs, report, stop_s=STOP_S, died=DIED)
        finally:
            report.close()
        outcomes = [found[job.name] or report.made[job.name] for job in jobs]
        return _write(options, outcomes, store)


class SuiteStore:
    """runs/SCENARIO-SEED.json, each whole and with the key that it was made for, and its strip beside it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / RUNS

    def read(self, job: SuiteJob) -> Outcome | None:
        """The finished run of a job, None when there is none for its key: then it is flown (again)."""
        try:
            values = json.loads(self._path(job.name, ".json").read_text(encoding="utf-8"))
            if values["key"] != job.key or (job.strip and job.model and not self.strip(job.name).exists()):
                return None
            return Outcome(job.scenario, job.seed, dict(values["run"]), float(values["wall_s"]))
        except (OSError, ValueError, TypeError, KeyError):
            return None

    def write(self, job: SuiteJob, flown: Flown) -> Outcome:
        """Keep a run. The numbers come last: without them there is no result. Raises InputError."""
        path = self._path(job.name, ".json")
        with writing(path):
            self.folder.mkdir(parents=True, exist_ok=True)
            path.unlink(missing_ok=True)
        if flown.strip_bgr_u8 is not None:
            with writing(self.strip(job.name)):
                write_image(self.strip(job.name), flown.strip_bgr_u8)
        write_json(path, {"key": job.key, "wall_s": round(flown.wall_s, 3), "run": flown.run})
        return Outcome(job.scenario, job.seed, flown.run, flown.wall_s)

    def strip(self, name: str) -> Path:
        """Where the pictures of a run are."""
        return self._path(name, ".jpg")

    def _path(self, name: str, suffix: str) -> Path:
        return self.folder / f"{name}{suffix}"


class _Report:
    """Takes results as they come, keeps them, and shows how far it is."""

    def __init__(self, store: SuiteStore, jobs: Sequence[SuiteJob], kept: int) -> None:
        self._store, self._count, self._kept = store, len(jobs), kept
        self._line = ProgressLine()
        self._last = ""
        self.made: dict[str, Outcome] = {}

    def done(self, job: SuiteJob, result: Flown) -> None:
        """Keep a run."""
        self._made(job, self._store.write(job, result))

    def failed(self, job: SuiteJob, message: str) -> None:
        """A run that could not be made is tried again by the next command."""
        self._made(job, Outcome(job.scenario, job.seed, None, 0.0, message))

    def steps(self, count: int) -> None:
        """Show the line when it is time to; pictures of many runs at once say nothing about its end."""
        spent_s = self._line.due_s()
        if spent_s is not None:
            done = len(self.made)
            left = f"{(self._count - done) * spent_s / done / 60:.0f} min left" if done else "the first are flying"
            kept = f" ({self._kept} were there)" if self._kept else ""
            self._line.write(f"{done}/{self._count} runs{kept}  {left}  {self._last}")

    def close(self) -> None:
        """Clear the line."""
        self._line.close()

    def _made(self, job: SuiteJob, outcome: Outcome) -> None:
        self.made[job.name] = outcome
        word = outcome.problem or ("reached" if outcome.reached else "not reached")
        self._last = f"{job.scenario} seed {job.seed}: {word}"


def _jobs(options: SuiteOptions) -> Iterator[SuiteJob]:
    """Every scenario and seed, seed by seed, so that an early end leaves something of each."""
    shared = [KEY_SCHEMA, code_hash(), _identity(options), options.precision]
    texts = {name: load_scenario(name).model_dump_json(by_alias=True) for name in options.names}
    for number, seed in enumerate(options.seeds):
        for name in options.names:
            parts = [*shared, texts[name], seed]
            key = hashlib.sha256(json.dumps(parts).encode()).hexdigest()
            yield SuiteJob(name, seed, options.model, options.precision, options.device, key, number < STRIPS)


def code_hash(root: Path = ROOT) -> str:
    """Hash of the source files that a run depends on."""
    digest = hashlib.sha256()
    for package in CODE:
        for path in sorted((root / package).rglob("*.py")):
            name = path.relative_to(root).as_posix()
            if not name.startswith(NOT_OF_A_RESULT):
                digest.update(f"{name}\0".encode())
                digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def _identity(options: SuiteOptions) -> str:
    """Of the weights and the tracker's settings. It is built once for that, so that a wrong model is told at once."""
    if options.model is None:
        return GEOMETRY
    from uavfollow.trackers import DEFAULT_NAME, TrackerSpec, build

    return build(TrackerSpec(DEFAULT_NAME, options.model, raw=False), options.precision, options.device, 1).identity


def _check_ours(folder: Path) -> None:
    """Raise InputError when files of something else lie there."""
    names = sorted(p.name for p in folder.iterdir() if p.name != LOCK)
    if names and not {MARKER, RUNS} & set(names):
        raise InputError(f"--out {folder}: files of something else lie there ({names[0]}, ...): choose another folder")


def _write(options: SuiteOptions, outcomes: Sequence[Outcome], store: SuiteStore) -> SuiteResult:
    aims = [aim for aim in AIMS if aim.scenario in options.names]
    lines = tuple(line_of(aim, [o for o in outcomes if o.scenario == aim.scenario], options.source) for aim in aims)
    about = {
        "source": options.source,
        "model": options.model,
        "engine": next((o.run["engine"] for o in outcomes if o.run), None),
        "cpu": describe_cpu(),
        "versions": versions(),
        "commit": commit(),
    }
    said = f"Suite by {about['engine'] or options.source}, commit {about['commit'] or 'not known'}."
    problems = [f"{o.scenario} seed {o.seed} could not be flown: {o.problem}" for o in outcomes if o.problem]
    markdown = [*as_markdown(lines, said), *(["", *problems] if problems else [])]
    values = as_json(lines, outcomes, about)
    write_json(options.out / MARKER, values)
    with placed(options.out / "suite.md") as part:
        part.write_text("\n".join(markdown) + "\n", encoding="utf-8")
    for name in options.names:
        _montage(options, store, name)
    return SuiteResult(lines, tuple(outcomes), values, tuple(markdown))


def _montage(options: SuiteOptions, store: SuiteStore, name: str) -> None:
    """NAME.jpg: a row for each seed with a strip."""
    import cv2

    if options.model is None:
        return
    places = [store.strip(f"{name}-{seed:03d}") for seed in options.seeds[:STRIPS]]
    rows = [row for row in (cv2.imread(str(place)) for place in places if place.exists()) if row is not None]
    if rows:
        with writing(options.out / f"{name}.jpg"):
            write_image(options.out / f"{name}.jpg", np.asarray(np.vstack(rows), dtype=np.uint8))


def suite_names(given: Sequence[str]) -> tuple[str, ...]:
    """The scenarios of the suite in its order, or those given. Raises InputError for one that is not in it."""
    for name in given:
        if name not in BY_NAME:
            raise InputError(f"{name!r} is not in the suite; its scenarios are {', '.join(BY_NAME)}")
    return tuple(name for name in BY_NAME if not given or name in given)
