"""From a model's name to a tracker that runs."""

from __future__ import annotations

from tracker.engines.torch_engine import Precision, TorchEngine
from tracker.siamapnpp.tracker import SiamAPNTracker
from tracker.weights.store import load


def build_tracker(model: str, precision: str = "auto", device: str = "auto") -> tuple[SiamAPNTracker, str]:
    """SiamAPN++ with a model's weights and settings, and the engine's name. Raises WeightsError or ValueError."""
    weights = load(model)
    engine = TorchEngine(weights.network(), Precision(precision), device)
    return SiamAPNTracker(engine, weights.settings()), engine.name
