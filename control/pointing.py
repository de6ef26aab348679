"""Where the camera pointed at exposure, and how fast the target moves in the gimbal's base."""

from __future__ import annotations

import math

from control.frames import wrap_pi
from control.line_of_sight import joint_rate
from control.messages import GimbalState
from tracker.messages import Array

# Reports or frames further apart than this say nothing of the rate now (five missing reports at 10 Hz).
MAX_GAP_S = 0.5
# Reports or frames closer than this came bunched: their difference is quantisation, not a rate (100 Hz is fast enough).
MIN_GAP_S = 0.01
# Exposure and nearest report lie at most this far apart at 5 Hz reports; a line drawn further is a guess.
MAX_EXTRAPOLATION_S = 0.2


class PointingTrack:
    """The last two reports of a gimbal, and the straight line through them."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the reports, as after a change of the yaw frame."""
        self._last: GimbalState | None = None
        self._rate = (0.0, 0.0)

    def update(self, gimbal: GimbalState) -> None:
        """Take a report, which must be finite. One seen before changes nothing: reports may be slower than the loop."""
        last, self._last = self._last, gimbal
        if last is None:
            return
        dt_s = gimbal.t_s - last.t_s
        if 0 <= dt_s < MIN_GAP_S:
            self._last = last if dt_s == 0 else gimbal
            return
        if not 0 < dt_s <= MAX_GAP_S:
            self._rate = (0.0, 0.0)
            return
        self._rate = ((gimbal.pitch_rad - last.pitch_rad) / dt_s, wrap_pi(gimbal.yaw_rad - last.yaw_rad) / dt_s)

    def at(self, t_s: float) -> tuple[float, float]:
        """Pitch and yaw (rad) at a time near the last report. (0, 0), the base's axes, before the first report."""
        if self._last is None:
            return 0.0, 0.0
        ahead_s = min(max(t_s - self._last.t_s, -MAX_EXTRAPOLATION_S), MAX_EXTRAPOLATION_S)
        pitch_rad = self._last.pitch_rad + self._rate[0] * ahead_s
        return min(max(pitch_rad, -math.pi / 2), math.pi / 2), wrap_pi(self._last.yaw_rad + self._rate[1] * ahead_s)


class TargetRate:
    """Elevation and azimuth rate (rad/s) of the target in the gimbal's base, through a low-pass of `filter_s`.

    `max_rate_rad_s` bounds each measurement before the low-pass, so that one wrong box moves the result little.
    """

    def __init__(self, filter_s: float, max_rate_rad_s: float) -> None:
        self._filter_s = filter_s
        self._max_rate_rad_s = max_rate_rad_s
        self.reset()

    def reset(self) -> None:
        """Start again from rest."""
        self._last: tuple[float, Array] | None = None
        self.rate_rad_s = (0.0, 0.0)

    def update(self, t_s: float, sight: Array, measured_rad_s: tuple[float, float] | None = None) -> None:
        """Take the line of sight (3,), base axes, of the frame at `t_s`; the same frame again, or one that follows it
        within `MIN_GAP_S`, changes nothing.

        `measured_rad_s` (elevation, azimuth) is used when it is known; else the difference to the last frame.
        After a gap, or when time ran back, the rate is zero.
        """
        last = self._last
        if last is not None and 0 <= t_s - last[0] < MIN_GAP_S:
            return
        self._last = (t_s, sight)
        if last is None or not 0 < t_s - last[0] <= MAX_GAP_S:
            self.rate_rad_s = (0.0, 0.0)
            return
        dt_s = t_s - last[0]
        measured = measured_rad_s or joint_rate(sight, (sight - last[1]) / dt_s, (0.0, 0.0), 0.0)
        share = 1.0 if self._filter_s == 0 else -math.expm1(-dt_s / self._filter_s)
        elevation, azimuth = (
            old + share * (min(max(new, -self._max_rate_rad_s), self._max_rate_rad_s) - old)
            for old, new in zip(self.rate_rad_s, measured, strict=True)
        )
        self.rate_rad_s = (elevation, azimuth)
