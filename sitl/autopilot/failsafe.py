"""Failsafes: radio and ground station."""

from __future__ import annotations

from sitl.autopilot.modes import Mode
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.rc import RcInput, Signal

# FS_GCS_ENABLE and FS_THR_ENABLE: 1 returns to launch, these land; every other modelled value returns too.
GCS_LAND = 5
THROTTLE_LAND = 3


class Failsafes:
    """What is pending. `check` is called in every tick and returns the modes that have just been asked for."""

    __slots__ = ("_parameters", "_rc", "gcs", "gcs_heard_at_s", "radio")

    def __init__(self, parameters: Parameters, rc: RcInput) -> None:
        self._parameters = parameters
        self._rc = rc
        self.radio = False
        self.gcs = False
        self.gcs_heard_at_s: float | None = None

    @property
    def pending(self) -> bool:
        """Any failsafe: HEARTBEAT says CRITICAL."""
        return self.radio or self.gcs

    def check_radio(self, t_s: float) -> Mode | None:
        """Throttle below FS_THR_VALUE or no receiver: RTL or LAND, once; its return changes no mode."""
        parameters = self._parameters
        if parameters["FS_THR_ENABLE"] == 0:
            self.radio = False
            return None
        throttle = self._rc.throttle_us(t_s)
        bad = self._rc.signal(t_s) is Signal.LOST or throttle < parameters["FS_THR_VALUE"]
        began, self.radio = bad and not self.radio, bad
        if not began:
            return None
        return Mode.LAND if parameters["FS_THR_ENABLE"] == THROTTLE_LAND else Mode.RTL

    def check_gcs(self, t_s: float) -> Mode | None:
        """The heartbeat of MAV_GCS_SYSID, once heard, stays away for FS_GCS_TIMEOUT."""
        parameters = self._parameters
        if parameters["FS_GCS_ENABLE"] == 0 or self.gcs_heard_at_s is None:
            self.gcs = False
            return None
        bad = t_s - self.gcs_heard_at_s > parameters["FS_GCS_TIMEOUT"]
        began, self.gcs = bad and not self.gcs, bad
        if not began:
            return None
        return Mode.LAND if parameters["FS_GCS_ENABLE"] == GCS_LAND else Mode.RTL
