"""Fit the confidence of a model on sequences with truth, and put it into a weights card."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tracker.benchmark.reliability import Reliability
from tracker.engines.torch_engine import TorchEngine
from tracker.siamapnpp.tracker import SiamAPNTracker
from tracker.training.confidence.collect import Collector, seen_frames
from tracker.training.confidence.fit import Fitted, fitted
from tracker.training.confidence.samples import Sample, Table
from tracker.training.types import Footage
from tracker.training.validate import Tracks
from tracker.weights.card import card_path, write_card
from tracker.weights.store import Weights, load
from uavfollow.errors import InputError
from uavfollow.interrupts import orderly_end
from uavfollow.progress import ProgressLine

NO_FIGURE = "-"


@dataclass(frozen=True, slots=True)
class ConfidenceReport:
    """What was fitted for a model; `alone` is the fit without the additional sequences, if there are any."""

    model: str
    best: Fitted
    alone: Fitted | None
    skipped: tuple[str, ...]

    def lines(self) -> list[str]:
        """For the terminal."""
        found = self.best.cross_validated
        lines = [
            f"model {self.model}: {self.best.samples} samples of {len(self.best.sequences)} sequences; "
            "each sequence judged by a model fitted on the others:",
            _line("while following", found.track),
            _line("with probes", found.all),
            _line("without motion", found.appearance),
            _line("tracker's score", found.score),
        ]
        if self.alone is not None:
            lines.append(_line("fitted without the additional sequences", self.alone.cross_validated.track))
        lines += [f"  without {doubt.value}: ROC AUC {_figure(auc)}" for doubt, auc in found.without.items()]
        lines.append("confidence, share on target, samples (while following):")
        lines += [
            f"  {b.low:.1f}-{b.high:.1f}  {_figure(b.on_target_share)}  {b.count:6d}"
            for b in found.track.bins
            if b.count
        ]
        return [*lines, "weight per deviation:", *_weight_lines(self.best)]

    def as_json(self) -> dict[str, Any]:
        """Plain values; `confidence` is the block of the card."""
        alone = None if self.alone is None else self.alone.fit_block()
        bins = [[b.low, b.high, b.mean_confidence, b.on_target_share, b.count] for b in self._bins()]
        return {
            "model": self.model,
            "confidence": self.best.to_card(),
            "without_additional": alone,
            "reliability": bins,
            "skipped": list(self.skipped),
        }

    def _bins(self) -> Sequence[Any]:
        return self.best.cross_validated.track.bins


@dataclass(frozen=True, slots=True)
class CollectOptions:
    """How to collect: the stretches of each sequence, the seed of the probes' places, threads of the network."""

    tracks: Tracks
    seed: int
    threads: int | None


def confidence_of(
    model: str, judged: Sequence[Footage], more: Sequence[Footage], options: CollectOptions
) -> ConfidenceReport:
    """Collect and fit. `more` is only fitted on, the figures are those of `judged`. Raises InputError, TrainingError,
    WeightsError, KeyboardInterrupt on a signal.
    """
    if not judged:
        raise InputError("no sequence to fit on: name some, or add sources to the recipe's validation")
    names = [item.name for item in (*judged, *more)]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"sequences given twice: {', '.join(twice)}; a model would be judged by what it was fitted on")
    if options.threads is not None:
        torch.set_num_threads(options.threads)
    samples, skipped = _collected(load(model), [*judged, *more], options)
    table = Table.of(samples)
    kept = [item.name for item in judged if item.name in table.sequences]
    best = fitted(table, kept)
    alone = fitted(table.only(table.rows_of(kept)), kept) if more and len(kept) > 1 else None
    return ConfidenceReport(model, best, alone, skipped)


def write_confidence(model: str, report: ConfidenceReport, out: Path | None) -> Path:
    """Put the block into a copy of the model's card at `out`, or into its own card. Raises InputError, WeightsError."""
    weights = load(model)
    if not weights.card:
        raise InputError(f"{weights.path}: has no card to write into; use --json and keep the block `confidence`")
    card = {**weights.card, "confidence": report.best.to_card()}
    try:
        if out is None:
            return write_card(weights.path, card)
        out.write_text(json.dumps(card, indent=1, allow_nan=False) + "\n")
    except OSError as error:
        raise InputError(
            f"{out or card_path(weights.path)}: cannot be written ({error}); choose another place"
        ) from error
    return out


def _collected(
    weights: Weights, footage: Sequence[Footage], options: CollectOptions
) -> tuple[list[Sample], tuple[str, ...]]:
    """Samples of all sequences; and which gave none."""
    engine = TorchEngine(weights.network())
    settings = weights.settings()
    line, done = ProgressLine(), 0
    total = sum(len(frames) for item in footage for frames in seen_frames(options.tracks, len(item.truth)))

    def count() -> bool:  # asked before every frame
        nonlocal done
        done += 1
        if line.due_s() is not None:
            line.write(f"{done}/{total} frames")
        return False

    samples: list[Sample] = []
    skipped: list[str] = []
    try:
        with orderly_end():
            for number, item in enumerate(footage):
                rng = np.random.default_rng([options.seed, number])
                collector = Collector(lambda: SiamAPNTracker(engine, settings), options.tracks, footage, rng, count)
                found = collector.samples(item) or []
                samples += found
                if not found:
                    skipped.append(f"{item.name}: no frame with a usable target and a picture after it")
    finally:
        line.close()
    return samples, tuple(skipped)


def _line(what: str, found: Reliability) -> str:
    return (
        f"  {what:16}  ROC AUC {_figure(found.roc_auc)}  ECE {_figure(found.ece)}  Brier {_figure(found.brier)}  "
        f"on target {_figure(found.on_target_share)} of {found.frames}"
    )


def _figure(value: float | None) -> str:
    return NO_FIGURE if value is None else f"{value:.3f}"


def _weight_lines(best: Fitted) -> list[str]:
    pairs = sorted(zip(best.model.names, best.model.weights, strict=True), key=lambda pair: -abs(pair[1]))
    return [f"  {name:20} {weight:+.3f}" for name, weight in pairs if abs(weight) >= 0.001]
