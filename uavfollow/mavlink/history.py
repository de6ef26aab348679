"""The last second of a telemetry value, and the value at the time of an exposure in between."""

from __future__ import annotations

import bisect
import math

from control.frames import wrap_pi

# A picture is acted on up to 0.5 s after its exposure (control/supervisor.py), its telemetry must still be there.
KEPT_S = 1.5
# A straight line between reports further apart says little; the nearer report is taken as it is.
MAX_GAP_S = 0.5


class History:
    """Values (tuples of floats) with times that only grow; `angles` are the places in the tuple that wrap at pi."""

    def __init__(self, angles: tuple[int, ...] = ()) -> None:
        self._angles = frozenset(angles)
        self._times: list[float] = []
        self._values: list[tuple[float, ...]] = []

    def clear(self) -> None:
        """Forget everything."""
        self._times.clear()
        self._values.clear()

    def add(self, t_s: float, values: tuple[float, ...]) -> bool:
        """Keep a report; False, and nothing kept, when it is not finite or no newer than the last."""
        if not all(math.isfinite(v) for v in (t_s, *values)) or (self._times and t_s <= self._times[-1]):
            return False
        self._times.append(t_s)
        self._values.append(values)
        old = bisect.bisect_left(self._times, t_s - KEPT_S)
        del self._times[:old], self._values[:old]
        return True

    @property
    def last(self) -> tuple[float, tuple[float, ...]] | None:
        """The newest report with its time."""
        return (self._times[-1], self._values[-1]) if self._times else None

    def at(self, t_s: float) -> tuple[float, tuple[float, ...]] | None:
        """Time and values on the straight line between the two reports around `t_s`; None without any report.

        Outside of what is kept the nearest report is given, with its own time: nothing is extrapolated here.
        """
        if not self._times:
            return None
        after = bisect.bisect_left(self._times, t_s)
        if after == 0:
            return self._times[0], self._values[0]
        if after == len(self._times):
            return self._times[-1], self._values[-1]
        t0, t1 = self._times[after - 1], self._times[after]
        if t1 - t0 > MAX_GAP_S:
            nearer = after - 1 if t_s - t0 <= t1 - t_s else after
            return self._times[nearer], self._values[nearer]
        share = (t_s - t0) / (t1 - t0)
        return t_s, tuple(
            wrap_pi(a + share * wrap_pi(b - a)) if i in self._angles else a + share * (b - a)
            for i, (a, b) in enumerate(zip(self._values[after - 1], self._values[after], strict=True))
        )
