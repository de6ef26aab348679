"""Which two views make a pair, and batches of pairs made on the host: a pure function of seed, stage, step and row."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt
import torch

from tracker.box import Box
from tracker.siamapnpp.crop import EXEMPLAR_PX
from tracker.training.augment.plan import Plan, draw_plan
from tracker.training.augment.render import render_pair
from tracker.training.errors import TrainingError
from tracker.training.recipe import Pairing, Recipe, Stage
from tracker.training.sources.faults import kind_of
from tracker.training.sources.mix import Mix
from tracker.training.types import Batch, Skipped, View, seed_of

MISSES_IN_A_ROW = 20  # one fault is an accident, so many in a row mean that a source has gone
TRIES_FOR_A_STRANGER = 16  # enough unless nearly all tracks are of one group
PLAN_STREAM = 1 << 31  # beyond every row number: the plan's generator is none of the rows'
PATCH_WIDTH_SHARE = (0.06, 0.35)  # of the picture's width, as in the trials that made the embedded weights
PATCH_LOG_ASPECT = 0.7
PATCH_MAX_HEIGHT_SHARE = 0.6

Got = TypeVar("Got")


@dataclass(frozen=True, slots=True)
class Pick:
    """Two views by number. `negative`: the search crop is about a stranger. `patch`: seed of a box that is the target
    of both crops instead of the track's (the two views are then the same)."""

    source: int
    track: int
    exemplar_index: int
    search_source: int
    search_track: int
    search_index: int
    negative: bool = False
    patch: int | None = None


@dataclass(frozen=True, slots=True)
class Fault:
    """A view that cannot be had: the source's name, and what its `view` said: file and fault in one line."""

    source: str
    what: str


class Buckets:
    """Tracks of one source by class or by group: for N tracks arrays of int32, not N lists."""

    def __init__(self, keys: Iterable[str | None], count: int) -> None:
        codes: dict[str, int] = {}
        self._code = np.fromiter((-1 if k is None else codes.setdefault(k, len(codes)) for k in keys), np.int32, count)
        self._order = np.argsort(self._code, kind="stable").astype(np.int32)
        self._first = np.searchsorted(self._code[self._order], np.arange(len(codes) + 1))

    def __len__(self) -> int:
        return len(self._first) - 1

    def __getitem__(self, bucket: int) -> npt.NDArray[np.int32]:
        """Numbers of the tracks of a bucket."""
        return self._order[self._first[bucket] : self._first[bucket + 1]]

    def of(self, track: int) -> npt.NDArray[np.int32]:
        """Numbers of all tracks in the bucket of one (its own too); empty when it is in none."""
        code = int(self._code[track])
        return self._order[0:0] if code < 0 else self[code]


class Picker:
    """Draws pairs from a mix. Holds no generator; the table of classes is built when it is first needed."""

    def __init__(self, mix: Mix, pairing: Pairing) -> None:
        self.mix, self.pairing = mix, pairing
        self._edges = np.cumsum(mix.shares)
        self._groups = [Buckets((t.group for t in s.tracks), len(s.tracks)) for s in mix.sources]
        self._kin: dict[int, Buckets] = {}

    def pick(self, rng: np.random.Generator) -> Pick:
        """One pair: source by share, then picture or video, track in it and frame uniform, search frame within reach.

        So a crowded picture does not count for more than one with a single target, as in the published training.

        A distractor is a track of the same class, of the same source and another group: in the exemplar's own picture
        or video the true target may stand beside it, and `no target here` would be a lie. Without one it is any
        stranger; where all is of one group the pair stays a positive one.
        """
        source, number, index = self._any(rng)
        track = self.mix.sources[source].tracks[number]
        chance, shares = rng.random(), self.pairing
        if chance < shares.negative + shares.distractor:
            other = self._kindred(rng, source, number, track.group) if chance >= shares.negative else None
            other = other or self._stranger(rng, track.group)
            if other is not None:
                return Pick(source, number, index, *other, negative=True)
        elif chance < shares.negative + shares.distractor + shares.patch:
            return Pick(source, number, index, source, number, index, patch=int(rng.integers(2**31)))
        reach = self.mix.sources[source].frame_range
        low = bisect_left(track.frames, track.frames[index] - reach)
        high = bisect_right(track.frames, track.frames[index] + reach)
        return Pick(source, number, index, source, number, int(rng.integers(low, high)))

    def _any(self, rng: np.random.Generator) -> tuple[int, int, int]:
        source = int(np.searchsorted(self._edges, rng.random() * self._edges[-1], side="right"))
        source = min(source, len(self._edges) - 1)  # a product may round up to the last edge
        tracks = self.mix.sources[source].tracks
        groups = self._groups[source]
        members = groups[int(rng.integers(len(groups)))]
        track = int(members[rng.integers(len(members))])
        return source, track, int(rng.integers(len(tracks[track].frames)))

    def _stranger(self, rng: np.random.Generator, group: str) -> tuple[int, int, int] | None:
        for _ in range(TRIES_FOR_A_STRANGER):
            source, track, index = self._any(rng)
            if self.mix.sources[source].tracks[track].group != group:
                return source, track, index
        return None

    def _kindred(self, rng: np.random.Generator, source: int, track: int, group: str) -> tuple[int, int, int] | None:
        tracks = self.mix.sources[source].tracks
        if source not in self._kin:
            self._kin[source] = Buckets((t.label for t in tracks), len(tracks))
        same = self._kin[source].of(track)
        for _ in range(TRIES_FOR_A_STRANGER if len(same) > 1 else 0):
            number = int(same[rng.integers(len(same))])
            other = tracks[number]
            if other.group != group:
                return source, number, int(rng.integers(len(other.frames)))
        return None


