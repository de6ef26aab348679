"""Packing sources into crops: small files that train at full speed from any disk and travel to a machine with a GPU.

What is kept of a target is the window that training crops can show of it, and not many more pixels than they need:
averaged down by the whole factor that leaves the exemplar's square between 127 and 254 px, as the tracker itself does
before it samples (`siamapnpp/crop.py`). Shrinking to 127 px exactly would blur what the tracker will see sharp
(measured: up to half of the gradient energy lost) for two thirds of the bytes.
"""

from __future__ import annotations

import math
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from safetensors import SafetensorError
from safetensors.numpy import save_file

from tracker.box import Box
from tracker.siamapnpp.crop import EXEMPLAR_PX, MIN_SIDE_PX, exemplar_side_px
from tracker.training.errors import TrainingError
from tracker.training.loader import in_order
from tracker.training.pack_format import (
    CROP_RANGE_PX,
    PACK_FILE,
    SCHEMA_VERSION,
    SUFFIX,
    Manifest,
    PackedSet,
    Shard,
    TrackColumns,
)
from tracker.training.recipe import Recipe
from tracker.training.sources.faults import UnusableBox, kind_of
from tracker.training.sources.mix import Mix
from tracker.training.types import Skipped, Source, View
from tracker.weights.card import sha256_of

SHARD_BYTES = 60_000_000  # below the limits of hosts and mail gateways; one is read in a second
HEADER_BYTES = 1000  # more than the table of contents of a shard takes
ROW_BYTES = 35  # of a crop beside its picture
JPEG_QUALITY = 90  # the pictures have been compressed before, and are augmented after
PER_TRACK = 2  # with one frame of a video there is no pair
CLUSTER = 4  # frames of a long track that lie within one frame range of each other
READABLE_BY_ALL = 0o755
FILE_READABLE_BY_ALL = 0o644
SURROGATE = re.compile("[\\ud800-\\udfff]")  # what Python makes of bytes in a file's name that are no UTF-8

Ints = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class PackedCount:
    """What one source gave."""

    name: str
    tracks: int
    crops: int
    size_bytes: int


@dataclass(frozen=True, slots=True)
class PackReport:
    """A finished pack."""

    folder: Path
    sources: tuple[PackedCount, ...]
    skipped: Skipped


@dataclass(frozen=True, slots=True)
class Crop:
    """One picture of a shard: a JPEG file, the target in its pixels, the colour of the outside."""

    jpeg: bytes
    box: Box
    fill_bgr: tuple[int, int, int]


Progress = Callable[[str, int, int], None]  # source, crops done, crops in all


def prepare(
    mix: Mix,
    recipe: Recipe,
    out: Path,
    crop_px: int | None = None,
    limit_per_source: int | None = None,
    progress: Progress = lambda name, done, total: None,
    workers: int = 0,
) -> PackReport:
    """Pack all sources of a recipe into the new folder `out`, whole or not at all.

    `crop_px`: side of the window around a target at the scale at which its exemplar's square is 127 px; by default what
    the recipe's stages can show. `workers` processes cut the crops. Raises TrainingError: `out` exists or cannot be
    written, a source without any crop.
    """
    low, high = CROP_RANGE_PX
    crop_px = window_px(recipe) if crop_px is None else crop_px
    if not low <= crop_px <= high:
        raise TrainingError(f"crop_px {crop_px}: must be from {low} (the search crop itself) to {high}")
    if out.exists():
        raise TrainingError(f"{out}: exists already; choose another folder, or remove it")
    stems = _stems([source.name for source in mix.sources])
    with _whole_or_not_at_all(out) as hidden:
        skipped = Skipped()
        cutters = [_Cutter.of(source, limit_per_source, crop_px) for source in mix.sources]
        sets = [
            _pack(cutter, float(share), _Writer(hidden, stem), progress, workers, skipped)
            for cutter, share, stem in zip(cutters, mix.shares, stems, strict=True)
        ]
        manifest = Manifest(schema_version=SCHEMA_VERSION, recipe=recipe.name, crop_px=crop_px, sources=sets)
        (hidden / PACK_FILE).write_text(manifest.model_dump_json() + "\n", encoding="utf-8")
    counts = tuple(
        PackedCount(s.name, len(s.tracks.names), s.crops, sum(shard.size_bytes for shard in s.shards)) for s in sets
    )
    return PackReport(out, counts, skipped)


@contextmanager
def _whole_or_not_at_all(out: Path) -> Iterator[Path]:
    """A hidden folder that becomes `out` when all went well, and else is removed. Raises TrainingError."""
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        hidden = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
        try:
            yield hidden
            hidden.chmod(READABLE_BY_ALL)
            hidden.rename(out)
        except BaseException:
            shutil.rmtree(hidden, ignore_errors=True)
            raise
    except (OSError, SafetensorError) as error:
        reason = getattr(error, "strerror", None) or error
        raise TrainingError(f"{out}: cannot be written ({reason}); make room, or choose another place") from error


