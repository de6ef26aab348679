"""Which boxes and which sequences of a source are used."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tracker.config.errors import suggestion
from tracker.training.errors import TrainingError
from tracker.training.recipe import SourceBase
from tracker.training.types import Skipped

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Limits:
    """What a target must be like, in pixels and as a share of its picture."""

    min_side_px: float
    max_aspect: float
    max_area_share: float

    @classmethod
    def of(cls, spec: SourceBase) -> Limits:
        """Those of a recipe's source."""
        return cls(spec.min_side_px, spec.max_aspect, spec.max_area_share)

    @property
    def kinds(self) -> tuple[str, str, str]:
        """What each fault is called."""
        return (
            f"box below min_side_px {self.min_side_px:g}",
            f"box thinner than max_aspect {self.max_aspect:g}",
            f"box above max_area_share {self.max_area_share:g}",
        )

    def broken(self, size_px: Floats, area_share: Floats) -> npt.NDArray[np.int64]:
        """(N,) which limit a box breaks: an index into `kinds`, -1 for none. What is NaN is not judged.

        `size_px` (N, 2) width and height; `area_share` (N,) of the picture.
        """
        low, high = size_px.min(axis=1), size_px.max(axis=1)
        faults = [low < self.min_side_px, high > self.max_aspect * low, area_share > self.max_area_share]
        return np.select(faults, [0, 1, 2], default=-1)


class Choice:
    """Which sequences a source may use, by name: `only` and `exclude` of the recipe, never one for validation."""

    def __init__(self, spec: SourceBase, reserved: frozenset[str], skipped: Skipped) -> None:
        self._only, self._exclude, self._reserved = frozenset(spec.only), frozenset(spec.exclude), reserved
        self._skipped = skipped
        self._seen: set[str] = set()
        self._some: str | None = None
        self._used, self._excluded, self._kept_back = 0, 0, 0

    def admits(self, name: str) -> bool:
        """Is this sequence used? To be asked once for each; what is left out for validation is counted."""
        self._some = self._some or name
        if name in self._only or name in self._exclude:
            self._seen.add(name)
        if self._only and name not in self._only:
            return False
        if name in self._exclude:
            self._excluded += 1
            return False
        if name in self._reserved:
            self._kept_back += 1
            self._skipped.add("reserved for validation", name)
            return False
        self._used += 1
        return True

    def close(self, where: str, known: Iterable[str] = ()) -> None:
        """After the last one. A name in `exclude` that is nowhere is counted.

        Raises TrainingError for a name in `only` that is nowhere, and when `exclude` leaves nothing.
        """
        for name in sorted(self._only - self._seen):
            example = f"; a name looks like {self._some}" if self._some else ""
            raise TrainingError(f"{where}: only: there is no sequence {name}{suggestion(name, known) or example}")
        for name in sorted(self._exclude - self._seen):
            self._skipped.add("name in exclude that is not there", name)
        if self._excluded and not self._used:
            most = "all sequences of only" if self._only else "all sequences"
            but = f" but the {self._kept_back} that validation uses" if self._kept_back else ""
            raise TrainingError(f"{where}: exclude: {most}{but} were excluded ({self._excluded}); leave some in")
