"""GOT-10k as published (got-10k.aitestunion.com): list.txt, `SEQ/00000001.jpg`, groundtruth.txt and label files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from tracker.training.errors import TrainingError
from tracker.training.recipe import Got10k
from tracker.training.source_names import source_name
from tracker.training.sources.limits import Choice
from tracker.training.sources.sequences import (
    SequenceFiles,
    chosen,
    footage_of,
    is_one_sequence,
    join,
    natural,
    read_all,
    source_of,
)
from tracker.training.sources.table_source import TableSource
from tracker.training.sources.text import need_folder, read_flags, read_lines, read_text, read_truth
from tracker.training.types import Footage, Skipped

TRUTH = "groundtruth.txt"
EXPECTED = "a split of GOT-10k (its train or val folder): list.txt and SEQ/groundtruth.txt beside the pictures"


def open_got10k(spec: Got10k, root: Path, reserved: frozenset[str]) -> TableSource:
    """The sequences of a split. Absent and wholly covered frames are left out. Raises TrainingError."""
    folder, skipped = root / spec.path, Skipped()
    sequences = _sequences(spec, folder, reserved, skipped)
    return source_of(sequences, source_name(spec), spec, folder, skipped)


def got10k_footage(spec: Got10k, root: Path) -> list[Footage]:
    """The sequences of a split, whole. Raises TrainingError."""
    folder, skipped = root / spec.path, Skipped()
    return footage_of(_sequences(spec, folder, frozenset(), skipped), folder, skipped)


def got10k_names(spec: Got10k, root: Path) -> list[str]:
    """What the sequences are called. Raises TrainingError."""
    folder = root / spec.path
    return chosen(_names(folder), Choice(spec, frozenset(), Skipped()), f"path {folder}")


def _names(folder: Path) -> list[str]:
    need_folder(folder, "path", EXPECTED)
    listed = folder / "list.txt"
    if listed.is_file():
        names = list(dict.fromkeys(line for _, line in read_lines(listed)))
    else:
        names = sorted((p.name for p in folder.iterdir() if (p / TRUTH).is_file()), key=natural)
    if not names:
        if (folder / TRUTH).is_file():
            raise is_one_sequence(folder)
        raise TrainingError(f"path {folder}: no sequence there; expected {EXPECTED}")
    return names


def _sequences(spec: Got10k, folder: Path, reserved: frozenset[str], skipped: Skipped) -> Iterator[SequenceFiles]:
    names = chosen(_names(folder), Choice(spec, reserved, skipped), f"path {folder}")
    return read_all(names, lambda name: _read(folder, name, skipped), folder, skipped)


def _read(folder: Path, name: str, skipped: Skipped) -> SequenceFiles:
    place = folder / name
    absent = {i for i, flag in enumerate(read_flags(place / "absence.label")) if flag}
    absent |= {i for i, level in enumerate(read_flags(place / "cover.label")) if level == 0}
    return join(folder, name, _label(place), name, read_truth(place / TRUTH, skipped), absent, skipped)


def _label(place: Path) -> str | None:
    """The class as meta_info.ini has it, where there is one."""
    meta = place / "meta_info.ini"
    lines = read_text(meta).splitlines() if meta.is_file() else []
    pairs = (line.partition(":") for line in lines)
    return next((value.strip() or None for key, _, value in pairs if key.strip() == "object_class"), None)
