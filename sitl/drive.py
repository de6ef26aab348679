"""What the simulator drives: an application behind frames (or candidates) and a byte link.

The simulator knows nothing of the application but this (`uavfollow.sim` implements it) and a `ByteLink`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from sitl.measure import MeasuredBox
from tracker.box import Box

Image = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """One exposure as it reaches the application: a picture, or what a tracker would have found in it.

    Exactly one of `image_bgr_u8` (H, W, 3) and `candidates` is given. Times are simulated seconds.
    """

    seq: int
    t_capture_s: float
    t_receive_s: float
    image_bgr_u8: Image | None = None
    candidates: tuple[MeasuredBox, ...] | None = None


@dataclass(frozen=True, slots=True)
class Decision:
    """What the application reported for one exposure. Statuses and reasons are the application's words.

    `record` is the application's own full record, carried for its own files and not looked at here.
    """

    status: str
    reason: str
    box: Box | None
    confidence: float
    v_ned_m_s: tuple[float, float, float]
    yaw_rate_rad_s: float
    command_reason: str
    gimbal_rate_rad_s: tuple[float, float]
    gimbal_reason: str
    may_fly: bool
    flight_reason: str
    fault: str | None
    record: Any = None


class Application(Protocol):
    """The application beside the simulated autopilot; time is an argument everywhere."""

    def poll(self, now_s: float) -> None:
        """Read the link and send what is due."""

    def select(self, seen: Seen, box: Box, now_s: float) -> Decision:
        """The operator marked `box` in this picture. Raises ValueError when it cannot be selected."""

    def searched_px(self, t_capture_s: float) -> tuple[tuple[float, float], ...]:
        """Centres of the windows searched in the picture of that time; empty when nothing is selected."""

    def searches(self, t_capture_s: float) -> int:
        """How many network calls the picture of that time will take: each takes its time."""

    def see(self, seen: Seen, now_s: float) -> Decision:
        """Take up one exposure; `now_s` is when its processing is done."""

    def start_following(self, now_s: float) -> str:
        """The operator starts following; returns the reason of the answer."""

    def stop_following(self, now_s: float) -> None:
        """The operator ends following."""

    def close(self, now_s: float) -> None:
        """End in order."""
