"""Trackers by name: `siamapnpp@full`, `nanotrack@FOLDER`, or a plug-in of another package; `+raw` for the bare tracker.

A plug-in is an entry point of the group `uavfollow.trackers`: its name is what the user writes, its object a `Factory`.
Only the one that is asked for is imported, so a broken one hurts nobody else.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module, metadata
from pathlib import Path
from typing import TYPE_CHECKING

from tracker.raw import RawTarget
from tracker.target import TargetConfig, TargetTracker
from tracker.weights.build import BuiltTracker
from uavfollow.errors import InputError

if TYPE_CHECKING:
    from tracker.filter import FilterConfig

GROUP = "uavfollow.trackers"
DEFAULT_NAME = "siamapnpp"
RAW_SUFFIX = "+raw"
MODEL_MARK = "@"
# (model, precision, device, threads) -> BuiltTracker. An empty model: none was named; threads None: as they are.
Factory = Callable[[str, str, str, int | None], BuiltTracker]


@dataclass(frozen=True, slots=True)
class BuiltIn:
    """Where one of our own factories is, known without the metadata of an installation, which may be stale."""

    where: str
    default_model: str


BUILT_IN = {
    "siamapnpp": BuiltIn("tracker.weights.build:build_tracker", "s"),
    "nanotrack": BuiltIn("tracker.nanotrack.build:build_tracker", ""),
}


@dataclass(frozen=True, slots=True)
class TrackerSpec:
    """Which tracker, with which model (empty: the plug-in's own default), alone (`raw`) or with the target tracker."""

    name: str
    model: str
    raw: bool

    def __str__(self) -> str:
        """As the user writes it: NAME[@MODEL][+raw]."""
        return f"{self.name}{MODEL_MARK + self.model if self.model else ''}{RAW_SUFFIX if self.raw else ''}"

    @property
    def label(self) -> str:
        """The same without the folders of a model's path: for tables and as the name of a folder."""
        model = Path(self.model).name if self.model else ""
        return str(TrackerSpec(self.name, model, self.raw))


def parse_spec(text: str, model: str = "") -> TrackerSpec:
    """NAME[@MODEL][+raw]; `model` counts where the text names none. Raises InputError on an unknown name."""
    rest = text.strip()
    raw = rest.endswith(RAW_SUFFIX)
    name, mark, named = rest.removesuffix(RAW_SUFFIX).partition(MODEL_MARK)
    if mark and not named:
        raise InputError(f"tracker {text!r} names no model after the {MODEL_MARK}; leave the {MODEL_MARK} out")
    if name not in known_names():
        raise InputError(_unknown(name, raw, text))
    default = BUILT_IN[name].default_model if name in BUILT_IN else ""
    return TrackerSpec(name, named or model or default, raw)


def parse_specs(text: str) -> tuple[TrackerSpec, ...]:
    """Several, with commas between them. Raises InputError on an unknown name or one given twice."""
    specs = tuple(parse_spec(part) for part in text.split(","))
    for number, spec in enumerate(specs):
        if spec in specs[:number]:
            raise InputError(f"tracker {spec} is named twice in {text!r}; name each one once")
    return specs


def known_names() -> tuple[str, ...]:
    """Names that `parse_spec` takes: our own, then those of other packages. Nothing is imported for it."""
    foreign = sorted(entry.name for entry in _foreign())
    return (*BUILT_IN, *dict.fromkeys(foreign))


def build(spec: TrackerSpec, precision: str = "auto", device: str = "auto", threads: int | None = None) -> BuiltTracker:
    """The tracker, ready for `init`. Raises InputError when the plug-in, its model or the device cannot be used.

    `precision` is auto, fp32 or bf16, `device` auto, cpu or cuda; `threads` None: left as they are.
    """
    factory = _built_in(spec.name) if spec.name in BUILT_IN else _load_foreign(spec.name)
    try:
        built = factory(spec.model, precision, device, threads)
    except ValueError as error:  # also WeightsError: bad weights are bad input
        raise InputError(f"tracker {spec}: {error}") from error
    except Exception as error:
        if spec.name in BUILT_IN:
            raise
        raise InputError(f"tracker {spec}: the plug-in failed ({_one_line(error)}); tell its authors") from error
    if not isinstance(built, BuiltTracker):
        raise InputError(
            f"tracker {spec}: the plug-in gave a {type(built).__name__}, not a BuiltTracker; tell its authors"
        )
    return built


def make_target(
    spec: TrackerSpec,
    built: BuiltTracker,
    config: TargetConfig | None = None,
    filter_config: FilterConfig | None = None,
) -> TargetTracker | RawTarget:
    """What makes this tracker's candidates into a target state: with its fitted confidence, or the bare `RawTarget`."""
    if spec.raw:
        return RawTarget()
    return TargetTracker(config, filter_config, built.confidence)


def _foreign() -> list[metadata.EntryPoint]:
    """Entry points of other packages. Ours are in the table; nobody else may stand in for them."""
    return [entry for entry in metadata.entry_points(group=GROUP) if entry.name not in BUILT_IN]


def _built_in(name: str) -> Factory:
    module, _, attribute = BUILT_IN[name].where.partition(":")
    factory: Factory = getattr(import_module(module), attribute)
    return factory


def _load_foreign(name: str) -> Factory:
    entries = [entry for entry in _foreign() if entry.name == name]
    if not entries:
        raise InputError(_unknown(name, raw=False, text=name))
    if len({entry.value for entry in entries}) > 1:
        owners = " and ".join(sorted(_owner(entry) for entry in entries))
        raise InputError(f"tracker {name!r} is given by {owners}; uninstall one of them")
    entry = entries[0]
    try:
        factory = entry.load()
    except Exception as error:  # a foreign module may raise anything while it is imported
        raise InputError(
            f"tracker {name!r} ({entry.value} of {_owner(entry)}) cannot be imported ({_one_line(error)}); "
            "mend or uninstall that package"
        ) from error
    if not callable(factory):
        raise InputError(f"tracker {name!r}: {entry.value} of {_owner(entry)} cannot be called; it must be a factory")
    made: Factory = factory
    return made


def _owner(entry: metadata.EntryPoint) -> str:
    return f"the distribution {entry.dist.name!r}" if entry.dist is not None else "an unknown distribution"


def _unknown(name: str, raw: bool, text: str) -> str:
    names = known_names()
    close = difflib.get_close_matches(name, names, 1)
    hint = f"; did you mean {close[0]}{RAW_SUFFIX if raw else ''}?" if close else "."
    form = f"NAME[{MODEL_MARK}MODEL][{RAW_SUFFIX}]"
    return f"unknown tracker {name!r} in {text!r}{hint} Known are {', '.join(names)}, written {form}"


def _one_line(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())
