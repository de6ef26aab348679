"""What the target was before its box collapsed.

A target that goes behind something is seen ever less: the box shrinks to what is left of it and slides along the edge,
at good scores, until it is lost. The estimate then has the size and the motion of the last visible strip. This memory
gives back the one from before.
"""

from __future__ import annotations

import math
from collections import deque

from tracker.agreement import TIME_EPS_S
from tracker.box import Box
from tracker.filter import FilterState

# A car of 5 m that goes behind an edge at walking pace takes longer; by then the remainder is what is tracked.
MEMORY_S = 1.5
MAX_STATES = 512  # more than any camera gives in that time; a clock that stands still must not fill the memory
# A target that drives away at 5 m/s from 20 m loses 0.25 of ln(size) per second at most for a short time; half as much
# again within a second is no distance.
COLLAPSE_LN_SIZE = 0.25
# What shrinks so fast is being covered: within SUDDEN_S one side loses a third, or both a quarter of ln(size).
SUDDEN_S = 0.4
SUDDEN_LN_SIDE = 0.4
# A box that first grows faster than this was wrong then, and what it loses again is no collapse.
GROWTH_LN_S = 0.25
# What is being covered looks less and less like itself; what turns or was measured too large hardly does.
INTACT_SHARE = 0.8
# Seen again, but so much smaller than before it was covered: still covered in part.
PARTIAL_LN_SIDE, PARTIAL_LN_SIZE = 0.3, 0.2
# Slower than this a coast of 1.5 s moves a quarter of the target; seen over less than MOVING_S it may be shake.
MOVING_SIZES_S, MOVING_S = 0.15, 0.3
# States this near to the largest size are before the collapse; the last of them is the freshest.
WHOLE_LN_SIZE = 0.04


class SizeMemory:
    """Filter states of the last `MEMORY_S` seconds, of times at which the target was seen.

    `places_hold`: the states were moved with the picture, so that their places are places in the present one.
    """

    def __init__(self) -> None:
        self._states: deque[FilterState] = deque(maxlen=MAX_STATES)
        self._sides: deque[tuple[float, float]] = deque(maxlen=MAX_STATES)  # ln of width and height, growing slowly
        self._looks: deque[float | None] = deque(maxlen=MAX_STATES)
        self.places_hold = False

    def clear(self) -> None:
        """Forget all, as for a new target."""
        for kept in (self._states, self._sides, self._looks):
            kept.clear()

    def add(self, state: FilterState, look: float | None = None) -> None:
        """Keep a state, and how alike the target looked then (None: not known)."""
        sides = float(state.x[2]), float(state.x[3])
        if self._states:
            grown = GROWTH_LN_S * max(state.t_s - self._states[-1].t_s, 0.0)
            (was_w, was_h), (now_w, now_h) = self._sides[-1], sides
            sides = min(now_w, was_w + grown), min(now_h, was_h + grown)
        self._states.append(state)
        self._sides.append(sides)
        self._looks.append(look)
        while self._states[0].t_s < state.t_s - MEMORY_S:
            for kept in (self._states, self._sides, self._looks):
                kept.popleft()

    def shift(self, dx_px: float, dy_px: float) -> None:
        """Move with the picture (ego-motion)."""
        self.places_hold = True
        for state in self._states:
            state.x[0] += dx_px
            state.x[1] += dy_px

    def collapses(self, box: Box, t_s: float, look: float | None = None) -> bool:
        """Whether a box of the time `t_s` would be a sudden collapse: slow shrinking is real, and is none.

        Nor is it one while it looks as much like itself (`look`) as before.
        """
        recent = [i for i, state in enumerate(self._states) if state.t_s >= t_s - SUDDEN_S]
        if not recent or not box.is_valid:
            return False
        looks = [known for i in recent if (known := self._looks[i]) is not None]
        if look is not None and looks and look > INTACT_SHARE * max(looks):
            return False
        lost_w = max(self._sides[i][0] for i in recent) - math.log(box.w_px)
        lost_h = max(self._sides[i][1] for i in recent) - math.log(box.h_px)
        return max(lost_w, lost_h) > SUDDEN_LN_SIDE or (lost_w + lost_h) / 2 > COLLAPSE_LN_SIZE

    def is_moving(self, until_s: float) -> bool:
        """Whether the centre moved, on the average of the states up to the time `until_s`."""
        states = [state for state in self._states if state.t_s <= until_s]
        if len(states) < 2 or states[-1].t_s - states[0].t_s < MOVING_S - TIME_EPS_S:
            return False
        way_px = math.hypot(*(states[-1].x[:2] - states[0].x[:2]))
        return way_px > MOVING_SIZES_S * math.exp(states[-1].ln_size) * (states[-1].t_s - states[0].t_s)

    def before_collapse(self) -> FilterState | None:
        """The last state before the box began to collapse; None when it has not."""
        if not self._states:
            return None
        sizes = [(ln_w + ln_h) / 2 for ln_w, ln_h in self._sides]
        largest = max(sizes)
        if largest - sizes[-1] < COLLAPSE_LN_SIZE:
            return None
        last = max(i for i, size in enumerate(sizes) if size >= largest - WHOLE_LN_SIZE)
        return self._states[last]


def is_partial(box: Box, whole: Box) -> bool:
    """Whether a box found is only a part of what the target was before it was covered."""
    lost_w, lost_h = math.log(whole.w_px / box.w_px), math.log(whole.h_px / box.h_px)
    return max(lost_w, lost_h) > PARTIAL_LN_SIDE or (lost_w + lost_h) / 2 > PARTIAL_LN_SIZE
