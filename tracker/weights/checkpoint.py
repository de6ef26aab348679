"""Official SiamAPN++ checkpoints (.pth) into the project's format, without running any code that a pickle may hold."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from tracker.siamapnpp.network import SIZES
from tracker.siamapnpp.settings import TrackerSettings
from tracker.weights import layout
from tracker.weights.card import ARCHITECTURE, INPUT, card_path, sha256_of, write_card
from tracker.weights.errors import WeightsError
from tracker.weights.store import save


def read_checkpoint(path: Path) -> dict[str, torch.Tensor]:
    """Live tensors of an official checkpoint by name, checked. Raises WeightsError.

    `weights_only` restricts the unpickler to tensors and plain containers: a file that would run code is refused.
    """
    if not path.is_file():
        raise WeightsError(f"{path}: no such checkpoint")
    try:
        loaded = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # the unpickler raises whatever a damaged or hostile file provokes
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise WeightsError(
            f"{path}: not a PyTorch checkpoint of plain tensors, nothing was run or imported ({reason})"
        ) from error
    state = loaded.get("state_dict", loaded) if isinstance(loaded, dict) else None
    if not isinstance(state, dict) or not all(isinstance(v, torch.Tensor) for v in state.values()):
        raise WeightsError(f"{path}: holds no state_dict of tensors")
    tensors = layout.strip({str(k): v for k, v in state.items()})
    layout.check(tensors, layout.size_of(tensors, str(path)), str(path))
    return tensors


def import_checkpoint(source: Path, target: Path) -> dict[str, Any]:
    """Convert an official checkpoint to `target` (.safetensors) with a card beside it; returns the card."""
    for existing in (target, card_path(target)):
        if existing.exists():
            raise WeightsError(f"{existing}: exists already; choose another --out or remove it")
    tensors = read_checkpoint(source)
    size = layout.size_of(tensors, str(source))
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        save(target, tensors)
    except OSError as error:
        raise WeightsError(f"{target}: cannot be written ({error})") from error
    settings = TrackerSettings()
    shapes = layout.expected_shapes(SIZES[size])
    card: dict[str, Any] = {
        "name": target.stem,
        "architecture": ARCHITECTURE,
        "size": size,
        "tensors": len(shapes),
        "parameters": sum(v.numel() for k, v in tensors.items() if ".running_" not in k),
        "sha256": sha256_of(target),
        "made_from": f"imported from {source.name}, sha256 {sha256_of(source)}",
        "input": INPUT,
        "tracker_settings": {
            "penalty_k": settings.penalty_k,
            "window": settings.window,
            "size_lr": settings.size_lr,
            "search_px": settings.search_px,
            "class_weights": list(settings.class_weights),
            "centre_term": settings.centre_term.value,
        },
    }
    write_card(target, card)
    return card
