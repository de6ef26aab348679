"""Finding and loading weights: by the name of an embedded size or by file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from tracker.confidence.model import ConfidenceModel
from tracker.siamapnpp.network import SIZES, SiamAPNpp
from tracker.siamapnpp.settings import TrackerSettings
from tracker.weights import layout
from tracker.weights.card import card_path, read_card, sha256_of
from tracker.weights.errors import WeightsError

EMBEDDED = Path(__file__).resolve().parent / "embedded"
EMBEDDED_FILES = {size: EMBEDDED / f"siamapnpp-{size}-bootstrap.safetensors" for size in SIZES}
SUFFIX = ".safetensors"
READABLE_BY_ALL = 0o644


@dataclass(frozen=True, slots=True, eq=False)
class Weights:
    """A checked set of tensors (fp32) with its card; `card` is empty for a file without one."""

    path: Path
    size: str
    tensors: dict[str, torch.Tensor]
    card: dict[str, Any]

    def network(self) -> SiamAPNpp:
        """A network in eval mode that holds these weights."""
        network = SiamAPNpp(SIZES[self.size])
        state = network.state_dict()
        counters = {k: v for k, v in state.items() if k.endswith(layout.COUNTER)}
        network.load_state_dict({**self.tensors, **counters})
        return network.eval()

    def settings(self) -> TrackerSettings:
        """The tracker's settings that the card asks for, the paper's without a card."""
        try:
            return TrackerSettings.from_card(self.card.get("tracker_settings", {}))
        except ValueError as error:
            raise WeightsError(f"{self.path}: {error}") from error

    def confidence(self) -> ConfidenceModel | None:
        """The confidence model fitted for these weights, None when the card has none. Raises WeightsError."""
        block = self.card.get("confidence")
        if block is None:
            return None
        try:
            return ConfidenceModel.from_card(block)
        except ValueError as error:
            raise WeightsError(f"{card_path(self.path)}: {error}") from error


def find(model: str) -> Path:
    """File of a model: `s`, `full` or a path. Raises WeightsError when there is none."""
    if model in EMBEDDED_FILES:
        path = EMBEDDED_FILES[model]
        if not path.is_file():
            raise WeightsError(f"{path}: the embedded weights `{model}` are missing; reinstall uavfollow")
        return path
    path = Path(model)
    if not path.is_file():
        raise WeightsError(f"{model}: no such weights file (a model is `s`, `full` or a {SUFFIX} file)")
    return path


def load(model: str) -> Weights:
    """Load and check a model: `s`, `full` or a safetensors file. Raises WeightsError."""
    path = find(model)
    if path.suffix in {".pth", ".pt", ".tar"}:
        raise WeightsError(f"{path}: a PyTorch checkpoint; convert it first: uavfollow weights import {path}")
    card = read_card(path)
    if card is not None and card["sha256"] != sha256_of(path):
        raise WeightsError(f"{path}: does not match the sha256 of its card; the file is damaged or was replaced")
    try:
        raw = load_file(path)
    except (SafetensorError, OSError, ValueError) as error:
        raise WeightsError(f"{path}: not a safetensors file ({error})") from error
    tensors = layout.strip(raw)
    size = layout.size_of(tensors, str(path))
    layout.check(tensors, size, str(path))
    if card is not None and card["size"] != size:
        raise WeightsError(f"{path}: the card says size {card['size']!r}, the tensors are `{size}`")
    return Weights(path, size, {k: v.float() for k, v in tensors.items()}, card or {})


def save(path: Path, tensors: layout.Tensors) -> None:
    """Write tensors as the project stores them: fp16, one-dimensional ones fp32, replacing the file whole.

    One-dimensional tensors stay fp32 because a BatchNorm variance of layer 1 exceeds fp16. Raises WeightsError when
    another value does.
    """
    stored = {k: (v.half() if v.ndim > 1 else v.float()).contiguous() for k, v in layout.strip(tensors).items()}
    too_large = [k for k, v in stored.items() if not bool(torch.isfinite(v).all())]
    if too_large:
        raise WeightsError(f"{path}: values beyond fp16 in {', '.join(too_large[: layout.LISTED])}")
    part = path.with_suffix(path.suffix + ".part")
    try:
        save_file(stored, part)
        part.chmod(READABLE_BY_ALL)  # safetensors makes it private
        part.replace(path)
    except (OSError, SafetensorError) as error:
        if part.is_file():
            part.unlink()
        raise WeightsError(f"{path}: cannot be written ({error}); choose another place") from error
