"""Cards: what a weights file is, how it was made, how it scored, and the hash that ties the two together."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from tracker.weights.errors import WeightsError

ARCHITECTURE = "siamapnpp"
INPUT = "BGR uint8 values as float 0..255, exemplar 127x127, search 287x287"
REQUIRED = ("name", "architecture", "size", "sha256", "tracker_settings")


def sha256_of(path: Path) -> str:
    """Hash of a file's bytes."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        for block in iter(lambda: file.read(1 << 20), b""):
            digest.update(block)
    return digest.hexdigest()


def card_path(weights: Path) -> Path:
    """The card lies beside its weights: NAME.safetensors, NAME.json."""
    return weights.with_suffix(".json")


def read_card(weights: Path) -> dict[str, Any] | None:
    """The card beside a weights file, None when there is none. Raises WeightsError when it is broken or another's."""
    path = card_path(weights)
    if not path.exists():
        return None
    try:
        card: dict[str, Any] = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise WeightsError(f"{path}: the weights card cannot be read ({error}); remove it or restore it") from error
    missing = [key for key in REQUIRED if not isinstance(card, dict) or key not in card]
    if missing:
        raise WeightsError(f"{path}: the weights card lacks {', '.join(missing)}")
    if card["architecture"] != ARCHITECTURE:
        raise WeightsError(f"{path}: the card is for architecture {card['architecture']!r}, not {ARCHITECTURE!r}")
    if not isinstance(card["tracker_settings"], dict):
        raise WeightsError(f"{path}: tracker_settings must be an object")
    return card


def write_card(weights: Path, card: dict[str, Any]) -> Path:
    """Write the card beside its weights, replacing it whole."""
    path = card_path(weights)
    part = path.with_suffix(".json.part")
    part.write_text(json.dumps(card, indent=1) + "\n")
    part.replace(path)
    return path
