"""What a pack of crops is on disk.

A pack is a folder with `pack.json` and shards NAME-000.safetensors. A shard holds n crops in the order of their tracks:
`jpeg` (uint8, all files in a row), `offset` (int64, n + 1), `box` (float32, n x 4: cx, cy, w, h in pixels of the crop),
`frame` and `track` (int32, n: frame number, and track by its number in pack.json), `fill` (uint8, n x 3, BGR). A crop
holds only what the camera saw: where the window reached beyond the picture, it is smaller, and `fill` stands for the
rest, as with any other view.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from safetensors import SafetensorError, safe_open

from tracker.training.errors import TrainingError
from tracker.training.types import Track

PACK_FILE = "pack.json"
SCHEMA_VERSION = 1
SUFFIX = ".safetensors"
CROP_RANGE_PX = (287, 1023)  # the search crop itself; twice the widest of the built-in recipes
# Type and number of dimensions of each, as safetensors names them.
TENSORS = {
    "jpeg": ("U8", 1),
    "offset": ("I64", 1),
    "box": ("F32", 2),
    "frame": ("I32", 1),
    "track": ("I32", 1),
    "fill": ("U8", 2),
}
OURS = "Value error, "  # what pydantic puts before the words of a validator
AGAIN = "make the pack again with `uavfollow train prepare`, or copy it again"


Positive = Annotated[int, Field(ge=1)]
FileName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-][A-Za-z0-9._-]*\.safetensors$")]  # never in another folder


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Shard(_Part):
    """One file of a pack."""

    file: FileName
    crops: Positive
    size_bytes: Positive
    sha256: str


class TrackColumns(_Part):
    """Tracks by column; `label` and `group` are numbers into `labels` and `groups`, label -1 is none."""

    names: list[str]
    labels: list[str]
    label: list[int]
    groups: list[str]
    group: list[int]

    @model_validator(mode="after")
    def _fits(self) -> TrackColumns:
        lengths = (len(self.names), len(self.label), len(self.group))
        if len(set(lengths)) > 1:
            raise ValueError(f"names, label and group have {', '.join(map(str, lengths))} entries")
        for key, numbers, lowest, texts in (
            ("label", self.label, -1, self.labels),
            ("group", self.group, 0, self.groups),
        ):
            wrong = next((n for n in numbers if not lowest <= n < len(texts)), None)
            if wrong is not None:
                raise ValueError(f"{key} {wrong}: must be from {lowest} to {len(texts) - 1}, a number into {key}s")
        return self

    @classmethod
    def of(cls, tracks: Iterable[Track], source: str) -> TrackColumns:
        """The columns of some tracks. The source's name is taken from the groups: reading puts it there again."""
        labels: dict[str, int] = {}
        groups: dict[str, int] = {}
        names, label, group = [], [], []
        for track in tracks:
            names.append(track.name)
            label.append(-1 if track.label is None else labels.setdefault(track.label, len(labels)))
            group.append(groups.setdefault(track.group.removeprefix(f"{source}/"), len(groups)))
        return cls(names=names, labels=list(labels), label=label, groups=list(groups), group=group)


class PackedSet(_Part):
    """What came from one source."""

    name: str
    share: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    frame_range: Annotated[int, Field(ge=0)]
    crops: Positive
    shards: list[Shard]
    tracks: TrackColumns
    skipped: list[str]

    @model_validator(mode="after")
    def _adds_up(self) -> PackedSet:
        total = sum(shard.crops for shard in self.shards)
        if total != self.crops:
            raise ValueError(f"crops {self.crops}: its shards hold {total}")
        return self


class Manifest(_Part):
    """pack.json. `crop_px`: side of the window in which the exemplar's square is 127 px."""

    schema_version: int
    recipe: str
    crop_px: Annotated[int, Field(ge=CROP_RANGE_PX[0], le=CROP_RANGE_PX[1])]
    sources: list[PackedSet]

    @model_validator(mode="after")
    def _told_apart(self) -> Manifest:
        for what, names in (
            ("source", [source.name for source in self.sources]),
            ("file", [shard.file for source in self.sources for shard in source.shards]),
        ):
            twice = next((name for name, count in Counter(names).items() if count > 1), None)
            if twice is not None:
                raise ValueError(f"sources: the {what} {twice} is there twice")
        return self

    def set_of(self, name: str, where: Path) -> PackedSet:
        """One source. Raises TrainingError naming those that are there."""
        for one in self.sources:
            if one.name == name:
                return one
        raise TrainingError(f"{where}: holds no source `{name}`, only {', '.join(s.name for s in self.sources)}")


def read_manifest(pack: Path) -> Manifest:
    """pack.json of a pack. Raises TrainingError when there is none, or one that this program does not read."""
    path = pack / PACK_FILE
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise TrainingError(
            f"{pack}: no pack ({error.strerror}: {PACK_FILE}); make one: uavfollow train prepare"
        ) from error
    except UnicodeDecodeError as error:
        raise TrainingError(f"{path}: is not UTF-8 text ({error.reason} at byte {error.start}); {AGAIN}") from error
    version = re.search(r'"schema_version": *(\d+)', text[:200])
    if version and int(version[1]) != SCHEMA_VERSION:
        raise TrainingError(f"{path}: schema {version[1]}, this program reads {SCHEMA_VERSION}; {AGAIN}")
    try:
        return Manifest.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        said = first["msg"].removeprefix(OURS)
        raise TrainingError(f"{path}: {where or 'the file'}: {said}; {AGAIN}") from error


def open_shard(folder: Path, shard: Shard) -> Any:
    """A shard, mapped into memory. Raises TrainingError when it is missing, of another size or no shard."""
    path = folder / shard.file
    try:
        size = path.stat().st_size
        if size != shard.size_bytes:
            raise TrainingError(f"{path}: {size} bytes, {PACK_FILE} says {shard.size_bytes}; {AGAIN}")
        opened: Any = safe_open(path, framework="numpy")
    except OSError as error:
        raise TrainingError(f"{path}: cannot be read ({error.strerror or error}); {AGAIN}") from error
    except SafetensorError as error:
        raise TrainingError(f"{path}: not a safetensors file ({error}); {AGAIN}") from error
    missing = sorted(set(TENSORS) - set(opened.keys()))
    if missing:
        raise TrainingError(f"{path}: lacks {', '.join(missing)}; {AGAIN}")
    _check_shapes(path, shard, opened)
    return opened


def _check_shapes(path: Path, shard: Shard, opened: Any) -> None:
    for name, (kind, dimensions) in TENSORS.items():
        tensor = opened.get_slice(name)
        found = (tensor.get_dtype(), len(tensor.get_shape()))
        if found != (kind, dimensions):
            raise TrainingError(
                f"{path}: {name} is {found[0]} of {found[1]} dimensions, not {kind} of {dimensions}; {AGAIN}"
            )
    n = shard.crops
    wanted = {"offset": [n + 1], "box": [n, 4], "frame": [n], "track": [n], "fill": [n, 3]}
    for name, shape in wanted.items():
        there = list(opened.get_slice(name).get_shape())
        if there != shape:
            raise TrainingError(f"{path}: {name} is {there}, {PACK_FILE} says {shape}; {AGAIN}")
    offsets, size = opened.get_tensor("offset"), opened.get_slice("jpeg").get_shape()[0]
    if offsets[-1] != size:
        raise TrainingError(f"{path}: {size} bytes of pictures, its table says {offsets[-1]}; {AGAIN}")
    if offsets[0] != 0 or (np.diff(offsets) < 0).any():
        raise TrainingError(f"{path}: its table of pictures is not in order; {AGAIN}")
