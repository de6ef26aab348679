"""Wind: a mean and Gauss-Markov gusts, the same whatever the rate of the physics."""

from __future__ import annotations

import math
import random

Vector = tuple[float, float, float]

# Gusts are drawn on this grid and joined by straight lines, so that 200 Hz and 400 Hz physics see the same air.
GRID_S = 0.02

# Close to the ground the air moves up and down less than sideways (low-altitude Dryden model: about half).
VERTICAL_SHARE = 0.5


class Wind:
    """Wind at the vehicle over time, the velocity of the air in NED, m/s.

    `gust_sigma_m_s` is the standard deviation of the north and the east gust, `gust_time_s` their correlation time.
    `.at(t_s)` is a pure function of `seed` and time; `mirrored` flips the sign of east, mean and gusts alike. Raises
    ValueError for values that are not finite, a negative sigma or a correlation time that is not positive.
    """

    __slots__ = ("_decay", "_index", "_kick", "_mean", "_next", "_now", "_random", "_seed", "_side", "_sigma")

    def __init__(
        self,
        mean_ned_m_s: Vector = (0.0, 0.0, 0.0),
        gust_sigma_m_s: float = 0.0,
        gust_time_s: float = 2.0,
        seed: int = 0,
        mirrored: bool = False,
    ) -> None:
        if not all(math.isfinite(v) for v in (*mean_ned_m_s, gust_sigma_m_s, gust_time_s)):
            raise ValueError("wind: mean, gust_sigma_m_s and gust_time_s must be finite")
        if gust_sigma_m_s < 0.0 or gust_time_s <= 0.0:
            raise ValueError("wind: gust_sigma_m_s must be >= 0 and gust_time_s > 0")
        self._mean = mean_ned_m_s
        self._sigma = gust_sigma_m_s
        self._decay = math.exp(-GRID_S / gust_time_s)
        self._kick = gust_sigma_m_s * math.sqrt(1.0 - self._decay * self._decay)
        self._seed = seed
        self._side = -1.0 if mirrored else 1.0
        self._restart()

    def _restart(self) -> None:
        self._random = random.Random(self._seed)
        gauss, sigma = self._random.gauss, self._sigma
        self._now: Vector = (gauss(0.0, sigma), gauss(0.0, sigma), gauss(0.0, sigma * VERTICAL_SHARE))
        self._next = self._draw(self._now)
        self._index = 0

    def _draw(self, last: Vector) -> Vector:
        gauss, decay, kick = self._random.gauss, self._decay, self._kick
        return (
            decay * last[0] + gauss(0.0, kick),
            decay * last[1] + gauss(0.0, kick),
            decay * last[2] + gauss(0.0, kick * VERTICAL_SHARE),
        )

    def at(self, t_s: float) -> Vector:
        """Velocity of the air (north, east, down) at `t_s` >= 0; going back in time costs a replay from the start."""
        mean = self._mean
        if self._sigma == 0.0:
            return mean[0], self._side * mean[1], mean[2]
        place = t_s / GRID_S
        index = int(place)
        if index != self._index:
            self._seek(index)
        share = place - index
        now, then = self._now, self._next
        return (
            mean[0] + now[0] + share * (then[0] - now[0]),
            self._side * (mean[1] + now[1] + share * (then[1] - now[1])),
            mean[2] + now[2] + share * (then[2] - now[2]),
        )

    def _seek(self, index: int) -> None:
        if index < self._index:
            self._restart()
        while self._index < index:
            self._now, self._next = self._next, self._draw(self._next)
            self._index += 1
