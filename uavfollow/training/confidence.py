"""Fit the confidence of a model on sequences with truth, and put it into a weights card."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tracker.benchmark.reliability import Reliability
from tracker.confidence.features import GROUPS
from tracker.engines.torch_engine import TorchEngine
from tracker.siamapnpp.tracker import SiamAPNTracker
from tracker.training.confidence.collect import Collector, seen_frames
from tracker.training.confidence.fit import Fitted, fitted
from tracker.training.confidence.samples import Sample, Table
from tracker.training.types import Footage
from tracker.training.validate import Tracks
from tracker.weights.card import card_path, read_card, sha256_of, write_card
from tracker.weights.store import SUFFIX, Weights, load
from uavfollow.errors import InputError
from uavfollow.interrupts import orderly_end
from uavfollow.progress import ProgressLine

CARD_SUFFIX = ".json"
NO_FIGURE = "-"
LEAST_WEIGHT = 0.001  # smaller ones are rounded away in the report
HASH_SHOWN = 12  # characters: enough to tell files apart


@dataclass(frozen=True, slots=True)
class ConfidenceReport:
    """What was fitted for a model; `alone` is the fit without the additional sequences, if there are any.

    `sha256` is that of the weights, `frames` how many were looked at, `how` where in the sequences these lie.
    """

    model: str
    sha256: str
    best: Fitted
    alone: Fitted | None
    skipped: tuple[str, ...]
    frames: int
    how: str

    def lines(self) -> list[str]:
        """For the terminal."""
        found = self.best.cross_validated
        lines = [
            f"model {self.model}: {self.best.samples} samples from {self.frames} frames of "
            f"{len(self.best.sequences)} sequences ({self.how}); each sequence judged by a model fitted on the others:",
            _line("while following", found.track),
            _line("tracker's score", found.score),
            _line("with probes", found.all),
            _line("without motion", found.appearance),
        ]
        if self.alone is not None:
            lines.append(_line("fitted without the additional sequences", self.alone.cross_validated.track))
        lines.append("confidence, share on target, samples (while following):")
        lines += [
            f"  {b.low:.1f}-{b.high:.1f}  {_figure(b.on_target_share)}  {b.count:6d}"
            for b in found.track.bins
            if b.count
        ]
        return [*lines, "reason, ROC AUC without it, weights per deviation:", *_reason_lines(self.best)]

    def block(self) -> dict[str, Any]:
        """The `confidence` block of the card, with how the samples were taken."""
        block = self.best.to_card()
        return {**block, "fit": {**block["fit"], "frames": self.frames, "collected": self.how}}

    def as_json(self) -> dict[str, Any]:
        """Plain values; `confidence` is the block of the card."""
        alone = None if self.alone is None else self.alone.fit_block()
        bins = [[b.low, b.high, b.mean_confidence, b.on_target_share, b.count] for b in self._bins()]
        return {
            "model": self.model,
            "sha256": self.sha256,
            "confidence": self.block(),
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

    def words(self) -> str:
        """For reports and cards."""
        return f"{self.tracks.words()}, seed {self.seed}"


@dataclass(frozen=True, slots=True, eq=False)
class Collected:
    """Samples of all sequences, which of them gave none, and how many frames were looked at."""

    samples: list[Sample]
    skipped: tuple[str, ...]
    frames: int


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
    if len(names) < 2:
        raise InputError(f"confidence: {names[0]} alone cannot be judged by another sequence; give at least two")
    if options.threads is not None:
        torch.set_num_threads(options.threads)
    weights = load(model)
    found = _collected(weights, [*judged, *more], options)
    table = Table.of(found.samples)
    kept = [item.name for item in judged if item.name in table.sequences]
    best = fitted(table, kept)
    alone = fitted(table.only(table.rows_of(kept)), kept) if more and len(kept) > 1 else None
    return ConfidenceReport(model, _hash_of(weights), best, alone, found.skipped, found.frames, options.words())


def card_place(model: str, out: Path | None) -> Path:
    """The card that will hold the fit: `out`, or the model's own. To be asked for before the work.

    Raises InputError when it could not be written or is another's, WeightsError when the model is damaged.
    """
    weights = load(model)
    if not weights.card:
        raise InputError(f"{weights.path}: has no card to write into; use --json and keep the block `confidence`")
    place = card_path(weights.path) if out is None else out
    if out is not None:
        _check_name(out)
        _check_owner(out, weights)
    try:
        with tempfile.TemporaryFile(dir=place.parent):  # a card is made beside its place, then moved
            pass
    except OSError as error:
        raise InputError(f"{place}: cannot be written ({error.strerror or error}); choose another place") from error
    return place


def write_confidence(model: str, report: ConfidenceReport, place: Path) -> Path:
    """Write the model's card with the fit to `place` (of `card_place`). Raises InputError, WeightsError.

    The weights are read anew: the work takes minutes, and a fit for other weights would be believed in flight.
    """
    weights = load(model)
    if weights.card.get("sha256") != report.sha256:
        raise InputError(
            f"{weights.path}: weights or card are not those that were fitted any more (sha256 of the fit "
            f"{report.sha256[:HASH_SHOWN]}..., now {_hash_of(weights)[:HASH_SHOWN]}...); nothing is written, fit again"
        )
    try:
        return write_card(place.with_suffix(SUFFIX), {**weights.card, "confidence": report.block()})
    except OSError as error:
        raise InputError(f"{place}: cannot be written ({error.strerror or error}); choose another place") from error


def _check_name(out: Path) -> None:
    if out.is_dir():
        raise InputError(f"--out {out}: is a folder; name the card in it, for example {out / 'card.json'}")
    if out.suffix != CARD_SUFFIX:
        raise InputError(f"--out {out}: is not the name of a card; let it end in {CARD_SUFFIX}")
    if not out.parent.is_dir():
        raise InputError(f"--out {out}: there is no folder {out.parent}; make it first")


def _check_owner(out: Path, weights: Weights) -> None:
    """A card lies beside its weights under the same name: neither may be those of others."""
    mine, beside = _hash_of(weights), out.with_suffix(SUFFIX)
    card = read_card(beside)
    others = {out: card["sha256"]} if card is not None else {}
    if beside.is_file():
        others[beside] = sha256_of(beside)
    for path, found in others.items():
        if found != mine:
            raise InputError(
                f"--out {out}: {path} is of other weights (sha256 {str(found)[:HASH_SHOWN]}..., {weights.path} has "
                f"{mine[:HASH_SHOWN]}...); choose another name"
            )


def _hash_of(weights: Weights) -> str:
    """Of the file; a card was compared with it when it was loaded."""
    return str(weights.card.get("sha256") or sha256_of(weights.path))


def _collected(weights: Weights, footage: Sequence[Footage], options: CollectOptions) -> Collected:
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
    return Collected(samples, tuple(skipped), done)


def _line(what: str, found: Reliability) -> str:
    return (
        f"  {what:16}  ROC AUC {_figure(found.roc_auc)}  ECE {_figure(found.ece)}  Brier {_figure(found.brier)}  "
        f"on target {_figure(found.on_target_share)} of {found.frames}"
    )


def _figure(value: float | None) -> str:
    return NO_FIGURE if value is None else f"{value:.3f}"


def _reason_lines(best: Fitted) -> list[str]:
    """Kinds of evidence, what carries most first; then what belongs to no reason."""
    weights = dict(zip(best.model.names, best.model.weights, strict=True))
    without = best.cross_validated.without
    doubts = sorted(GROUPS, key=lambda doubt: -sum(abs(weights.get(name, 0.0)) for name in GROUPS[doubt]))
    lines = [f"  {d.value:15}  {_figure(without[d]):5}  {_weights_of(GROUPS[d], weights)}" for d in doubts]
    rest = [name for name in weights if not any(name in group for group in GROUPS.values())]
    return [*lines, f"  {'-':15}  {NO_FIGURE:5}  {_weights_of(rest, weights)}"]


def _weights_of(names: Iterable[str], weights: Mapping[str, float]) -> str:
    there = sorted((n for n in names if abs(weights.get(n, 0.0)) >= LEAST_WEIGHT), key=lambda n: -abs(weights[n]))
    return ", ".join(f"{name} {weights[name]:+.3f}" for name in there) or "none"
