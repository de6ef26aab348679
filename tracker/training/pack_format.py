"""What a pack of crops is on disk.

A pack is a folder with `pack.json` and shards NAME-000.safetensors. A shard holds n crops in the order of their tracks:
`jpeg` (uint8, all files in a row), `offset` (int64, n + 1), `box` (float32, n x 4: cx, cy, w, h in pixels of the crop),
`frame` and `track` (int32, n: frame number, and track by its number in pack.json), `fill` (uint8, n x 3, BGR). A crop
holds only what the camera saw: where the window reached beyond the picture, it is smaller, and `fill` stands for the
rest, as with any other view.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError
from safetensors import SafetensorError, safe_open

from tracker.training.errors import TrainingError
from tracker.training.types import Track

PACK_FILE = "pack.json"
SCHEMA_VERSION = 1
SUFFIX = ".safetensors"
TENSORS = ("jpeg", "offset", "box", "frame", "track", "fill")
AGAIN = "make the pack again with `uavfollow train prepare`, or copy it again"


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Shard(_Part):
    """One file of a pack."""

    file: str
    crops: int
    size_bytes: int
    sha256: str


class TrackColumns(_Part):
    """Tracks by column; `label` and `group` are numbers into `labels` and `groups`, label -1 is none."""

    names: list[str]
    labels: list[str]
    label: list[int]
    groups: list[str]
    group: list[int]

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
    share: float
    frame_range: int
    crops: int
    shards: list[Shard]
    tracks: TrackColumns
    skipped: list[str]


class Manifest(_Part):
    """pack.json. `crop_px`: side of the window in which the exemplar's square is 127 px."""

    schema_version: int
    recipe: str
    crop_px: int
    sources: list[PackedSet]

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
    version = re.search(r'"schema_version": *(\d+)', text[:200])
    if version and int(version[1]) != SCHEMA_VERSION:
        raise TrainingError(f"{path}: schema {version[1]}, this program reads {SCHEMA_VERSION}; {AGAIN}")
    try:
        return Manifest.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise TrainingError(f"{path}: {where or 'the file'}: {first['msg']}; {AGAIN}") from error


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
    n = shard.crops
    wanted = {"offset": [n + 1], "box": [n, 4], "frame": [n], "track": [n], "fill": [n, 3]}
    for name, shape in wanted.items():
        found = list(opened.get_slice(name).get_shape())
        if found != shape:
            raise TrainingError(f"{path}: {name} is {found}, {PACK_FILE} says {shape}; {AGAIN}")
    last, size = int(opened.get_slice("offset")[n]), opened.get_slice("jpeg").get_shape()[0]
    if last != size:
        raise TrainingError(f"{path}: {size} bytes of pictures, its table says {last}; {AGAIN}")
