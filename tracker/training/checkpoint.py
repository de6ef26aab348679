"""Where a run can go on: one file with everything, written whole or not at all, read without running its code."""

from __future__ import annotations

import hashlib
import io
import json
import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import torch

from tracker.training.errors import TrainingError
from tracker.training.recipe import Recipe
from tracker.training.types import Skipped
from tracker.training.validate import SequenceScore, Validated

LAST = "last.ckpt"
BEST = "best.ckpt"
RECIPE = "recipe.json"
MAGIC = b"uavfollow-checkpoint-1 "  # then the SHA-256 of what follows the line: zip archives do not notice a lost bit
DIGEST_CHARS = 64
HEADER_BYTES = len(MAGIC) + DIGEST_CHARS + 1

State = dict[str, Any]


@dataclass(slots=True)
class Position:
    """Where a run is: the next step of which stage, and what was counted so far.

    `pairs` over all stages; `stage_s`, `total_s` of the clock, `training_s` the same without validation; `in_a_row`
    skipped steps without a good one between; `unused` counts the rows that the batches could not use.
    """

    stage: int = 0
    step: int = 0
    pairs: int = 0
    stage_s: float = 0.0
    total_s: float = 0.0
    training_s: float = 0.0
    skipped_steps: int = 0
    in_a_row: int = 0
    unused: Skipped = field(default_factory=Skipped)
    validations: list[Validated] = field(default_factory=list)

    @property
    def validated_at(self) -> int:
        """Pairs at the last validation; 0 when there was none."""
        return self.validations[-1].pairs if self.validations else 0

    @property
    def best(self) -> Validated | None:
        """The validation with the highest mean AUC, the first of equals."""
        return max(self.validations, key=lambda v: v.auc, default=None)


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoint:
    """Position and states. `optimiser` is None between two stages: the next one starts with a new one.

    `recipe`: the run's, as JSON; None in files that were written before it was kept.
    """

    position: Position
    network: State
    average: State
    optimiser: State | None
    scaler: State | None
    recipe: str | None = None


def to_bytes(checkpoint: Checkpoint) -> bytes:
    """The file's bytes, tensors on the CPU."""
    position = asdict(checkpoint.position)
    position["unused"]["counts"] = dict(checkpoint.position.unused.counts)
    states = {f.name: getattr(checkpoint, f.name) for f in fields(checkpoint) if f.name != "position"}
    buffer = io.BytesIO()
    torch.save(_on_cpu({"position": position, **states}), buffer)
    payload = buffer.getvalue()
    return MAGIC + hashlib.sha256(payload).hexdigest().encode() + b"\n" + payload


def from_bytes(data: bytes, where: Path) -> Checkpoint:
    """Raises TrainingError naming `where` when the bytes are damaged or of something else."""
    payload = data[HEADER_BYTES:]
    if not data.startswith(MAGIC):
        raise TrainingError(f"{where}: not a checkpoint of this version of uavfollow; {_way_out(where)}")
    if hashlib.sha256(payload).hexdigest().encode() != data[len(MAGIC) : HEADER_BYTES - 1]:
        raise TrainingError(f"{where}: the checkpoint is damaged (its SHA-256 does not match); {_way_out(where)}")
    try:
        raw = torch.load(io.BytesIO(payload), map_location="cpu", weights_only=True)
        states = (raw["network"], raw["average"], raw["optimiser"], raw["scaler"])
        return Checkpoint(_position(raw["position"]), *states, raw.get("recipe"))
    except Exception as error:  # the unpickler raises whatever a foreign file provokes; its text advises unsafe loading
        raise TrainingError(
            f"{where}: holds something else than a checkpoint ({type(error).__name__}); {_way_out(where)}"
        ) from error


def write_checkpoint(path: Path, data: bytes) -> None:
    """Replace the file whole: a crash leaves the old one. Raises TrainingError when the disk refuses."""
    part = path.with_suffix(path.suffix + ".part")
    try:
        with part.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
        _sync_folder(path.parent)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise TrainingError(f"{path}: the checkpoint cannot be written ({error}); make room and resume") from error


def read_checkpoint(path: Path) -> Checkpoint:
    """Raises TrainingError when it cannot be read or is damaged, saying what else there is."""
    return from_bytes(read_bytes(path), path)


def read_bytes(path: Path) -> bytes:
    """The file as it is; TrainingError when it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise TrainingError(f"{path}: the checkpoint cannot be read ({error}); {_way_out(path)}") from error


def write_recipe(folder: Path, recipe: Recipe) -> None:
    """recipe.json: what this folder's run does, for comparison when it is resumed."""
    path = folder / RECIPE
    part = path.with_suffix(".json.part")
    try:
        part.write_text(recipe.model_dump_json(indent=1) + "\n", encoding="utf-8")
        part.replace(path)
    except OSError as error:
        raise TrainingError(f"{path}: cannot be written ({error}); choose another folder") from error


def read_recipe(folder: Path) -> Recipe | None:
    """The recipe of the run in a folder, None when there is none. Raises TrainingError when it is damaged."""
    path = folder / RECIPE
    if not path.is_file():
        return None
    try:
        return recipe_of(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise TrainingError(f"{path}: not a recipe of this version of uavfollow ({reason}); restore it") from error


def recipe_of(text: str) -> Recipe:
    """From JSON. Raises ValueError when it is none of this version."""
    return Recipe.model_validate(json.loads(text))


def has_checkpoint(folder: Path) -> bool:
    """Whether a run in this folder can be resumed."""
    return (folder / LAST).is_file()


def _position(raw: dict[str, Any]) -> Position:
    unused = Skipped(Counter(raw["unused"]["counts"]), dict(raw["unused"]["named"]))
    validations = [
        Validated(v["pairs"], v["minutes"], tuple(SequenceScore(**s) for s in v["scores"])) for v in raw["validations"]
    ]
    return Position(**{**raw, "unused": unused, "validations": validations})


def _way_out(path: Path) -> str:
    best = path.parent / BEST
    if path.name != BEST and best.is_file():
        return f"go on from the best validation instead (mv {best} {path}) or start anew in another folder"
    return "there is no other checkpoint beside it: start anew in another folder"


def _sync_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)  # the new name itself must survive a power cut
    finally:
        os.close(descriptor)


def _on_cpu(value: Any) -> Any:
    if isinstance(value, torch.Tensor):
        return value.detach().cpu()
    if isinstance(value, Mapping):
        return {k: _on_cpu(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return type(value)(_on_cpu(v) for v in value)
    return value
