"""How the target has looked: the first exemplar for ever, one recent, a few anchors. Replaced, never averaged."""

from __future__ import annotations

from collections import deque

from tracker.messages import Array, MemorySlot
from tracker.siamapnpp.colour import similarity

MAX_ANCHORS = 3  # each is a look at a moment that mattered; more would let the oldest mistakes live longer


class _Kept:
    """Unit vectors of one kind, by slot."""

    def __init__(self, first: Array | None) -> None:
        self.first = first
        self._recent: Array | None = None
        self._anchors: deque[Array] = deque(maxlen=MAX_ANCHORS)

    def keep(self, vector: Array, slot: MemorySlot) -> None:
        if slot is MemorySlot.RECENT:
            self._recent = vector
        else:
            self._anchors.append(vector)

    @property
    def others(self) -> list[Array]:
        return [kept for kept in (self._recent, *self._anchors) if kept is not None]


class ExemplarMemory:
    """Unit vectors of looks (deep features) and of colours (`tracker/siamapnpp/colour.py`), each of one length."""

    def __init__(self) -> None:
        self._looks, self._colours = _Kept(None), _Kept(None)

    def start(self, first: Array | None, colour: Array | None = None) -> None:
        """Forget everything and take look and colours of a new target; None: they are not to be had."""
        self._looks, self._colours = _Kept(first), _Kept(colour)

    @property
    def has_first(self) -> bool:
        """Whether there is any look to compare with."""
        return self._looks.first is not None

    def keep(self, look: Array | None, slot: MemorySlot, colour: Array | None = None) -> None:
        """Put look and colours into a slot: in place of what is there, or of the oldest anchor. None: not kept."""
        if look is not None:
            self._looks.keep(look, slot)
        if colour is not None:
            self._colours.keep(colour, slot)

    def likeness(self, look: Array | None) -> tuple[float | None, float | None]:
        """Cosines in [-1, 1] with the first exemplar and with the most alike of the rest; None: nothing to compare."""
        if look is None:
            return None, None
        first = None if self._looks.first is None else _cosine(look, self._looks.first)
        return first, max((_cosine(look, kept) for kept in self._looks.others), default=None)

    def colour_likeness(self, colour: Array | None) -> float | None:
        """Similarity in [0, 1] with the most alike of the colours kept; None: the first are not known."""
        if colour is None or self._colours.first is None:
            return None
        return max(similarity(colour, kept) for kept in (self._colours.first, *self._colours.others))


def _cosine(a: Array, b: Array) -> float:
    return min(max(float(a @ b), -1.0), 1.0)
