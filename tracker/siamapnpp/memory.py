"""How the target has looked: the first exemplar for ever, one recent, a few anchors. Replaced, never averaged."""

from __future__ import annotations

from collections import deque

from tracker.messages import Array, MemorySlot

MAX_ANCHORS = 3  # each is a look at a moment that mattered; more would let the oldest mistakes live longer


class ExemplarMemory:
    """Unit vectors of looks, all of one length."""

    def __init__(self) -> None:
        self._first: Array | None = None
        self._recent: Array | None = None
        self._anchors: deque[Array] = deque(maxlen=MAX_ANCHORS)

    def start(self, first: Array | None) -> None:
        """Forget everything and take the look of a new target; None: its looks are not to be had."""
        self._first, self._recent = first, None
        self._anchors.clear()

    @property
    def has_first(self) -> bool:
        """Whether there is anything to compare with."""
        return self._first is not None

    def keep(self, look: Array | None, slot: MemorySlot) -> None:
        """Put a look into a slot: in place of the one there, or of the oldest anchor. None: nothing to keep."""
        if look is None:
            return
        if slot is MemorySlot.RECENT:
            self._recent = look
        else:
            self._anchors.append(look)

    def likeness(self, look: Array | None) -> tuple[float | None, float | None]:
        """Cosines in [-1, 1] with the first exemplar and with the most alike of the rest; None: nothing to compare."""
        if look is None:
            return None, None
        others = [kept for kept in (self._recent, *self._anchors) if kept is not None]
        first = None if self._first is None else _cosine(look, self._first)
        return first, max((_cosine(look, kept) for kept in others), default=None)


def _cosine(a: Array, b: Array) -> float:
    return min(max(float(a @ b), -1.0), 1.0)
