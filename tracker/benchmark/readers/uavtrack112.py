"""UAVTrack112: data_seq/SEQ/*.jpg, anno/SEQ.txt (space, comma or tab), att/SEQ.txt."""

from __future__ import annotations

from pathlib import Path

from tracker.benchmark.attributes import UAVTRACK112
from tracker.benchmark.readers.datasets import dataset_of
from tracker.benchmark.readers.entry import Entry, first_file


def find(root: Path) -> list[Entry]:
    """Its sequences, one for each annotation file; none when this is not the root of such a set.

    It differs from UAV123 only in having its attributes at the root, so a folder that bears its name is one too.
    """
    pictures, truths = root / "data_seq", root / "anno"
    if not (pictures.is_dir() and truths.is_dir()):
        return []
    if dataset_of(root) != UAVTRACK112 and not (root / "att").is_dir():
        return []
    folders = (root / "att", root / "attributes", truths / "att")
    return [
        Entry(
            truth.stem,
            UAVTRACK112,
            pictures / truth.stem,
            truth,
            attributes=first_file(*(f / truth.name for f in folders)),
        )
        for truth in sorted(truths.glob("*.txt"))
    ]
