"""Finds sequences under paths: one sequence, a data set's root, or a folder of either."""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Sequence as Seq
from pathlib import Path

from tracker.benchmark.readers import got10k, otb, uav123, uavdt, uavtrack112, visdrone
from tracker.benchmark.readers.entry import Entry, has_images, read_entry, subfolders
from tracker.benchmark.sequence import Problem, Sequence

Layout = Callable[[Path], list[Entry]]

# Sets whose pictures and annotations lie in different folders. Most special first: UAVDT and UAVTrack112 would also
# pass for UAV123.
SETS: tuple[Layout, ...] = (visdrone.find, uavdt.find, uavtrack112.find, uav123.find)
LAYOUTS: tuple[Layout, ...] = (otb.find, *SETS, got10k.find)
EXPECTED = (
    "expected SEQ/img with groundtruth_rect.txt (OTB, DTB70), data_seq with anno (UAV123, UAV20L, UAVDT, UAVTrack112), "
    "sequences with annotations (VisDrone-SOT), images with groundtruth.txt (GOT-10k), or a folder of these"
)
_DOWN = 4  # folders below a given one: DATA/Dataset_UAV123/UAV123/{data_seq,anno} has its root two below
_UP = 4  # ROOT/data_seq/UAV123/bike1 and ROOT/anno/UAV123/bike1.txt have their root three above


def find_sequences(paths: Seq[Path]) -> tuple[list[Sequence], list[Problem]]:
    """Sequences of all paths in order, each once, and what could not be used, with its place and the reason.

    A path may be one sequence (also a picture folder or an annotation file of a data set), a data set's root, a part
    of it (ROOT/anno/UAV20L), or a folder of these. Never raises for what is found on disk.
    """
    sequences: list[Sequence] = []
    problems: list[Problem] = []
    seen: set[tuple[Path, str]] = set()
    for path in paths:
        entries, problem = _entries(path)
        if problem is not None:
            problems.append(problem)
        for entry in entries:
            key = (entry.truth.resolve(), entry.name)
            if key in seen:
                continue
            seen.add(key)
            sequence, wrong = read_entry(entry)
            problems.extend(wrong)
            if sequence is not None:
                sequences.append(sequence)
    return sequences, problems


def _entries(path: Path) -> tuple[list[Entry], Problem | None]:
    if not path.exists():
        return [], Problem(str(path), "no such file or folder")
    found = _part_of_a_set(path) or (_below(path, _DOWN) if path.is_dir() else [])
    return (found, None) if found else ([], Problem(str(path), f"no sequence found here: {EXPECTED}"))


def _below(folder: Path, depth: int) -> list[Entry]:
    for layout in LAYOUTS:
        if found := layout(folder):
            return found
    if has_images(folder):
        # named so that reading it says what is missing; a sequence left out silently would flatter the mean
        return [Entry(folder.name, "", folder, folder / otb.TRUTH_FILES[-1])]
    if depth == 0:
        return []
    return [entry for sub in subfolders(folder) for entry in _below(sub, depth - 1)]


def _part_of_a_set(path: Path) -> list[Entry]:
    """Sequences of the data set around `path` whose pictures or truth it is or holds."""
    place = path.absolute()
    for root in list(place.parents)[:_UP]:
        for layout in SETS:
            mine = [e for e in layout(root) if place in (e.pictures, *e.pictures.parents, e.truth, *e.truth.parents)]
            if mine:
                return mine
    return []
