"""What a data set says of its sequences: the attributes' short names, the order of their flags, and scores by them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from tracker.benchmark.scores import Curves, mean_curves

OTB = "OTB"
UAV123 = "UAV123"
UAV123_10FPS = "UAV123@10fps"
UAV20L = "UAV20L"
DTB70 = "DTB70"
UAVDT = "UAVDT"
VISDRONE = "VisDrone-SOT"
UAVTRACK112 = "UAVTrack112"
GOT10K = "GOT-10k"

_UAV123 = ("SV", "ARC", "LR", "FM", "FOC", "POC", "OV", "BC", "IV", "VC", "CM", "SOB")

# The order of the 0/1 flags in a data set's attribute file (siamapnpp.md 4.4; those of UAV123, UAVDT and VisDrone
# compared with public evaluation code as well).
FLAGS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        UAV123: _UAV123,
        UAV123_10FPS: _UAV123,
        UAV20L: _UAV123,
        DTB70: ("SV", "ARV", "OCC", "DEF", "FCM", "IPR", "OPR", "OV", "BC", "SOA", "MB"),
        UAVDT: ("BC", "CM", "OM", "SO", "IV", "OB", "SV", "LTT", "LO"),
        VISDRONE: ("ARC", "BC", "CM", "FM", "FOC", "IV", "LR", "OV", "POC", "SOB", "SV", "VC"),
        UAVTRACK112: ("FM", "LR", "LTT", "ARC", "SV", "POC", "FOC", "CM", "OV", "IV", "LI", "VC", "SOB"),
    }
)

NAMES: Mapping[str, str] = MappingProxyType(
    {
        "ARC": "aspect-ratio change",
        "ARV": "aspect-ratio variation",
        "BC": "background clutter",
        "CM": "camera motion",
        "DEF": "deformation",
        "FCM": "fast camera motion",
        "FM": "fast motion",
        "FOC": "full occlusion",
        "IPR": "in-plane rotation",
        "IV": "illumination variation",
        "LI": "low illumination",
        "LO": "large occlusion",
        "LR": "low resolution",
        "LTT": "long-term tracking",
        "MB": "motion blur",
        "OB": "object blur",
        "OCC": "occlusion",
        "OM": "object motion",
        "OPR": "out-of-plane rotation",
        "OV": "out of view",
        "POC": "partial occlusion",
        "SO": "small object",
        "SOA": "similar objects around",
        "SOB": "similar object",
        "SV": "scale variation",
        "VC": "viewpoint change",
    }
)


def by_attribute(of: Iterable[tuple[frozenset[str], Curves | None]]) -> dict[str, tuple[int, Curves]]:
    """For each attribute, in alphabetical order, the number of sequences that have it and the mean of their curves.

    `of` gives each sequence's attributes and its curves; sequences that could not be scored count for nothing.
    """
    known = [(names, found) for names, found in of if found is not None]
    result: dict[str, tuple[int, Curves]] = {}
    for name in sorted({n for names, _ in known for n in names}):
        having = [found for names, found in known if name in names]
        mean = mean_curves(having)
        if mean is not None:
            result[name] = (len(having), mean)
    return result
