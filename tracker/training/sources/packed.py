"""A source that reads packed crops (format: `pack_format.py`)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tracker.box import Box
from tracker.training.errors import TrainingError
from tracker.training.pack_format import AGAIN, PACK_FILE, PackedSet, open_shard, read_manifest
from tracker.training.recipe import AnySource, Coco, Packed, Recipe, Simulator, Stills, YoutubeBB
from tracker.training.source_names import source_name
from tracker.training.sources.strings import Strings
from tracker.training.sources.table import Ints, Table, Tracks
from tracker.training.types import Skipped, Track, View


class PackedSource:
    """One source of a pack. Implements `types.Source`; files are mapped when a process first reads from them.

    `only`, `exclude` and `reserved` name tracks or their groups; `stride` keeps every so many frames of a track. Sizes
    were filtered when the pack was made. `crop_px`: side of the window in which the exemplar's square is 127 px.
    Raises TrainingError: no pack, another schema, a shard that is missing or of another size, no track left.
    """

    def __init__(self, spec: Packed, pack: Path, reserved: frozenset[str] = frozenset()) -> None:
        manifest = read_manifest(pack)
        packed = manifest.set_of(spec.set_name, pack / PACK_FILE)
        self.name, self.frame_range, self.crop_px = spec.name or packed.name, spec.frame_range, manifest.crop_px
        self.skipped = Skipped()
        self.folder, self.shards = pack, tuple(packed.shards)
        self._first = np.cumsum([0, *(shard.crops for shard in packed.shards)])
        self._open: dict[int, Any] = {}
        table, self._crop = _table(packed, spec, reserved, self._columns(packed), self.skipped)
        self._row = table.first
        self.tracks: Sequence[Track] = Tracks(table, packed.name)
        if not self.tracks:
            why = "; ".join(self.skipped.lines())
            raise TrainingError(f"{pack}: source `{spec.set_name}` has no track left by only and exclude. {why}")

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_open": {}}

    def __len__(self) -> int:
        """Crops of the set, those of left out tracks too."""
        return int(self._first[-1])

    def files(self) -> list[tuple[Path, str]]:
        """The shards and the sha256 that each should have."""
        return [(self.folder / shard.file, shard.sha256) for shard in self.shards]

    def crop_of(self, track: int, index: int) -> int:
        """Number of a crop within the set."""
        return int(self._crop[self._row[track] + index])

    def crops(self) -> npt.NDArray[np.int64]:
        """Numbers of all crops of the tracks, ascending: what can be asked for."""
        return self._crop

    def view(self, track: int, index: int) -> View | str:
        """The crop as a picture, in its own resolution; or why it cannot be had."""
        return self.crop(self.crop_of(track, index))

    def crop(self, number: int) -> View | str:
        """The same by its number within the set."""
        k = int(np.searchsorted(self._first, number, side="right")) - 1
        i = number - int(self._first[k])
        shard = self._shard(k)
        first, last = (int(v) for v in shard.get_slice("offset")[i : i + 2])
        data = shard.get_slice("jpeg")[first:last]
        image = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
        if image is None:
            return f"{self.folder / self.shards[k].file}: crop {i} is not a JPEG picture"
        cx, cy, w, h = (float(v) for v in shard.get_slice("box")[i])
        b, g, r = (float(v) for v in shard.get_slice("fill")[i])
        return View(np.asarray(image, dtype=np.uint8), Box(cx, cy, w, h), (b, g, r))

    def _shard(self, k: int) -> Any:
        if k not in self._open:
            self._open[k] = open_shard(self.folder, self.shards[k])
        return self._open[k]

    def _columns(self, packed: PackedSet) -> tuple[Ints, Ints]:
        """Frame number and track of every crop. Checks every shard on the way."""
        opened = [open_shard(self.folder, shard) for shard in self.shards]
        frames = np.concatenate([one.get_tensor("frame") for one in opened])
        owners = np.concatenate([one.get_tensor("track") for one in opened])
        if not np.array_equal(np.unique(owners), np.arange(len(packed.tracks.names))) or (np.diff(owners) < 0).any():
            raise TrainingError(f"{self.folder}: the tracks of `{packed.name}` do not match {PACK_FILE}; {AGAIN}")
        if (frames < 0).any() or (np.diff(frames)[np.diff(owners) == 0] <= 0).any():
            raise TrainingError(f"{self.folder}: the frames of `{packed.name}` are not in order; {AGAIN}")
        return frames, owners


def _table(
    packed: PackedSet, spec: Packed, reserved: frozenset[str], columns: tuple[Ints, Ints], skipped: Skipped
) -> tuple[Table, Ints]:
    """The tracks that the spec wants, and the crop of each row of the table."""
    frames, owners = columns
    tracks = packed.tracks
    left_out = reserved | set(spec.exclude)
    wanted = np.zeros(len(tracks.names), np.bool_)
    for number, name in enumerate(tracks.names):
        names = {name, tracks.groups[tracks.group[number]]}
        wanted[number] = names.isdisjoint(left_out) and (not spec.only or not names.isdisjoint(spec.only))
        if not names.isdisjoint(reserved):
            skipped.add("reserved for validation", name)
    place = np.arange(len(owners)) - np.searchsorted(owners, owners)  # of a crop within its track
    crop = np.flatnonzero(wanted[owners] & (place % spec.stride == 0))
    kept = np.flatnonzero(wanted)
    table = Table(
        pictures=Strings(),
        picture=np.zeros(0, np.int32),
        frame=frames[crop],
        box=np.zeros((0, 4), np.float32),
        first=np.searchsorted(owners[crop], [*kept, len(tracks.names)]),
        names=Strings(tracks.names[n] for n in kept),
        label=np.array(tracks.label, np.int32)[kept],
        labels=tuple(tracks.labels),
        group=np.array(tracks.group, np.int32)[kept],
        groups=Strings(tracks.groups),
    )
    return table, crop


def open_packed(spec: Packed, root: Path, reserved: frozenset[str]) -> PackedSource:
    """The source of a spec whose path is below `root`, without the tracks that are `reserved` for validation.

    Raises TrainingError as PackedSource does.
    """
    return PackedSource(spec, root / spec.path, reserved)


def packed_recipe(recipe: Recipe, pack: Path) -> Recipe:
    """The same recipe with its pictures from a pack: same names, shares and frame ranges.

    Raises TrainingError when the pack was made for other sources, naming the difference.
    """
    manifest = read_manifest(pack)
    there = {one.name for one in manifest.sources}
    named = [_name_in(there, spec) for spec in recipe.sources]
    if there != set(named) or len(named) != len(there):
        gaps = {"the pack lacks": set(named) - there, "the recipe lacks": there - set(named)}
        told = "; ".join(f"{what} {', '.join(sorted(names))}" for what, names in gaps.items() if names)
        raise TrainingError(
            f"{pack}: packed for recipe `{manifest.recipe}`, which has other sources than `{recipe.name}`: "
            f"{told or 'two of them have one name'}"
        )
    sources = tuple(_packed(spec, name, pack) for spec, name in zip(recipe.sources, named, strict=True))
    return recipe.model_copy(update={"sources": sources})


def without_places(recipe: Recipe) -> dict[str, Any]:
    """The recipe as plain values, without the paths of packs: what it does is the same wherever they lie."""
    plain = recipe.model_dump(mode="json")
    for source in plain["sources"]:
        if source["kind"] == "packed":
            del source["path"]
    return plain


def _name_in(there: set[str], spec: AnySource) -> str:
    """What a source is called, in a pack of these names where the recipe leaves it open.

    A source without a name takes that of its folder or table; a folder's may hold a dot, and is not there to be asked
    on a machine that has only the pack.
    """
    if spec.name or isinstance(spec, Packed | Simulator):
        return spec.name or (spec.set_name if isinstance(spec, Packed) else spec.kind)
    path = Path(spec.annotations if isinstance(spec, Coco | Stills | YoutubeBB) else spec.path)
    return path.name if path.name in there else source_name(spec)


def _packed(spec: AnySource, name: str, pack: Path) -> Packed:
    return Packed(
        kind="packed",
        path=str(pack.resolve()),
        set_name=name,
        name=name,
        share=spec.share,
        frame_range=spec.frame_range,
        exclude=spec.exclude,  # `only` and the limits of size were applied when the pack was made
    )
