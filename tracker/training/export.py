"""Trained weights as a model: the file and the card that says how it was made."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from tracker.engines.cpu import describe_cpu
from tracker.siamapnpp.settings import TrackerSettings
from tracker.training.checkpoint import Position
from tracker.training.errors import TrainingError
from tracker.training.recipe import Recipe, Stage, Start, Variant
from tracker.training.validate import SETTINGS, Validated, mean_score
from tracker.weights.card import ARCHITECTURE, INPUT, sha256_of, write_card
from tracker.weights.errors import WeightsError
from tracker.weights.layout import strip
from tracker.weights.store import SUFFIX, find, save

WEIGHTS = "weights"
BEST_WEIGHTS = "best"
VARIANT_PREFIX = "variant"
LICENCE_NOTE = "the terms of the images it was trained on are theirs, see the data; the weights are your own"
DECIMALS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Made:
    """What a card tells of a run: its recipe, what it began with, where it stands, what it ran on."""

    recipe: Recipe
    start: str
    position: Position
    device: torch.device
    processes: int


def export(folder: Path, name: str, tensors: dict[str, Tensor], made: Made) -> tuple[Path, Path]:
    """Write `name`.safetensors (fp16) and its card into `folder`; returns both.

    Other variants than SiamAPN++ itself are no models that the program can run: they become `variant.safetensors`
    (`variant-best.safetensors`) with a card of an architecture of their own. Raises TrainingError.
    """
    whole = made.recipe.variant is Variant.AAN
    if not whole:
        name = VARIANT_PREFIX if name == WEIGHTS else f"{VARIANT_PREFIX}-{name}"
    path = folder / f"{name}{SUFFIX}"
    try:
        save(path, {k: v.detach().cpu() for k, v in tensors.items()})
        card = _card(f"siamapnpp-{made.recipe.size}-{made.recipe.name}", path, strip(tensors), made)
        if not whole:
            card["architecture"] = f"{ARCHITECTURE}, variant {made.recipe.variant.value}"
            card["note"] = "a variant of the paper's component study, for comparison; the program cannot run it"
        return path, write_card(path, card)
    except (OSError, WeightsError) as error:
        raise TrainingError(f"the weights cannot be exported: {error}; the checkpoint beside them is whole") from error


def describe_start(start: Start) -> str:
    """What the run begins with, with the file's SHA-256. Raises TrainingError when there is no such file."""
    parts = []
    for text, value in (("weights of", start.model), ("widened from", start.widen)):
        if value is not None:
            parts.append(f"{text} {_file(value)}")
    if not parts:
        parts.append("the official random initialisation")
    if start.backbone is not None:
        parts.append(f"backbone of {_file(start.backbone)}")
    return ", ".join(parts)


def stage_in_words(stage: Stage) -> str:
    """One line as a person would log it."""
    length = f"{stage.pairs:,} pairs" if stage.pairs is not None else f"{stage.minutes:g} min"
    fall = f" to {stage.lr_end:g} ({stage.curve.value})" if stage.curve.value != "constant" else ""
    jitter = stage.jitter
    return (
        (
            f"{length}: batch {stage.batch}, search {stage.search_px} px, layers 1-{stage.frozen_layers} frozen, "
            f"lr {stage.lr:g}{fall}, jitter exp(+-{jitter.log_scale:g}), aspect exp(+-{jitter.log_aspect:g}), "
            f"shift {jitter.shift_px:g} px"
        )
        .replace("layers 1-0 frozen", "nothing frozen")
        .replace("layers 1-1 frozen", "layer 1 frozen")
    )


def _file(model: str) -> str:
    try:
        path = find(model)
        return f"{path.name} (sha256 {sha256_of(path)})"
    except (OSError, WeightsError) as error:
        raise TrainingError(f"start: {error}") from error


def _card(name: str, path: Path, tensors: dict[str, Tensor], made: Made) -> dict[str, Any]:
    recipe, at = made.recipe, made.position
    card: dict[str, Any] = {
        "name": name,
        "architecture": ARCHITECTURE,
        "size": recipe.size,
        "tensors": len(tensors),
        "parameters": sum(v.numel() for k, v in tensors.items() if ".running_" not in k),
        "sha256": sha256_of(path),
        "licence_note": LICENCE_NOTE,
        "input": INPUT,
        "made_from": made.start,
        "recipe_name": recipe.name,
        "recipe": _recipe_in_words(recipe),
        "data": _shares(recipe),
        "pairs": at.pairs,
        "hours_of_training": round(at.training_s / 3600, DECIMALS),
        "hours_in_all": round(at.total_s / 3600, DECIMALS),
        "hardware": f"{made.processes} x {_hardware(made.device)}",
        "torch": torch.__version__,
        "skipped_steps": at.skipped_steps,
        "unused_data": at.unused.lines(),
        "tracker_settings": _settings(SETTINGS),
    }
    if at.validations and at.validations[-1].scores:
        card["validation"] = _validation(at.validations[-1])
    return card


def _recipe_in_words(recipe: Recipe) -> list[str]:
    optimiser = recipe.optimiser
    average = "no average" if recipe.ema is None else f"EMA {recipe.ema:g}"
    return [
        f"{optimiser.kind} (backbone x{optimiser.backbone_factor:g}, weight decay {optimiser.weight_decay:g}, clip "
        f"{optimiser.clip:g}), {average}, labels {recipe.labels.value}, precision {recipe.precision}, "
        f"seed {recipe.seed}",
        *(stage_in_words(stage) for stage in recipe.stages),
    ]


def _shares(recipe: Recipe) -> dict[str, float]:
    total = sum(source.share for source in recipe.sources)
    shares: dict[str, float] = {}
    for source in recipe.sources:
        key = source.name or source.kind
        shares[key] = round(shares.get(key, 0.0) + source.share / total, DECIMALS)
    return shares


def _settings(settings: TrackerSettings) -> dict[str, Any]:
    return {
        "penalty_k": settings.penalty_k,
        "window": settings.window,
        "size_lr": settings.size_lr,
        "search_px": settings.search_px,
        "class_weights": list(settings.class_weights),
        "centre_term": settings.centre_term.value,
    }


def _validation(validated: Validated) -> dict[str, Any]:
    def numbers(auc: float | None, p20: float | None) -> dict[str, float | None]:
        return {k: None if v is None else round(v, DECIMALS) for k, v in (("auc", auc), ("p20", p20))}

    mean = mean_score(validated.scores)
    known = sum(s.auc is not None for s in validated.scores)
    return {
        "pairs": validated.pairs,
        "mean": None if mean is None else {"sequences": known, **numbers(mean.auc, mean.p20)},
        "sequences": {s.name: {"frames": s.frames, **numbers(s.auc, s.p20)} for s in validated.scores},
    }


def _hardware(device: torch.device) -> str:
    return torch.cuda.get_device_name(device) if device.type == "cuda" else describe_cpu()
