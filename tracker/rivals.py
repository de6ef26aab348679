"""Things that look like the target, tracked beside it, so that motion can say later which was which.

When two that look alike cross, their responses melt into one, and what comes out of it goes to whoever looks better. So
everything that was seen together with the target, at another place and looking alike, gets a filter of its own. A
candidate that fits a rival's motion at least as well as the target's is not the target; where it fits both, nobody
knows, and the target coasts until they part (the idea of joint association, Bar-Shalom et al. 2011, in its least form).

A rival is born only in a step in which the target itself was seen elsewhere: two at the same time are two. So a target
that comes back from a coast can never be taken for its own rival.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from tracker.association import Judged, apart
from tracker.filter import BoxFilter, FilterConfig, check_range

MAX_RIVALS = 4  # more than so many alike are a crowd, in which motion tells nothing either


@dataclass(frozen=True, slots=True)
class RivalConfig:
    """Limits of `RivalTracks`.

    A rival is born at an appearance of `birth_share` of the target's, counts after `mature_s`, is kept up by candidates
    from `keep_appearance` on, and forgotten `forget_s` after it was last seen. A candidate is ambiguous when the
    likelihoods by both motions differ by less than a factor of `clear_ratio`.
    """

    birth_share: float = 0.6
    keep_appearance: float = 0.3
    mature_s: float = 0.1
    forget_s: float = 1.0
    clear_ratio: float = 3.0

    def __post_init__(self) -> None:
        """Check every range. Raises ValueError naming field, value and range."""
        for name, low, high in (
            ("birth_share", 0.0, 1.0),
            ("keep_appearance", 0.0, 1.0),
            ("mature_s", 0.0, 10.0),
            ("forget_s", 0.0, 60.0),
            ("clear_ratio", 1.0, 1e6),
        ):
            check_range("rivals", name, getattr(self, name), low, high)


@dataclass(slots=True)
class _Rival:
    estimate: BoxFilter
    born_s: float
    seen_s: float


class RivalTracks:
    """Never raises in the loop."""

    def __init__(self, config: RivalConfig | None = None, filter_config: FilterConfig | None = None) -> None:
        self._config = config or RivalConfig()
        self._filter_config = filter_config
        self._rivals: list[_Rival] = []
        self._t_s = -math.inf

    def clear(self) -> None:
        """Forget all, as for a new target."""
        self._rivals, self._t_s = [], -math.inf

    def shift(self, dx_px: float, dy_px: float) -> None:
        """Move with the picture (ego-motion)."""
        for rival in self._rivals:
            rival.estimate.shift(dx_px, dy_px)

    def predict(self, t_s: float) -> None:
        """Move all to the time of the next picture, and forget who was not seen for long."""
        self._t_s = t_s
        self._rivals = [r for r in self._rivals if t_s - r.seen_s <= self._config.forget_s]
        for rival in self._rivals:
            rival.estimate.predict(t_s)

    def unclaimed(self, judged: Sequence[Judged], target: BoxFilter) -> list[Judged]:
        """Those candidates that are more probably the target than any rival, clearly."""
        return [j for j in judged if not self._claimed(j, target)]

    def step(self, judged: Sequence[Judged], chosen: Judged | None, sure: bool) -> None:
        """Give what was not chosen to the rivals; new ones are born beside a target that was seen for `sure`."""
        left = [j for j in judged if j is not chosen and (chosen is None or apart(j, chosen))]
        left.sort(key=lambda j: -j.appearance)
        for one in left:
            if one.appearance < self._config.keep_appearance or self._keep(one):
                continue
            if sure and chosen is not None and self._is_alike(one, chosen) and len(self._rivals) < MAX_RIVALS:
                estimate = BoxFilter(self._filter_config)
                estimate.start(one.candidate.box, self._t_s)
                self._rivals.append(_Rival(estimate, self._t_s, self._t_s))

    def _is_alike(self, one: Judged, chosen: Judged) -> bool:
        return one.appearance >= self._config.birth_share * chosen.appearance

    def _keep(self, one: Judged) -> bool:
        """Whether a candidate belongs to a rival that was not yet seen in this step; it is then updated."""
        free = [r for r in self._rivals if r.seen_s < self._t_s]
        best = max(free, key=lambda r: _fit(r.estimate, one), default=None)
        if best is None or not best.estimate.update(one.candidate.box, one.appearance).accepted:
            return False
        best.seen_s = self._t_s
        return True

    def _claimed(self, one: Judged, target: BoxFilter) -> bool:
        own = _fit(target, one)
        mature = (r for r in self._rivals if r.seen_s - r.born_s >= self._config.mature_s)
        return any(_fit(r.estimate, one) > own - math.log(self._config.clear_ratio) for r in mature)


def _fit(estimate: BoxFilter, one: Judged) -> float:
    """Log-likelihood of a candidate by a filter's motion; minus infinity outside of its gate."""
    box = one.candidate.box
    if not estimate.innovation(box, one.appearance).accepted:
        return -math.inf
    return estimate.log_likelihood(box, one.appearance)
