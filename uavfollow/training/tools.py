"""Around a run: packing, a look at the pairs, diagnosis, widening."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import cv2
from torch import nn

from tracker.siamapnpp.settings import TrackerSettings
from tracker.training.diagnose import diagnose
from tracker.training.diagnosis import Diagnosis
from tracker.training.pack import PackReport, prepare
from tracker.training.pairs import HostBatches
from tracker.training.preview import contact_sheet
from tracker.training.recipe import Recipe
from tracker.training.types import Footage
from tracker.training.widen import widen
from tracker.weights.card import card_path, sha256_of, write_card
from tracker.weights.store import SUFFIX, load, save
from uavfollow.errors import InputError
from uavfollow.interrupts import orderly_end
from uavfollow.progress import ProgressLine
from uavfollow.training.material import open_sources, tell_sources

PREVIEW_PAIRS, PREVIEW_COLUMNS = 32, 4
SETTINGS_NOTE = "widened from {name} (sha256 {sha256}): the same maps at four times the cost; to train on, start.widen"


def pack(recipe: Recipe, data: Path, out: Path, crop_px: int | None, limit: int | None, workers: int) -> PackReport:
    """Pack the recipe's sources into the new folder `out`. Raises TrainingError, KeyboardInterrupt on a signal."""
    mix = open_sources(recipe, data)
    tell_sources(mix)
    line = ProgressLine()

    def show(name: str, done: int, total: int) -> None:
        if line.due_s() is not None:
            line.write(f"{name}: {done}/{total} crops")

    try:
        with orderly_end():  # so that the hidden folder does not stay behind
            return prepare(mix, recipe, out, crop_px, limit_per_source=limit, progress=show, workers=workers)
    finally:
        line.close()


def preview(recipe: Recipe, data: Path, out: Path, stage: int, seed: int | None) -> Path:
    """Write a contact sheet of the first pairs of stage `stage` (from 1), labels drawn. Raises InputError."""
    if not 1 <= stage <= len(recipe.stages):
        raise InputError(f"--stage {stage}: recipe {recipe.name} has the stages 1 to {len(recipe.stages)}")
    if not out.parent.is_dir():
        raise InputError(f"--out {out}: there is no folder {out.parent}; make it first")
    stages = list(recipe.stages)
    stages[stage - 1] = stages[stage - 1].model_copy(update={"batch": PREVIEW_PAIRS})
    changes = {"stages": tuple(stages), **({} if seed is None else {"seed": seed})}
    shown = recipe.model_copy(update=changes)
    mix = open_sources(shown, data)
    tell_sources(mix)
    batch = HostBatches(mix, shown, stage - 1).batch(0)
    for text in batch.skipped.lines():
        print(f"not used: {text}", file=sys.stderr)
    try:
        written = cv2.imwrite(str(out), contact_sheet(batch, PREVIEW_COLUMNS))
    except cv2.error as error:
        raise InputError(f"--out {out}: no picture can be written there; let the name end in .jpg or .png") from error
    if not written:
        raise InputError(f"--out {out}: cannot be written; choose another place")
    return out


def diagnosis_of(model: str, footage: list[Footage], pairs: int, seed: int) -> Diagnosis:
    """Diagnose a model on sequences. Raises WeightsError, TrainingError."""
    network, settings = network_of(model)
    line = ProgressLine()

    def show(done: int) -> None:
        if line.due_s() is not None:
            line.write(f"{done}/{pairs} pairs")

    try:
        return diagnose(network, footage, settings, pairs, seed, report=show)
    finally:
        line.close()


def network_of(model: str) -> tuple[nn.Module, TrackerSettings]:
    """A model's network in eval mode and its tracker's settings. Raises WeightsError."""
    weights = load(model)
    return weights.network(), weights.settings()


def widened(model: str, out: Path) -> dict[str, Any]:
    """Write the `full` that computes what the `s` of `model` computes, with a card; returns the card.

    Raises InputError for a place that cannot be used, WeightsError, TrainingError.
    """
    if out.suffix != SUFFIX:
        raise InputError(f"--out {out}: weights are written as {SUFFIX}; choose such a name")
    for existing in (out, card_path(out)):
        if existing.exists():
            raise InputError(f"--out {existing}: exists already; choose another name or remove it")
    if not out.parent.is_dir():
        raise InputError(f"--out {out}: there is no folder {out.parent}; make it first")
    weights = load(model)
    if weights.size == "full":
        raise InputError(f"{model} is already of size full; only weights of size s can be widened")
    tensors = widen(weights.tensors)
    save(out, tensors)
    card: dict[str, Any] = {
        **{key: weights.card[key] for key in ("architecture", "licence_note", "input") if key in weights.card},
        "name": out.stem,
        "architecture": "siamapnpp",
        "size": "full",
        "tensors": len(tensors),
        "parameters": sum(v.numel() for k, v in tensors.items() if ".running_" not in k),
        "sha256": sha256_of(out),
        "made_from": SETTINGS_NOTE.format(name=weights.path.name, sha256=sha256_of(weights.path)),
        "tracker_settings": weights.card.get("tracker_settings", {}),
    }
    write_card(out, card)
    return card
