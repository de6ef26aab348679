"""Which data set a folder belongs to, by its name or that of a folder around it, and its frame rate."""

from __future__ import annotations

import re
from pathlib import Path

from tracker.benchmark import attributes as names
from tracker.benchmark.sequence import DEFAULT_FPS

RATES_FPS = {names.UAV123_10FPS: 10.0}

# What the letters and digits of a folder's name begin with, in lower case; the first match counts.
_MARKS = (
    ("uav12310fps", names.UAV123_10FPS),
    ("uav12320l", names.UAV20L),
    ("uav20l", names.UAV20L),
    ("uav123", names.UAV123),
    ("datasetuav12310fps", names.UAV123_10FPS),
    ("datasetuav123", names.UAV123),
    ("dtb70", names.DTB70),
    ("uavdt", names.UAVDT),
    ("uavbenchmarks", names.UAVDT),
    ("visdrone", names.VISDRONE),
    ("uavtrack112", names.UAVTRACK112),
    ("v4rflight112", names.UAVTRACK112),
    ("got10k", names.GOT10K),
    ("otb", names.OTB),
)
_UP = 3  # a sequence lies at most so deep in a folder that bears its data set's name (UAV123/data_seq/UAV123/bike1)


def dataset_of(folder: Path) -> str | None:
    """The data set by the name of the folder or of one of the three around it; None when none says so."""
    place = folder.resolve()
    for part in (place, *place.parents)[: _UP + 1]:
        plain = re.sub(r"[^a-z0-9]", "", part.name.lower())
        for mark, name in _MARKS:
            if plain.startswith(mark):
                return name
    return None


def rate_fps(dataset: str) -> float:
    """The rate at which a data set's images were taken; 30 where it does not say so."""
    return RATES_FPS.get(dataset, DEFAULT_FPS)
