"""Success, precision, calibration and centre-error plots, as PNG files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tracker.benchmark.scores import OVERLAP_THRESHOLDS, PRECISION_PX, PRECISION_THRESHOLDS_PX, Curves
from tracker.messages import Array, TargetStatus
from uavfollow.benchmark.report import Report
from uavfollow.benchmark.scoring import SequenceScore, TrackerScore
from uavfollow.benchmark.store import placed, writing
from uavfollow.record.plots import LEGEND, STATUS_COLOURS

SUCCESS, PRECISION, CALIBRATION = "success.png", "precision.png", "calibration.png"
DPI = 110
COLOURS = ("#2a6fdb", "#d64545", "#3fae49", "#8a4fbf", "#c9a227", "#1aa6a6", "#e377c2", "#7f7f7f")
BAR_SHARE = 0.05  # height of a status bar, of the plot
MOST_ERROR_PX = 40.0 * PRECISION_PX  # beyond it a target is lost, and how far away hides all else
LOUD_PERCENTILE = 98  # of the errors: a few outliers should not flatten the rest
MIN_BIN = 20  # frames: the share of fewer is a guess, shown hollow


def plot_means(report: Report, folder: Path) -> tuple[Path, ...]:
    """The three plots over all compared sequences; returns their paths."""
    scored = [total for total in report.totals if total.curves is not None]
    cut = f", first {report.max_frames} images" if any(score.is_cut for score in report.compared) else ""
    about = f"{len({s.name for s in report.compared})} sequences{cut}, mode {report.mode.value}"
    return (
        _curves(
            folder / SUCCESS, scored, f"success plot, {about}", OVERLAP_THRESHOLDS, lambda c: (c.success, c.auc),
            ("overlap threshold", "success rate"), "AUC",
        ),
        _curves(
            folder / PRECISION, scored, f"precision plot, {about}", PRECISION_THRESHOLDS_PX,
            lambda c: (c.precision, c.p20), ("centre error threshold [px]", "precision"), "P20",
        ),
        _calibration(folder / CALIBRATION, report.totals),
    )  # fmt: skip


def plot_errors(path: Path, scores: Sequence[SequenceScore]) -> None:
    """Centre errors of each tracker over one sequence; a colour bar below for those that have a status."""
    figure, axis = _figure(10.0, 3.6)
    with_status = [score for score in scores if score.statuses is not None]
    for score, colour in _coloured(scores):
        t_s = np.arange(score.frames) / score.fps
        axis.plot(t_s, score.errors_px, color=colour, lw=1.2, label=score.spec.label)
    axis.axhline(PRECISION_PX, color="#666666", ls="--", lw=1, label=f"{PRECISION_PX:g} px")
    top = _top(scores)
    bottom = -top * BAR_SHARE * 1.3 * len(with_status)
    for place, score in enumerate(with_status):
        _status_bar(axis, score, -top * BAR_SHARE * 1.3 * (place + 1), top * BAR_SHARE)
    for status in (s for s in TargetStatus if any(s in (score.statuses or ()) for score in with_status)):
        axis.plot([], [], color=STATUS_COLOURS[status], lw=6, label=status.value)
    bars = f" (bars below: status of {', '.join(s.spec.label for s in with_status)})" if with_status else ""
    axis.set(xlabel="time [s]", ylabel="centre error [px]", title=f"{scores[0].name}{bars}", ylim=(bottom, top))
    axis.set_xlim(0, max(max(s.frames / s.fps for s in scores), 1e-3))
    axis.legend(**LEGEND)
    _save(figure, path)


def _curves(
    path: Path,
    totals: Sequence[TrackerScore],
    title: str,
    thresholds: Array,
    curve: Callable[[Curves], tuple[Array, float]],
    labels: tuple[str, str],
    score: str,
) -> Path:
    figure, axis = _figure(7.0, 5.0)
    for total, colour in _coloured(totals):
        assert total.curves is not None
        values, value = curve(total.curves)
        axis.plot(thresholds, values, color=colour, lw=1.8, label=f"{total.spec.label}: {score} {value:.3f}")
    axis.set(xlabel=labels[0], ylabel=labels[1], title=title, ylim=(0, 1.02), xlim=(thresholds[0], thresholds[-1]))
    if totals:
        axis.legend(fontsize=8)
    _save(figure, path)
    return path


def _calibration(path: Path, totals: Sequence[TrackerScore]) -> Path:
    figure, axis = _figure(6.0, 5.4)
    axis.plot([0, 1], [0, 1], color="#999999", ls="--", lw=1, label="calibrated")
    for total, colour in _coloured(totals):
        trust = total.reliability
        bins = [(b.mean_confidence, b.on_target_share, b.count) for b in trust.bins if b.count]
        value = "-" if trust.roc_auc is None else f"{trust.roc_auc:.3f}"
        label = f"{total.spec.label}: ROC AUC {value}, ECE {'-' if trust.ece is None else f'{trust.ece:.3f}'}"
        axis.plot([b[0] for b in bins], [b[1] for b in bins], color=colour, lw=1.4, label=label)
        for confidence, share, count in bins:
            full = {"color": colour} if count >= MIN_BIN else {"markerfacecolor": "white", "markeredgecolor": colour}
            axis.plot([confidence], [share], "o", **full)
    title = f"calibration (hollow: fewer than {MIN_BIN} frames)"
    axis.set(xlabel="confidence", ylabel="share of frames on target", title=title, xlim=(0, 1), ylim=(0, 1.02))
    axis.legend(fontsize=8)
    _save(figure, path)
    return path


def _status_bar(axis: Any, score: SequenceScore, bottom: float, height: float) -> None:
    statuses = score.statuses or ()
    start = 0
    for index in range(1, len(statuses) + 1):
        if index == len(statuses) or statuses[index] is not statuses[start]:
            span = (start / score.fps, (index - start) / score.fps)
            axis.broken_barh([span], (bottom, height), color=STATUS_COLOURS[statuses[start]], lw=0)
            start = index


def _top(scores: Sequence[SequenceScore]) -> float:
    """Of the axis: most errors, but not those of a target that is lost."""
    errors = np.concatenate([score.errors_px for score in scores])
    finite = errors[np.isfinite(errors)]
    loud = float(np.percentile(finite, LOUD_PERCENTILE)) * 1.2 if finite.size else 0.0
    return min(max(2 * PRECISION_PX, loud), MOST_ERROR_PX)


def _coloured(items: Sequence[Any]) -> list[tuple[Any, str]]:
    return [(item, COLOURS[place % len(COLOURS)]) for place, item in enumerate(items)]


def _figure(width: float, height: float) -> tuple[Figure, Any]:
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots()


def _save(figure: Figure, path: Path) -> None:
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    with placed(path) as part:
        figure.savefig(part, dpi=DPI, format="png")
