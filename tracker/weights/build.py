"""From a model's name to a tracker that runs."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tracker.messages import Tracker

if TYPE_CHECKING:
    from tracker.confidence.model import ConfidenceModel


@dataclass(frozen=True, slots=True, eq=False)
class BuiltTracker:
    """A tracker ready for `init`.

    `engine` says what runs it, for reports. `identity` is the hash of all that its results depend on beside the code:
    weights, settings, confidence model, precision. `confidence` is None where none was fitted for it.
    """

    tracker: Tracker
    engine: str
    identity: str
    confidence: ConfidenceModel | None


def build_tracker(
    model: str, precision: str = "auto", device: str = "auto", threads: int | None = None
) -> BuiltTracker:
    """SiamAPN++ with a model's weights and settings. Raises WeightsError or ValueError.

    `threads` are those of the process's PyTorch; None leaves them as they are.
    """
    # Here, so that other trackers come without PyTorch: they take `BuiltTracker` from this module.
    import torch

    from tracker.engines.torch_engine import Precision, TorchEngine
    from tracker.siamapnpp.tracker import SiamAPNTracker
    from tracker.weights.card import sha256_of
    from tracker.weights.store import load

    if threads is not None:
        torch.set_num_threads(threads)
    weights = load(model)
    engine = TorchEngine(weights.network(), Precision(precision), device)
    settings = weights.settings()
    confidence = weights.confidence()
    identity = identity_of(
        weights=sha256_of(weights.path),
        settings=repr(settings),
        confidence=None if confidence is None else confidence.to_card(),
        engine=engine.name,
    )
    return BuiltTracker(SiamAPNTracker(engine, settings), engine.name, identity, confidence)


def identity_of(**parts: Any) -> str:
    """Hash of what results depend on; every part is JSON."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()
