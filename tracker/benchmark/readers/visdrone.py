"""VisDrone-SOT: sequences/SEQ/*.jpg, annotations/SEQ.txt, attributes/SEQ_attr.txt."""

from __future__ import annotations

from pathlib import Path

from tracker.benchmark.attributes import VISDRONE
from tracker.benchmark.readers.entry import Entry, first_file


def find(root: Path) -> list[Entry]:
    """Its sequences, one for each annotation file; none when this is not the root of such a set."""
    pictures, truths = root / "sequences", root / "annotations"
    if not (pictures.is_dir() and truths.is_dir()):
        return []
    flags = root / "attributes"
    return [
        Entry(
            truth.stem,
            VISDRONE,
            pictures / truth.stem,
            truth,
            attributes=first_file(flags / f"{truth.stem}_attr.txt", flags / truth.name),
        )
        for truth in sorted(truths.glob("*.txt"))
    ]
