"""Published results that are shown beside ours, never mixed with them."""

from __future__ import annotations

from dataclasses import dataclass

from tracker.benchmark.attributes import UAV20L, UAV123_10FPS
from tracker.benchmark.scores import Mode

SOURCE = "Table I of the SiamAPN++ paper, average over UAV20L and UAV123@10fps"
DATASETS = frozenset({UAV20L, UAV123_10FPS})
MODE = Mode.TOOLKIT
ATTRIBUTES = ("CM", "FM", "FOC", "POC", "SV")


@dataclass(frozen=True, slots=True)
class Published:
    """Precision at 20 px and success AUC of a tracker by attribute, in the order of `ATTRIBUTES`."""

    tracker: str
    p20: tuple[float, ...]
    auc: tuple[float, ...]

    def scores(self, attribute: str) -> tuple[float, float]:
        """AUC and precision for one attribute of the table. Raises ValueError for others."""
        index = ATTRIBUTES.index(attribute)
        return self.auc[index], self.p20[index]


TABLE_I = (
    Published("ECO", (0.630, 0.542, 0.457, 0.598, 0.621), (0.457, 0.344, 0.254, 0.427, 0.453)),
    Published("SiamFC", (0.626, 0.529, 0.487, 0.577, 0.614), (0.432, 0.319, 0.264, 0.385, 0.416)),
    Published("UDT", (0.512, 0.470, 0.413, 0.493, 0.513), (0.375, 0.303, 0.226, 0.350, 0.375)),
    Published("UDT+", (0.598, 0.521, 0.469, 0.581, 0.599), (0.424, 0.322, 0.259, 0.403, 0.418)),
    Published("CF2", (0.519, 0.384, 0.431, 0.499, 0.507), (0.374, 0.246, 0.233, 0.346, 0.364)),
    Published("CFNet", (0.533, 0.435, 0.407, 0.527, 0.542), (0.382, 0.244, 0.214, 0.365, 0.386)),
    Published("CoKCF", (0.525, 0.414, 0.418, 0.512, 0.520), (0.329, 0.210, 0.205, 0.309, 0.311)),
    Published("DSiam", (0.613, 0.536, 0.547, 0.579, 0.585), (0.404, 0.309, 0.301, 0.371, 0.387)),
    Published("TADT", (0.638, 0.597, 0.486, 0.612, 0.618), (0.474, 0.386, 0.281, 0.444, 0.461)),
    Published("KCC", (0.458, 0.348, 0.339, 0.457, 0.467), (0.320, 0.206, 0.172, 0.300, 0.320)),
    Published("DaSiamRPN", (0.667, 0.571, 0.505, 0.625, 0.656), (0.470, 0.365, 0.274, 0.427, 0.459)),
    Published("SiamFC++", (0.709, 0.622, 0.469, 0.669, 0.700), (0.544, 0.454, 0.292, 0.497, 0.540)),
    Published("SiamRPN++", (0.706, 0.624, 0.475, 0.655, 0.691), (0.530, 0.442, 0.284, 0.480, 0.521)),
    Published("SiamAPN", (0.721, 0.710, 0.520, 0.680, 0.715), (0.537, 0.493, 0.308, 0.493, 0.537)),
    Published("SiamAPN++", (0.742, 0.711, 0.577, 0.702, 0.729), (0.564, 0.507, 0.358, 0.519, 0.554)),
)