def window_px(recipe: Recipe) -> int:
    """Side of the window that search crops of the recipe can show, but for the corners of turned ones.

    A smaller one shows its edge in the crops that reach beyond it, which gives the target's place away.
    """
    low, high = CROP_RANGE_PX
    widest = max((s.search_px + 2 * s.jitter.shift_px) * math.exp(s.jitter.log_scale) for s in recipe.stages)
    return min(max(math.ceil(widest), low), high)


def cut(view: View, crop_px: int) -> Crop | str:
    """The visible part of the window around a view's target, or what is wrong with the view.

    The window is `crop_px` wide at the scale at which the exemplar's square is 127 px; whole pixels of the picture and
    a whole factor of reduction, so that the target stays exactly where it was.
    """
    box, image = view.box, view.image_bgr_u8
    if not box.is_valid:
        return UnusableBox("box without a size")
    height, width = image.shape[:2]
    side_px = max(exemplar_side_px(box.w_px, box.h_px), MIN_SIDE_PX)
    half = side_px * crop_px / EXEMPLAR_PX / 2
    left, top = max(0, math.floor(box.cx_px - half)), max(0, math.floor(box.cy_px - half))
    right, bottom = min(width, math.ceil(box.cx_px + half)), min(height, math.ceil(box.cy_px + half))
    if left >= right or top >= bottom:
        return UnusableBox("box outside the picture")
    factor = max(1, int(side_px / EXEMPLAR_PX))
    columns, rows = (right - left) // factor, (bottom - top) // factor
    if columns < 1 or rows < 1:
        return UnusableBox("box outside the picture")
    part = image[top : top + rows * factor, left : left + columns * factor]
    small = part if factor == 1 else cv2.resize(part, (columns, rows), interpolation=cv2.INTER_AREA)
    ok, data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    if not ok:
        return "picture that cannot be compressed"
    b, g, r = (round(min(max(v, 0.0), 255.0)) for v in view.fill_bgr)
    moved = Box((box.cx_px - left) / factor, (box.cy_px - top) / factor, box.w_px / factor, box.h_px / factor)
    return Crop(data.tobytes(), moved, (b, g, r))


def choose(source: Source, limit: int | None) -> Ints:
    """(n, 2) track and index of the crops of a source, at most `limit`, ascending; all without a limit.

    Spread evenly over the tracks, and over the frames of a track; where that would put neighbours further apart than
    exemplar and search may be, in clusters within the frame range, for a pair needs two.
    """
    lengths = np.array([len(track.frames) for track in source.tracks], np.int64)
    quota = _quota(lengths, limit)
    rows = [np.zeros((0, 2), np.int64)]
    for track in np.flatnonzero(quota).tolist():
        index = _spread(source.tracks[track].frames, int(quota[track]), source.frame_range)
        rows.append(np.stack([np.full(len(index), track), index], axis=1))
    return np.concatenate(rows)


