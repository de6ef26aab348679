"""Things that look like the target, tracked beside it, so that motion can say later which was which.

When two that look alike cross, their responses melt into one, and what comes out of it goes to whoever looks better. So
everything that was seen together with the target, at another place and looking alike, gets a filter of its own. A
candidate that fits a rival's motion at least as well as the target's is not the target; where it fits both, nobody
knows, and the target coasts until they part (the idea of joint association, Bar-Shalom et al. 2011, in its least form).

A rival is born only in a step in which the target itself was seen elsewhere: two at the same time are two. Only after a
false lock that is not so; then all are forgotten.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from tracker.association import Judged, apart
from tracker.filter import BoxFilter, FilterConfig, check_range

CLAIM_NIS = 9.49  # chi-square, 4 degrees of freedom, 95 %: what a rival does less often than once in 20 is not it
BIRTH_SIZES = 1.0  # nearer than its own size a second peak may be the target's own
MERGED_S = 0.5  # two that cross hide each other for about as long
SAME_SIZES = 0.4  # a rival predicted so near to the target, and not seen elsewhere, is the target
MAX_RIVALS = 4  # more than so many alike are a crowd, in which motion tells nothing either


@dataclass(frozen=True, slots=True)
class RivalConfig:
    """Limits of `RivalTracks`.

    A rival is born at an appearance of `birth_share` of the target's, is kept up by candidates from `keep_appearance`
    on, and forgotten `forget_s` after it was last seen. A candidate is the target's only when it is more probable by
    the target's motion than by the rival's by a factor of `clear_ratio`. A rival is established when it was seen beside
    the target for `established_s`.
    """

    birth_share: float = 0.6
    keep_appearance: float = 0.3
    forget_s: float = 1.0
    established_s: float = 0.3
    clear_ratio: float = 3.0

    def __post_init__(self) -> None:
        """Check every range. Raises ValueError naming field, value and range."""
        for name, low, high in (
            ("birth_share", 0.0, 1.0),
            ("keep_appearance", 0.0, 1.0),
            ("forget_s", 0.0, 60.0),
            ("established_s", 0.0, 60.0),
            ("clear_ratio", 1.0, 1e6),
        ):
            check_range("rivals", name, getattr(self, name), low, high)


@dataclass(slots=True)
class _Rival:
    estimate: BoxFilter
    seen_s: float
    beside_s: float = 0.0  # for how long it was seen together with the target


class RivalTracks:
    """Never raises in the loop."""

    def __init__(self, config: RivalConfig | None = None, filter_config: FilterConfig | None = None) -> None:
        self._config = config or RivalConfig()
        self._filter_config = filter_config
        self._rivals: list[_Rival] = []
        self._claims: list[tuple[_Rival, Judged]] = []
        self._t_s = -math.inf

    def clear(self) -> None:
        """Forget all, as for a new target."""
        self._rivals, self._claims, self._t_s = [], [], -math.inf

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

    def unclaimed(self, judged: Sequence[Judged], target: BoxFilter, locked: bool) -> list[Judged]:
        """Those candidates that are not a rival. Each rival is one candidate at most: the one that fits it best.

        While the target itself is not seen (`locked` False), only who was long seen beside it counts: a part of the
        target, or the target beside something that was taken for it, must not be shut out.
        """
        left = list(judged)
        self._claims = []
        for rival in self._rivals:
            if not locked and rival.beside_s < self._config.established_s:
                continue
            able = (j for j in left if j.appearance >= self._config.keep_appearance)
            seen = [j for j in able if _likely(rival.estimate, j)]
            best = max(seen, key=partial(_fit, rival.estimate), default=None)
            if best is None:
                continue
            if _fit(rival.estimate, best) > _fit(target, best) - math.log(self._config.clear_ratio):
                self._claims.append((rival, best))
                left.remove(best)
        return left

    def step(self, judged: Sequence[Judged], chosen: Judged | None, sure: bool) -> None:
        """Follow the rivals; new ones are born beside a target that was seen for `sure`."""
        for rival, one in self._claims:
            if rival.estimate.update(one.candidate.box, one.appearance).accepted:
                if sure and chosen is not None and apart(one, chosen):
                    rival.beside_s += self._t_s - rival.seen_s
                rival.seen_s = self._t_s
        if chosen is None:
            return
        # Who was not seen for a while where the target is now seen was the target all along.
        self._rivals = [r for r in self._rivals if self._is_other(r, chosen)]
        claimed = [one for _, one in self._claims]
        for one in sorted(judged, key=lambda j: -j.appearance):
            if sure and one not in claimed and apart(one, chosen, BIRTH_SIZES) and len(self._rivals) < MAX_RIVALS:
                self._bear(one, chosen)

    def _is_other(self, rival: _Rival, chosen: Judged) -> bool:
        return self._t_s - rival.seen_s < MERGED_S or not _same_place(rival.estimate, chosen)

    def _bear(self, one: Judged, chosen: Judged) -> None:
        if one.appearance < max(self._config.birth_share * chosen.appearance, self._config.keep_appearance):
            return
        estimate = BoxFilter(self._filter_config)
        estimate.start(one.candidate.box, self._t_s)
        self._rivals.append(_Rival(estimate, self._t_s))


def _same_place(estimate: BoxFilter, one: Judged) -> bool:
    rival, box = estimate.box, one.candidate.box
    return math.hypot(rival.cx_px - box.cx_px, rival.cy_px - box.cy_px) < SAME_SIZES * math.sqrt(box.w_px * box.h_px)


def _fit(estimate: BoxFilter, one: Judged) -> float:
    """Log-likelihood of a candidate by a filter's motion."""
    return estimate.log_likelihood(one.candidate.box, one.appearance)


def _likely(estimate: BoxFilter, one: Judged) -> bool:
    nis = estimate.innovation(one.candidate.box, one.appearance).nis
    return nis is not None and nis <= CLAIM_NIS
