"""Official SiamAPN++ checkpoints (.pth) into the project's format, without running any code that a pickle may hold."""

from __future__ import annotations

import warnings
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
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            loaded = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # the unpickler raises whatever a damaged or hostile file provokes
        # PyTorch's own text is not passed on: it advises to load the file in the way that runs its code.
        raise WeightsError(
            f"{path}: not a PyTorch checkpoint of plain tensors ({type(error).__name__}); nothing was run or imported"
        ) from error
    state = loaded.get("state_dict", loaded) if isinstance(loaded, dict) else None
    if not isinstance(state, dict) or not all(isinstance(v, torch.Tensor) for v in state.values()):
        raise WeightsError(f"{path}: holds no state_dict of tensors")
    dense = all(v.layout is torch.strided and v.device.type == "cpu" for v in state.values())
    if not dense:
        raise WeightsError(f"{path}: holds sparse or empty (meta) tensors, which no SiamAPN++ has")
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
    if not target.parent.is_dir():
        raise WeightsError(f"{target}: there is no folder {target.parent}; make it first")
    save(target, tensors)
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
