"""UAV123, UAV123@10fps and UAV20L as released: data_seq/SET/FOLDER/*.jpg and anno/SET/SEQ.txt, or without SET.

Their folders are whole videos. Some were cut into several sequences, which exist only as ranges of image numbers: the
table here. A release in which somebody has cut the folders already is read as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from tracker.benchmark.attributes import UAV123, UAV123_10FPS
from tracker.benchmark.readers.datasets import dataset_of, rate_fps
from tracker.benchmark.readers.entry import Entry, first_file, subfolders

# First and last image of FOLDER_1, FOLDER_2, ... at 30 images a second (configSeqs of the benchmark: facts of the data
# set; the sequences of one folder that share an image are meant to).
RANGES: Mapping[str, tuple[tuple[int, int], ...]] = MappingProxyType(
    {
        "bird1": ((1, 253), (775, 1477), (1573, 2437)),
        "car1": ((1, 751), (751, 1627), (1627, 2629)),
        "car6": ((1, 487), (487, 1807), (1807, 2953), (2953, 3925), (3925, 4861)),
        "car8": ((1, 1357), (1357, 2575)),
        "car16": ((1, 415), (415, 1993)),
        "group1": ((1, 1333), (1333, 2515), (2515, 3925), (3925, 4873)),
        "group2": ((1, 907), (907, 1771), (1771, 2683)),
        "group3": ((1, 1567), (1567, 2827), (2827, 4369), (4369, 5527)),
        "person2": ((1, 1189), (1189, 2623)),
        "person4": ((1, 1501), (1501, 2743)),
        "person5": ((1, 877), (877, 2101)),
        "person7": ((1, 1249), (1249, 2065)),
        "person8": ((1, 1075), (1075, 1525)),
        "person12": ((1, 601), (601, 1621)),
        "person14": ((1, 847), (847, 1813), (1813, 2923)),
        "person17": ((1, 1501), (1501, 2347)),
        "person19": ((1, 1243), (1243, 2791), (2791, 4357)),
        "truck4": ((1, 577), (577, 1261)),
        "uav1": ((1, 1555), (1555, 2377), (2473, 3469)),
    }
)
_STEP_10FPS = 3  # every third image of the original, numbered anew from 1


def find(root: Path) -> list[Entry]:
    """Sequences of every annotation folder of a root; none when this is not the root of such a set."""
    truths = root / "anno"
    if not (truths.is_dir() and (root / "data_seq").is_dir()):
        return []
    sets = [f for f in subfolders(truths) if f.name != "att"]
    return [entry for folder in (truths, *sets) for entry in _find_set(root, folder)]


def _find_set(root: Path, truths: Path) -> list[Entry]:
    dataset = dataset_of(truths) or UAV123
    # UAV20L has no images of its own: it is whole videos of UAV123
    own = root / "data_seq" / truths.name
    shared = root / "data_seq" / "UAV123"
    pictures = next((p for p in (own, shared) if p.is_dir()), root / "data_seq")
    return [_entry(dataset, pictures, truth) for truth in sorted(truths.glob("*.txt"))]


def _entry(dataset: str, pictures: Path, truth: Path) -> Entry:
    name = truth.stem
    folder, frames = pictures / name, None
    if not folder.is_dir() and (part := part_of(name, dataset)) is not None:
        folder, frames = pictures / part[0], part[1]
    attributes = first_file(truth.parent / "att" / truth.name)
    return Entry(name, dataset, folder, truth, fps=rate_fps(dataset), frames=frames, attributes=attributes)


def part_of(name: str, dataset: str) -> tuple[str, tuple[int, int]] | None:
    """Folder and image numbers (first, last) of a sequence that is a part of a video; None for other names."""
    folder, _, number = name.rpartition("_")
    parts = RANGES.get(folder, ())
    if not number.isdigit() or not 1 <= int(number) <= len(parts):
        return None
    first, last = parts[int(number) - 1]
    if dataset == UAV123_10FPS:
        first, last = ((n - 1) // _STEP_10FPS + 1 for n in (first, last))
    return folder, (first, last)
