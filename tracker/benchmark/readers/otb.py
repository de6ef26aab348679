"""OTB-style folders, DTB70 among them: SEQ/img and SEQ/groundtruth_rect.txt."""

from __future__ import annotations

from pathlib import Path

from tracker.benchmark.readers.datasets import dataset_of, rate_fps
from tracker.benchmark.readers.entry import Entry, first_file

TRUTH_FILES = ("groundtruth_rect.txt", "groundtruth.txt")


def find(folder: Path) -> list[Entry]:
    """The sequence in this folder; several when it has more than one target (groundtruth_rect.1.txt); else none."""
    pictures = folder / "img"
    if not pictures.is_dir():
        return []
    name = folder.resolve().name
    dataset = dataset_of(folder.resolve().parent) or folder.resolve().parent.name
    attributes = first_file(
        folder / "att.txt", folder.parent / "att" / f"{name}.txt", folder.parent / "attributes" / f"{name}.txt"
    )
    targets = {name: first_file(*(folder / f for f in TRUTH_FILES))}
    if targets[name] is None:
        several = sorted(folder.glob("groundtruth_rect.[0-9].txt"))
        targets = {f"{name}-{p.suffixes[-2][1:]}": p for p in several} or {name: folder / TRUTH_FILES[0]}
    return [
        Entry(n, dataset, pictures, truth, fps=rate_fps(dataset), attributes=attributes)
        for n, truth in targets.items()
        if truth is not None
    ]
