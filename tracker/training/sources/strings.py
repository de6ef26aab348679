"""Many short texts in one block of memory: a million Python strings would be copied into every worker process."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import overload

import numpy as np


class Strings(Sequence[str]):
    """A read-only sequence of texts, held as UTF-8 bytes and their ends."""

    def __init__(self, texts: Iterable[str] = ()) -> None:
        parts = [text.encode("utf-8", "surrogateescape") for text in texts]
        self._bytes = b"".join(parts)
        self._ends = np.cumsum([0, *map(len, parts)], dtype=np.int64)

    def __len__(self) -> int:
        return len(self._ends) - 1

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> list[str]: ...
    def __getitem__(self, index: int | slice) -> str | list[str]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        at = range(len(self))[index]
        return self._bytes[self._ends[at] : self._ends[at + 1]].decode("utf-8", "surrogateescape")
