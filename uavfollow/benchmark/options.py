"""What the command line says of a benchmark, and the trackers by what their results depend on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from uavfollow.errors import InputError
from uavfollow.trackers import TrackerSpec, parse_spec
from uavfollow.trackers import build as build_tracker

if TYPE_CHECKING:
    from tracker.benchmark.scores import Mode
    from tracker.weights.build import BuiltTracker

# As `uavfollow.trackers.build`; another one must be a function of a module, for processes get it by its name.
Builder = Callable[[TrackerSpec, str, str, "int | None"], "BuiltTracker"]


@dataclass(frozen=True, slots=True)
class BenchOptions:
    """`paths` are sequences, data sets, or folders of them. None: as the data set says, or without a limit."""

    paths: tuple[Path, ...]
    trackers: tuple[TrackerSpec, ...]
    out: Path
    mode: Mode
    jobs: int = 1
    precision: str = "auto"
    device: str = "auto"
    fps: float | None = None
    max_frames: int | None = None
    build: Builder = build_tracker


def chosen_trackers(texts: list[str], model: str) -> tuple[TrackerSpec, ...]:
    """Trackers named as SPEC,SPEC, once or several times; `model` for those that name none.

    Raises InputError: unknown, empty or named twice, or two whose results would have the same name.
    """
    specs: list[TrackerSpec] = []
    for given, text in ((whole, part) for whole in texts for part in whole.split(",")):
        if not text.strip():
            raise InputError(f"--tracker {given}: a name is empty there; write SPEC,SPEC without further commas")
        spec = parse_spec(text, model)
        twin = next((other for other in specs if other.label == spec.label), None)
        if twin == spec:
            raise InputError(f"--tracker {spec}: is named twice; name each one once")
        if twin is not None:
            raise InputError(
                f"--tracker {spec} and {twin}: their results would have the same name, {spec.label}; rename one model"
            )
        specs.append(spec)
    return tuple(specs)