def _quota(lengths: Ints, limit: int | None) -> Ints:
    """Frames of each track: the same number of each, as far as it has them; of some tracks only when there are many."""
    if limit is None or lengths.sum() <= limit:
        return lengths
    least = np.minimum(lengths, PER_TRACK)
    if least.sum() > limit:
        kept = np.arange(limit * len(lengths) // least.sum()) * least.sum() // limit
        quota = np.zeros_like(lengths)
        quota[kept] = least[kept]
        quota[np.cumsum(quota) > limit] = 0
        return quota
    level, beyond = PER_TRACK, int(lengths.max())
    while beyond - level > 1:
        middle = (level + beyond) // 2
        fits = int(np.minimum(lengths, middle).sum()) <= limit
        level, beyond = (middle, beyond) if fits else (level, middle)
    return np.minimum(lengths, level)


def _spread(frames: Sequence[int], count: int, frame_range: int) -> Ints:
    if count >= len(frames):
        return np.arange(len(frames))
    span = frames[-1] - frames[0]
    if count == 1 or span / (count - 1) <= frame_range / 2:
        return np.unique(np.linspace(0, len(frames) - 1, count).round().astype(np.int64))
    number = np.arange(count)
    clusters = -(-count // CLUSTER)
    starts = frames[0] + (number // CLUSTER) * max(0, span - frame_range) / max(1, clusters - 1)
    wanted = starts + (number % CLUSTER) * frame_range / (CLUSTER - 1)
    return np.unique(np.searchsorted(frames, wanted).clip(0, len(frames) - 1))


@dataclass(frozen=True, slots=True, eq=False)
class _Cutter:
    source: Source
    chosen: Ints
    crop_px: int

    @classmethod
    def of(cls, source: Source, limit: int | None, crop_px: int) -> _Cutter:
        """Raises TrainingError for a limit too low for any pair (a still picture makes one alone, a video frame not),
        and for names that pack.json cannot hold."""
        chosen = choose(source, limit)
        if not len(chosen) and len(source.tracks):
            raise TrainingError(
                f"source `{source.name}`: limit {limit}: a pair needs {PER_TRACK} frames of a video; "
                f"give a limit of at least {PER_TRACK}"
            )
        for number in np.unique(chosen[:, 0]).tolist():
            track = source.tracks[number]
            if SURROGATE.search(f"{track.name}{track.label}{track.group}"):
                raise TrainingError(
                    f"source `{source.name}`: {track.name!r} is not UTF-8, as {PACK_FILE} must be; rename the file"
                )
        return cls(source, chosen, crop_px)

    def __call__(self, number: int) -> Crop | str:
        track, index = (int(v) for v in self.chosen[number])
        view = self.source.view(track, index)
        if isinstance(view, str):
            return view
        crop = cut(view, self.crop_px)
        if isinstance(crop, str):
            return type(crop)(f"{self.source.tracks[track].name} frame {index}: {crop}")
        return crop


class _Writer:
    """Collects crops and writes a shard whenever one is full."""

    def __init__(self, folder: Path, stem: str) -> None:
        self._folder, self._stem = folder, stem
        self.shards: list[Shard] = []
        self._crops: list[tuple[Crop, int, int]] = []
        self._bytes = HEADER_BYTES

    def add(self, crop: Crop, frame: int, track: int) -> None:
        size = len(crop.jpeg) + ROW_BYTES
        if self._crops and self._bytes + size > SHARD_BYTES:
            self.flush()
        self._crops.append((crop, frame, track))
        self._bytes += size

    def flush(self) -> None:
        if not self._crops:
            return
        crops, frames, tracks = zip(*self._crops, strict=True)
        tensors: dict[str, npt.NDArray[Any]] = {
            "jpeg": np.frombuffer(b"".join(c.jpeg for c in crops), np.uint8),
            "offset": np.cumsum([0, *(len(c.jpeg) for c in crops)], dtype=np.int64),
            "box": np.array([(c.box.cx_px, c.box.cy_px, c.box.w_px, c.box.h_px) for c in crops], np.float32),
            "frame": np.array(frames, np.int32),
            "track": np.array(tracks, np.int32),
            "fill": np.array([c.fill_bgr for c in crops], np.uint8),
        }
        path = self._folder / f"{self._stem}-{len(self.shards):03d}{SUFFIX}"
        save_file(tensors, path)
        path.chmod(FILE_READABLE_BY_ALL)  # safetensors makes it private
        shard = Shard(file=path.name, crops=len(crops), size_bytes=path.stat().st_size, sha256=sha256_of(path))
        self.shards.append(shard)
        self._crops, self._bytes = [], HEADER_BYTES


def _pack(
    cutter: _Cutter, share: float, writer: _Writer, progress: Progress, workers: int, all_skipped: Skipped
) -> PackedSet:
    source, chosen = cutter.source, cutter.chosen
    used: list[int] = []  # tracks that gave a crop
    count, skipped = 0, Skipped()
    skipped.merge(source.skipped)
    for number, crop in enumerate(in_order(cutter, 0, len(chosen), workers)):
        track, index = (int(v) for v in chosen[number])
        if isinstance(crop, str):
            skipped.add(kind_of(crop), crop)
        else:
            if not used or used[-1] != track:
                used.append(track)
            writer.add(crop, source.tracks[track].frames[index], len(used) - 1)
            count += 1
        progress(source.name, number + 1, len(chosen))
    writer.flush()
    all_skipped.merge(skipped)
    if not count:
        raise TrainingError(f"source `{source.name}` gave no crop: {'; '.join(skipped.lines()) or 'it has no track'}")
    return PackedSet(
        name=source.name,
        share=share,
        frame_range=source.frame_range,
        crops=count,
        shards=writer.shards,
        tracks=TrackColumns.of((source.tracks[track] for track in used), source.name),
        skipped=[line.encode(errors="replace").decode() for line in skipped.lines()],  # paths may be no text
    )


def _stems(names: Sequence[str]) -> list[str]:
    """The beginning of the shards' names for each source. Raises TrainingError when two sources would share one."""
    stems = [re.sub(r"[^A-Za-z0-9._-]", "_", name).lstrip(".") or "source" for name in names]
    for i, stem in enumerate(stems):
        if stem in stems[:i]:
            raise TrainingError(
                f"sources `{names[stems.index(stem)]}` and `{names[i]}`: their files would both be "
                f"called {stem}; give them other names in the recipe"
            )
    return stems
