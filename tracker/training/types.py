"""What the parts of the training hand to each other: pictures with a target, sources of them, batches of pairs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import torch

from tracker.box import Box
from tracker.messages import ImageU8

NAMED_PER_KIND = 3  # faults told in full; the rest is counted


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A picture with one target in it. `image_bgr_u8` is (H, W, 3); `box` in its pixels, may reach beyond the border.

    `fill_bgr` is what stands for the outside: the mean colour of the whole picture.
    """

    image_bgr_u8: ImageU8
    box: Box
    fill_bgr: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Track:
    """One target: the frame numbers in which it is (ascending; a still picture has one), its class, its picture.

    `group` names what it must not be called a stranger to: tracks of one still picture or of one video share it.
    """

    name: str
    frames: tuple[int, ...]
    label: str | None
    group: str


@dataclass(slots=True)
class Skipped:
    """What could not be used, by kind of fault: how many, and the first of each by name."""

    counts: Counter[str] = field(default_factory=Counter)
    named: dict[str, list[str]] = field(default_factory=dict)

    def add(self, kind: str, what: str) -> None:
        """Count one; `kind` is a short phrase (`unreadable image`), `what` names file and line."""
        self.counts[kind] += 1
        names = self.named.setdefault(kind, [])
        if len(names) < NAMED_PER_KIND and what not in names:
            names.append(what)

    def merge(self, other: Skipped) -> None:
        """Take over what another one counted."""
        self.counts.update(other.counts)
        for kind, names in other.named.items():
            mine = self.named.setdefault(kind, [])
            mine.extend(n for n in names[: NAMED_PER_KIND - len(mine)] if n not in mine)

    def lines(self) -> list[str]:
        """One line per kind: `12 unreadable image: a.jpg, b.jpg, c.jpg and 9 more`."""
        out = []
        for kind, count in sorted(self.counts.items()):
            names = self.named.get(kind, [])
            more = f" and {count - len(names)} more" if count > len(names) else ""
            out.append(f"{count} {kind}: {', '.join(names)}{more}")
        return out


class Source(Protocol):
    """Pictures with targets. Opened once, then read from any process: it holds paths and tables, no open files.

    `frame_range`: how many frame numbers apart exemplar and search may lie. `skipped`: rows found unusable on opening.
    """

    name: str
    frame_range: int
    tracks: Sequence[Track]
    skipped: Skipped

    def view(self, track: int, index: int) -> View | str:
        """The picture of `tracks[track].frames[index]`, or why it cannot be had (file and fault, one line)."""


@dataclass(frozen=True, slots=True, eq=False)
class Footage:
    """A whole sequence for validation: every frame in order, the truth of each (None where the target is absent)."""

    name: str
    truth: tuple[Box | None, ...]
    images: Sequence[ImageU8]  # reads on access; raises TrainingError for a picture that cannot be read


class FootageSource(Protocol):
    """Something that has whole sequences."""

    def footage(self) -> Sequence[Footage]:
        """All of them, in a fixed order."""


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Pairs of crops with labels, as the network takes them.

    `exemplar` (B, 3, 127, 127) and `search` (B, 3, S, S) uint8 BGR; `box` (B, 4) float32 x1, y1, x2, y2 of the target
    in search pixels from the crop's centre (as in `siamapnpp/decode.py`: its cell centres are 8 i - 80 for 21 cells);
    `negative` (B,) bool: there is no target in the search crop and `box` means nothing.
    """

    exemplar: torch.Tensor
    search: torch.Tensor
    box: torch.Tensor
    negative: torch.Tensor
    skipped: Skipped


class Batches(Protocol):
    """Batch number `step` of a stage: a pure function of seed, stage and step, so a resumed run draws the same.

    With several processes every one asks for its own rows of the same global batch.
    """

    def batch(self, step: int) -> Batch:
        """The rows of this process."""


def seed_of(*numbers: int) -> np.random.Generator:
    """A generator that depends on exactly these numbers (seed, stage, step, row)."""
    return np.random.default_rng(list(numbers))
