"""The sources of a recipe and how often each is drawn from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tracker.training.errors import TrainingError
from tracker.training.recipe import AnySource
from tracker.training.sources.opening import Injected, open_source
from tracker.training.types import Source


@dataclass(frozen=True, slots=True, eq=False)
class Mix:
    """Opened sources and their shares of the pairs, which sum to 1."""

    sources: tuple[Source, ...]
    shares: npt.NDArray[np.float64]


def open_mix(
    sources: Sequence[AnySource], root: Path, injected: Mapping[str, Injected], reserved: frozenset[str]
) -> Mix:
    """All sources of a recipe. Raises TrainingError naming the source by its place in the recipe (`sources.0`)."""
    opened = []
    for place, spec in enumerate(sources):
        try:
            opened.append(open_source(spec, root, injected, reserved))
        except TrainingError as error:
            raise TrainingError(f"sources.{place} ({spec.kind}): {error}") from error
    twice = [name for name, count in Counter(source.name for source in opened).items() if count > 1]
    if twice:
        raise TrainingError(f"sources: more than one is called {', '.join(twice)}; give them a name each")
    shares = np.array([spec.share for spec in sources], np.float64)
    return Mix(tuple(opened), shares / shares.sum())
