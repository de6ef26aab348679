"""From what a recipe says of a source to the source."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tracker.training.errors import TrainingError
from tracker.training.recipe import (
    AnySource,
    Coco,
    Folders,
    Got10k,
    Packed,
    Simulator,
    Stills,
    Validation,
    Vid,
    VideoFiles,
    YoutubeBB,
)
from tracker.training.source_names import simulated_name
from tracker.training.sources.coco import open_coco
from tracker.training.sources.folders import folder_names, folders_footage, open_folders
from tracker.training.sources.got10k import got10k_footage, got10k_names, open_got10k
from tracker.training.sources.stills import open_stills
from tracker.training.sources.vid import open_vid
from tracker.training.sources.video_files import open_video_files
from tracker.training.sources.youtube_bb import open_youtube_bb
from tracker.training.types import Footage, Source

Injected = Callable[[Any], Any]  # from the section of the recipe to a Source (FootageSource for footage)

_OPENERS: dict[type, Callable[[Any, Path, frozenset[str]], Source]] = {
    Folders: open_folders,
    Got10k: open_got10k,
    Vid: open_vid,
    YoutubeBB: open_youtube_bb,
    Coco: open_coco,
    Stills: open_stills,
    VideoFiles: open_video_files,
}


def open_source(
    spec: AnySource, root: Path, injected: Mapping[str, Injected], reserved: frozenset[str] = frozenset()
) -> Source:
    """The source; relative paths are below `root`. `injected[kind]` makes what this package cannot (`simulator`).

    Sequences named in `reserved` or the source's `exclude` are left out. Raises TrainingError for what is missing, for
    a name in `only` that is not there, and when nothing is left, with all that was skipped and why.
    """
    if isinstance(spec, Simulator):
        source: Source = _inject(spec, injected)
        return source
    if isinstance(spec, Packed):
        from tracker.training.sources.packed import open_packed  # it needs this module's package

        return open_packed(spec, root, reserved)
    with _readable():
        return _OPENERS[type(spec)](spec, root, reserved)


def open_footage(spec: AnySource, root: Path, injected: Mapping[str, Injected]) -> list[Footage]:
    """Whole sequences for validation. Raises TrainingError, also for kinds that have none."""
    if isinstance(spec, Simulator):
        return list(_inject(spec, injected).footage())
    with _readable():
        if isinstance(spec, Folders):
            return folders_footage(spec, root)
        if isinstance(spec, Got10k):
            return got10k_footage(spec, root)
    raise _no_sequences(spec)


def reserved_names(validation: Validation, root: Path) -> frozenset[str]:
    """Names of the sequences that validation uses: no source may train on them. Raises TrainingError."""
    names: set[str] = set()
    for spec in validation.sources:
        with _readable():
            if isinstance(spec, Folders):
                names.update(folder_names(spec, root))
            elif isinstance(spec, Got10k):
                names.update(got10k_names(spec, root))
            elif isinstance(spec, Simulator):  # its pictures may come back in a pack
                names.update(simulated_name(seed) for seed in range(spec.seed, spec.seed + spec.sequences))
            else:
                raise _no_sequences(spec)
    return frozenset(names)


@contextmanager
def _readable() -> Iterator[None]:
    """What the file system refuses, or a broken archive, as the error of this package."""
    try:
        yield
    except (OSError, EOFError, zlib.error) as error:
        raise TrainingError(f"cannot be read: {error}") from error


def _inject(spec: Simulator, injected: Mapping[str, Injected]) -> Any:
    if spec.kind not in injected:
        raise TrainingError(f"kind {spec.kind}: not available here; run `uavfollow train`, which brings the simulator")
    return injected[spec.kind](spec)


def _no_sequences(spec: AnySource) -> TrainingError:
    return TrainingError(f"validation: kind {spec.kind} has no whole sequences; use folders, got10k or simulator")
