"""UAVDT-SOT: SEQ/*.jpg and anno/SEQ_gt.txt, in the official two folders or in one with data_seq/ and anno/."""

from __future__ import annotations

from pathlib import Path

from tracker.benchmark.attributes import UAVDT
from tracker.benchmark.readers.entry import Entry, first_file

PICTURES = ("data_seq", "UAV-benchmark-S")
TRUTHS = ("anno", "UAV-benchmark-SOT_v1.0/anno")
_END = "_gt"


def find(root: Path) -> list[Entry]:
    """Its sequences, one for each annotation file; none when this is not the root of such a set."""
    pictures = next((root / p for p in PICTURES if (root / p).is_dir()), None)
    truths = next((root / t for t in TRUTHS if any((root / t).glob(f"*{_END}.txt"))), None)
    if pictures is None or truths is None:
        return []
    return [_entry(pictures, truth) for truth in sorted(truths.glob(f"*{_END}.txt"))]


def _entry(pictures: Path, truth: Path) -> Entry:
    name = truth.stem[: -len(_END)]
    folders = (truth.parent / "att", truth.parent.parent / "att")
    attributes = first_file(*(f / n for f in folders for n in (f"{name}_att.txt", f"{name}.txt")))
    return Entry(name, UAVDT, pictures / name, truth, attributes=attributes)
