"""Which tracker runs over which sequence, and a key for each: the same key, the same result.

A key holds what a result depends on: the code that makes it, the tracker's weights and settings, the frame rate, the
annotation, and the images by name and size (their bytes would take longer to read than some trackers need). Places do
not count, so a data set may be moved.
"""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tracker.benchmark.sequence import Problem, Sequence
from uavfollow.benchmark.job import ROOT, THREADS, Job
from uavfollow.benchmark.options import BenchOptions
from uavfollow.trackers import TrackerSpec

KEY_SCHEMA = 1
# The code of a result: the tracker without its readers, scores and training, the registry, and the job's own loop.
NOT_OF_A_RESULT = ("tracker/benchmark/", "tracker/training/")
ALSO = ("uavfollow/trackers*", "uavfollow/benchmark/job.py")


@dataclass(frozen=True, slots=True)
class Plan:
    """Every tracker over every sequence, sequence by sequence. `engines` are those of the trackers, in their order."""

    sequences: tuple[tuple[str, Sequence], ...]
    jobs: tuple[Job, ...]
    engines: dict[TrackerSpec, str]


def make_plan(options: BenchOptions, found: Iterable[Sequence]) -> tuple[Plan, list[Problem]]:
    """The jobs of the options, and the sequences that were left out. Raises InputError for a tracker that is no use."""
    named, problems = _named(found)
    code = code_hash()
    built = {spec: _identity(options, spec) for spec in options.trackers}
    jobs, sequences = [], []
    for name, whole in named:
        sequence = _limited(options, whole)
        sequences.append((name, sequence))
        material = _material(sequence)
        for spec in options.trackers:
            identity = built[spec][0]
            key = _hash([KEY_SCHEMA, code, spec.label, identity, options.precision, sequence.fps, material])
            frames = len(whole.images)
            jobs.append(Job(spec, sequence, name, key, options.precision, options.device, options.build, frames))
    return Plan(tuple(sequences), tuple(jobs), {spec: engine for spec, (_, engine) in built.items()}), problems


def code_hash(root: Path = ROOT) -> str:
    """Hash of the source files that results depend on."""
    digest = hashlib.sha256()
    for path in sorted(_sources(root)):
        digest.update(f"{path.relative_to(root).as_posix()}\0".encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def _sources(root: Path) -> Iterator[Path]:
    for path in (root / "tracker").rglob("*.py"):
        if not path.relative_to(root).as_posix().startswith(NOT_OF_A_RESULT):
            yield path
    for pattern in ALSO:
        for path in root.glob(pattern):
            yield from path.rglob("*.py") if path.is_dir() else [path]


def _identity(options: BenchOptions, spec: TrackerSpec) -> tuple[list[str], str]:
    """What the tracker's results depend on beside our code; and its engine. It is built once for that."""
    built = options.build(spec, options.precision, options.device, THREADS)
    return [built.identity, built.engine, _foreign_code(built.tracker)], built.engine


def _foreign_code(tracker: Any) -> str:
    """Hash of the module of a plug-in's tracker; empty for our own, which is in `code_hash`."""
    try:
        path = Path(inspect.getfile(type(tracker))).resolve()
    except (TypeError, OSError):  # written in C, or made at run time: its identity has to do
        return ""
    return "" if path.is_relative_to(ROOT / "tracker") else hashlib.sha256(path.read_bytes()).hexdigest()


def _limited(options: BenchOptions, sequence: Sequence) -> Sequence:
    """The sequence with the frame rate and the length that the user wants."""
    count = len(sequence.images) if options.max_frames is None else options.max_frames
    return replace(
        sequence, images=sequence.images[:count], truth=sequence.truth[:count], fps=options.fps or sequence.fps
    )


def _named(found: Iterable[Sequence]) -> tuple[list[tuple[str, Sequence]], list[Problem]]:
    """Names for files and tables; with the data set, for UAV123 and UAV20L have sequences of the same names."""
    named: dict[str, Sequence] = {}
    problems = []
    for sequence in found:
        name = f"{_safe(sequence.dataset)}/{_safe(sequence.name)}"
        if name not in named:
            named[name] = sequence
        elif named[name] != sequence:
            first, second = named[name].images[0].parent, sequence.images[0].parent
            message = (
                f"is also called {name}, as {first} is, and its results would lie in the same place; it is left out. "
                "Rename one of the folders, or give each its own --out"
            )
            problems.append(Problem(str(second), message))
    return list(named.items()), problems


def _safe(name: str) -> str:
    """As the name of a folder: one that is hidden or goes elsewhere is none."""
    cleaned = "".join(c if c.isalnum() or c in "-_.@+" else "-" for c in name)
    return cleaned.lstrip(".") or "unnamed"


def _material(sequence: Sequence) -> str:
    """Hash of images and annotation."""
    rows = [box.to_xywh() if box is not None else None for box in sequence.truth]
    return _hash([sequence.first.to_xywh(), rows, [(path.name, _size(path)) for path in sequence.images]])


def _size(path: Path) -> int | None:
    try:
        return path.stat().st_size
    except OSError:  # the loop takes it as an image that cannot be read
        return None


def _hash(parts: list[Any]) -> str:
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()
