"""Sequences as plain folders: OTB and UAV (`SEQ/img`, groundtruth_rect.txt), LaSOT (`CLASS/SEQ`), pictures in `SEQ`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from tracker.training.errors import TrainingError
from tracker.training.recipe import Folders
from tracker.training.source_names import source_name
from tracker.training.sources.limits import Choice
from tracker.training.sources.sequences import (
    SequenceFiles,
    chosen,
    footage_of,
    is_one_sequence,
    join,
    list_pictures,
    natural,
    read_all,
    source_of,
)
from tracker.training.sources.table_source import TableSource
from tracker.training.sources.text import need_folder, read_flags, read_truth
from tracker.training.types import Footage, Skipped

TRUTH_FILES = ("groundtruth_rect.txt", "groundtruth.txt")
ABSENT_FILES = ("full_occlusion.txt", "out_of_view.txt")  # of LaSOT: 1 where the target cannot be seen
EXPECTED = "folders SEQ/img (or CLASS/SEQ/img) with groundtruth_rect.txt or groundtruth.txt beside img"


def open_folders(spec: Folders, root: Path, reserved: frozenset[str]) -> TableSource:
    """The sequences below `spec.path`. Raises TrainingError."""
    folder, skipped = root / spec.path, Skipped()
    sequences = _sequences(spec, folder, reserved, skipped)
    return source_of(sequences, source_name(spec), spec, folder, skipped)


def folders_footage(spec: Folders, root: Path) -> list[Footage]:
    """The sequences below `spec.path`, whole. Raises TrainingError."""
    folder, skipped = root / spec.path, Skipped()
    return footage_of(_sequences(spec, folder, frozenset(), skipped), folder, skipped)


def folder_names(spec: Folders, root: Path) -> list[str]:
    """What the sequences are called. Raises TrainingError."""
    found = _find(root / spec.path)
    return chosen(found, Choice(spec, frozenset(), Skipped()), f"path {root / spec.path}")


def _sequences(spec: Folders, folder: Path, reserved: frozenset[str], skipped: Skipped) -> Iterator[SequenceFiles]:
    found = _find(folder)
    names = chosen(found, Choice(spec, reserved, skipped), f"path {folder}")
    return read_all(names, lambda name: _read(folder, name, found[name], skipped), folder, skipped)


def _find(folder: Path) -> dict[str, str]:
    """Name and place (relative to `folder`) of each sequence, one or two levels down."""
    need_folder(folder, "path", EXPECTED)
    found: dict[str, str] = {}
    for child in _children(folder):
        inside = [child] if _truth_file(child) else [c for c in _children(child) if _truth_file(c)]
        for sequence in inside:
            place = sequence.relative_to(folder).as_posix()
            if sequence.name in found:
                raise TrainingError(
                    f"path {folder}: {found[sequence.name]} and {place} have the same name; use two sources"
                )
            found[sequence.name] = place
    if not found:
        if _truth_file(folder):
            raise is_one_sequence(folder)
        raise TrainingError(f"path {folder}: no sequence there; expected {EXPECTED}")
    return found


def _children(folder: Path) -> list[Path]:
    return sorted((p for p in folder.iterdir() if p.is_dir() and p.name[0] != "."), key=lambda p: natural(p.name))


def _truth_file(sequence: Path) -> Path | None:
    return next((sequence / name for name in TRUTH_FILES if (sequence / name).is_file()), None)


def _read(folder: Path, name: str, inside: str, skipped: Skipped) -> SequenceFiles:
    place = folder / inside
    truth = _truth_file(place)
    assert truth is not None  # _find chose it for this file
    absent = {i for file in ABSENT_FILES for i, flag in enumerate(read_flags(place / file)) if flag}
    pictures = f"{inside}/img" if (place / "img").is_dir() and list_pictures(folder, f"{inside}/img") else inside
    return join(folder, name, _label(name, inside), pictures, read_truth(truth, skipped), absent, skipped)


def _label(name: str, inside: str) -> str | None:
    """LaSOT names sequences after their class: `airplane/airplane-1`. Any other upper folder is no class."""
    above = inside.rpartition("/")[0]
    return above if above and name.startswith(f"{above}-") else None
