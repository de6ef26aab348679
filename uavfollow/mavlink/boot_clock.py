"""The autopilot's clock (time since its boot) in our monotonic seconds."""

from __future__ import annotations

import math
from collections import deque

# The offset of the reply with the shortest way there and back is the best; clocks drift, so only so many count.
KEPT_SAMPLES = 20
# Answers to requests older than this are of no use: the way back is unknown to a second.
MAX_ROUND_TRIP_S = 1.0
# An answer that took longer says that what comes over this link is old already.
QUICK_ROUND_TRIP_S = 0.3
# Messages may overtake each other by a little on a radio; a clock that goes back further was restarted.
REBOOT_BACKSTEP_S = 1.0
PERIOD_S = 1.0  # of TIMESYNC requests: twenty samples span 20 s, in which 50 ppm of drift are 1 ms


class BootClock:
    """Offset between the two clocks: by TIMESYNC where it is answered, else by the quickest messages.

    Without TIMESYNC the result is late by the shortest delay of the link, which is not known.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a reboot of the autopilot."""
        self._asked_ns: deque[int] = deque(maxlen=KEPT_SAMPLES)
        self._samples: deque[tuple[float, float]] = deque(maxlen=KEPT_SAMPLES)
        self._quickest_s: float | None = None
        self._newest_boot_s = -math.inf
        self.t_quick_answer_s = -math.inf

    def request(self, now_s: float) -> int:
        """`ts1` (ns) of a TIMESYNC request sent now; its answer is then recognised as ours."""
        now_ns = int(now_s * 1e9)
        self._asked_ns.append(now_ns)
        return now_ns

    def reply(self, tc1_ns: int, ts1_ns: int, now_s: float) -> bool:
        """Take a TIMESYNC answer; False, and nothing taken, when it answers someone else or came too late."""
        if ts1_ns not in self._asked_ns:
            return False
        self._asked_ns.remove(ts1_ns)
        round_trip_s = now_s - ts1_ns * 1e-9
        if not 0 <= round_trip_s <= MAX_ROUND_TRIP_S:
            return False
        if round_trip_s <= QUICK_ROUND_TRIP_S:
            self.t_quick_answer_s = now_s
        self._samples.append((round_trip_s, tc1_ns * 1e-9 - (ts1_ns * 1e-9 + round_trip_s / 2)))
        return True

    def heard(self, boot_s: float, now_s: float) -> bool:
        """Take the stamp of a message that has just come; False when the autopilot's clock went back: a reboot."""
        if boot_s < self._newest_boot_s - REBOOT_BACKSTEP_S:
            self.reset()
            self._newest_boot_s, self._quickest_s = boot_s, boot_s - now_s
            return False
        self._newest_boot_s = max(self._newest_boot_s, boot_s)
        lead_s = boot_s - now_s
        self._quickest_s = lead_s if self._quickest_s is None else max(self._quickest_s, lead_s)
        return True

    @property
    def offset_s(self) -> float | None:
        """Their clock minus ours; None before anything was heard."""
        return min(self._samples)[1] if self._samples else self._quickest_s

    def ours(self, boot_s: float, now_s: float) -> float:
        """A stamp of theirs on our clock, never later than now: what has come was not made in the future."""
        offset_s = self.offset_s
        return now_s if offset_s is None else min(boot_s - offset_s, now_s)
