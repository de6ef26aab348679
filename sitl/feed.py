"""From the shutter to the application: latency, jitter, lost pictures, and only the newest one counts."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random

from sitl.scene import CameraPose, Vector


@dataclass(frozen=True, slots=True)
class Exposure:
    """What was true when the shutter opened. `scene_s` is the world's time, `t_s` that of the run."""

    seq: int
    t_s: float
    scene_s: float
    available_s: float
    pose: CameraPose
    vehicle_pos_ned_m: Vector
    vehicle_vel_ned_m_s: Vector
    vehicle_yaw_rad: float


class CameraFeed:
    """A one-place mailbox behind a delay. The same seed delays and loses the same pictures; `exposed` counts all."""

    def __init__(self, latency_s: float, jitter_s: float, drop_share: float, seed: int) -> None:
        self._latency_s = latency_s
        self._jitter_s = jitter_s
        self._drop_share = drop_share
        self._random = Random(seed)
        self._on_the_way: list[Exposure] = []
        self._last_s = 0.0
        self._arrived: Exposure | None = None
        self.exposed = 0

    def next_exposure(self, t_s: float) -> tuple[int, float | None]:
        """Number of the picture exposed at `t_s`, and when it arrives; None when it is lost. Call it once for each."""
        seq = self.exposed
        self.exposed += 1
        late_s = abs(self._random.gauss(0.0, self._jitter_s)) if self._jitter_s > 0 else 0.0
        if self._random.random() < self._drop_share:
            return seq, None
        self._last_s = max(t_s + self._latency_s + late_s, self._last_s)  # pictures do not overtake each other
        return seq, self._last_s

    def put(self, exposure: Exposure) -> None:
        """Send an exposure on its way."""
        self._on_the_way.append(exposure)

    def newest(self, now_s: float) -> Exposure | None:
        """Take the newest picture that has arrived; older ones are dropped. None when nothing new is there."""
        arrived = [e for e in self._on_the_way if e.available_s <= now_s]
        if not arrived:
            return None
        self._on_the_way = [e for e in self._on_the_way if e.available_s > now_s]
        self._arrived = arrived[-1]
        return arrived[-1]

    def on_screen(self, now_s: float) -> Exposure | None:
        """The picture that an operator looks at: the newest that has arrived, taken up before or not."""
        return self.newest(now_s) or self._arrived