def patch_box(seed: int, width_px: float, height_px: float) -> Box:
    """A box anywhere in a picture of this size, wholly inside, in its pixels."""
    rng = np.random.default_rng(seed)
    w = float(rng.uniform(*PATCH_WIDTH_SHARE)) * width_px
    h = min(w * float(np.exp(rng.uniform(-PATCH_LOG_ASPECT, PATCH_LOG_ASPECT))), PATCH_MAX_HEIGHT_SHARE * height_px)
    return Box.from_xywh(float(rng.uniform(0, width_px - w)), float(rng.uniform(0, height_px - h)), w, h)


@dataclass(frozen=True, slots=True)
class Rows:
    """What of a stage's global batch one process makes, and the generators it makes it with.

    Raises TrainingError when the batch cannot be divided among the processes.
    """

    seed: int
    stage_index: int
    batch: int
    rank: int = 0
    world: int = 1

    def __post_init__(self) -> None:
        if self.batch % self.world:
            raise TrainingError(
                f"stage {self.stage_index}: batch {self.batch} cannot be shared by {self.world} processes; "
                f"choose a multiple of {self.world}"
            )

    @classmethod
    def of(cls, recipe: Recipe, stage_index: int, rank: int, world: int) -> Rows:
        """Rows of a recipe's stage."""
        return cls(recipe.seed, stage_index, recipe.stages[stage_index].batch, rank, world)

    @property
    def numbers(self) -> range:
        """Row numbers of this process within the global batch."""
        mine = self.batch // self.world
        return range(self.rank * mine, (self.rank + 1) * mine)

    def plan(self, step: int, recipe: Recipe) -> Plan:
        """Geometry and effects of the whole global batch."""
        stage: Stage = recipe.stages[self.stage_index]
        rng = seed_of(self.seed, self.stage_index, step, PLAN_STREAM)
        return draw_plan(rng, self.batch, recipe.augmentation, stage.jitter, stage.search_px)

    def draw(
        self, step: int, row: int, picker: Picker, fetch: Callable[[Pick], Got | Fault], skipped: Skipped
    ) -> tuple[int, Pick, Got]:
        """Seed of the row's effects, the pick and what `fetch` made of it. A fault is counted and drawn again.

        Raises TrainingError after 20 faults in a row.
        """
        rng = seed_of(self.seed, self.stage_index, step, row)
        effects = int(rng.integers(2**31))  # before the picks: a fault must not change it
        last = Fault("", "")
        for _ in range(MISSES_IN_A_ROW):
            pick = picker.pick(rng)
            got = fetch(pick)
            if not isinstance(got, Fault):
                return effects, pick, got
            skipped.add(kind_of(got.what), got.what)
            last = got
        raise TrainingError(
            f"source `{last.source}`: {MISSES_IN_A_ROW} picks in a row could not be used, the last: {last.what}; "
            "are its files there and its columns in the right order?"
        )


class HostBatches:
    """Batches rendered with OpenCV, from any sources. Implements `types.Batches`; can be sent to worker processes.

    Raises TrainingError when the stage's batch cannot be divided by `world`.
    """

    def __init__(self, mix: Mix, recipe: Recipe, stage_index: int, rank: int = 0, world: int = 1) -> None:
        self._recipe, self._rows = recipe, Rows.of(recipe, stage_index, rank, world)
        self._picker = Picker(mix, recipe.pairing)
        self._search_px = recipe.stages[stage_index].search_px

    def batch(self, step: int) -> Batch:
        """The rows of this process of batch number `step`. Raises TrainingError when nothing can be read any more."""
        rows = self._rows.numbers
        plan = self._rows.plan(step, self._recipe)
        skipped = Skipped()
        exemplars = np.empty((len(rows), 3, EXEMPLAR_PX, EXEMPLAR_PX), np.uint8)
        searches = np.empty((len(rows), 3, self._search_px, self._search_px), np.uint8)
        boxes, negative = np.empty((len(rows), 4), np.float32), np.empty(len(rows), np.bool_)
        for i, row in enumerate(rows):
            effects, pick, views = self._rows.draw(step, row, self._picker, self._views, skipped)
            exemplar, search, box = render_pair(*views, plan, row, self._search_px, effects)
            exemplars[i], searches[i] = exemplar.transpose(2, 0, 1), search.transpose(2, 0, 1)
            boxes[i], negative[i] = box, pick.negative
        z, x, box_rows, flags = (torch.from_numpy(a) for a in (exemplars, searches, boxes, negative))
        return Batch(z, x, box_rows, flags, skipped)

    def _views(self, pick: Pick) -> tuple[View, View] | Fault:
        sources = self._picker.mix.sources
        exemplar = sources[pick.source].view(pick.track, pick.exemplar_index)
        if isinstance(exemplar, str):
            return Fault(sources[pick.source].name, exemplar)
        if pick.patch is not None:
            height, width = exemplar.image_bgr_u8.shape[:2]
            view = View(exemplar.image_bgr_u8, patch_box(pick.patch, width, height), exemplar.fill_bgr)
            return view, view
        where = (pick.search_source, pick.search_track, pick.search_index)
        if where == (pick.source, pick.track, pick.exemplar_index):
            return exemplar, exemplar  # a still picture is decoded once
        search = sources[pick.search_source].view(pick.search_track, pick.search_index)
        return Fault(sources[pick.search_source].name, search) if isinstance(search, str) else (exemplar, search)
