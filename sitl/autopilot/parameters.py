"""The parameters that act in this simulation, with ArduCopter's 4.7 names, units and defaults."""

from __future__ import annotations

import math
from dataclasses import dataclass

# MAV_PARAM_TYPE
INT8, INT16, REAL32 = 2, 4, 9


@dataclass(frozen=True, slots=True)
class Parameter:
    """Default, type on the wire and range of one parameter."""

    name: str
    default: float
    kind: int = REAL32
    low: float = -1e9
    high: float = 1e9


TABLE: tuple[Parameter, ...] = (
    Parameter("BRK_DECEL_CMSS", 750.0, REAL32, 50.0, 2000.0),
    Parameter("DISARM_DELAY", 10, INT8, 0, 127),
    Parameter("FLTMODE1", 7, INT8, 0, 127),
    Parameter("FLTMODE2", 9, INT8, 0, 127),
    Parameter("FLTMODE3", 6, INT8, 0, 127),
    Parameter("FLTMODE4", 3, INT8, 0, 127),
    Parameter("FLTMODE5", 5, INT8, 0, 127),
    Parameter("FLTMODE6", 0, INT8, 0, 127),
    Parameter("FLTMODE_CH", 5, INT8, 0, 16),
    Parameter("FS_GCS_ENABLE", 0, INT8, 0, 7),
    Parameter("FS_GCS_TIMEOUT", 5.0, REAL32, 2.0, 120.0),
    Parameter("FS_THR_ENABLE", 1, INT8, 0, 7),
    Parameter("FS_THR_VALUE", 975, INT16, 910, 1100),
    Parameter("GUID_TIMEOUT", 3.0, REAL32, 0.1, 5.0),
    Parameter("LAND_ALT_LOW", 1000, INT16, 100, 10000),
    Parameter("LAND_SPEED", 50, INT16, 30, 200),
    Parameter("LOIT_SPEED", 1250.0, REAL32, 20.0, 3500.0),
    Parameter("MAV_GCS_SYSID", 255, INT16, 1, 255),
    Parameter("MAV_SYSID", 1, INT16, 1, 255),
    Parameter("MNT1_PITCH_MAX", 30, INT16, -90, 90),
    Parameter("MNT1_PITCH_MIN", -90, INT16, -90, 90),
    Parameter("MNT1_TYPE", 1, INT8, 0, 14),
    Parameter("MNT1_YAW_MAX", 180, INT16, -180, 180),
    Parameter("MNT1_YAW_MIN", -180, INT16, -180, 180),
    Parameter("PILOT_SPEED_DN", 0, INT16, 0, 500),
    Parameter("PILOT_SPEED_UP", 250, INT16, 50, 500),
    Parameter("PILOT_Y_RATE", 202.5, REAL32, 1.0, 360.0),
    Parameter("RC_OVERRIDE_TIME", 3.0, REAL32, -1.0, 120.0),
    Parameter("RTL_ALT", 1500, INT16, 200, 32000),
    Parameter("RTL_CONE_SLOPE", 3.0, REAL32, 0.0, 10.0),
    Parameter("RTL_LOIT_TIME", 5000, INT16, 0, 32000),
    Parameter("WPNAV_ACCEL", 250.0, REAL32, 50.0, 500.0),
    Parameter("WPNAV_ACCEL_Z", 100.0, REAL32, 50.0, 500.0),
    Parameter("WPNAV_SPEED", 1000.0, REAL32, 20.0, 2000.0),
    Parameter("WPNAV_SPEED_DN", 150.0, REAL32, 10.0, 500.0),
    Parameter("WPNAV_SPEED_UP", 250.0, REAL32, 10.0, 1000.0),
    Parameter("WP_YAW_BEHAVIOR", 2, INT8, 0, 3),
)


class Parameters:
    """Values by name, within their ranges. `overrides` sets values before the first flight.

    Raises ValueError for an override that is unknown or not finite.
    """

    __slots__ = ("_index", "_values")

    def __init__(self, overrides: dict[str, float] | None = None) -> None:
        self._index = {p.name: i for i, p in enumerate(TABLE)}
        self._values = {p.name: float(p.default) for p in TABLE}
        for name, value in (overrides or {}).items():
            if not self.set(name, value):
                raise ValueError(f"parameters: {name} = {value} is not a parameter of the simulated autopilot")

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def set(self, name: str, value: float) -> bool:
        """Store `value`, clamped to the range and rounded for integers; False if unknown or not finite."""
        index = self._index.get(name)
        if index is None or not math.isfinite(value):
            return False
        spec = TABLE[index]
        value = min(max(value, spec.low), spec.high)
        self._values[name] = float(round(value)) if spec.kind != REAL32 else value
        return True

    def find(self, name: str, index: int) -> int | None:
        """Position in the table by index or, when that is -1, by name; None if there is no such parameter."""
        if index >= 0:
            return index if index < len(TABLE) else None
        return self._index.get(name)
