"""What a run did, row by row: curve.csv, validation.csv, and a picture of both."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tracker.training.errors import TrainingError
from tracker.training.validate import SequenceScore, mean_score

CURVE = "curve.csv"
VALIDATION = "validation.csv"
PICTURE = "curves.png"
COMMON = ("pairs", "minutes", "stage", "rate", "pairs_per_s", "skipped")
SCORES = ("pairs", "minutes", "sequence", "frames", "auc", "p20")
MEAN = "mean"
OVERLAP = "overlap"  # of `losses`: the mean IoU of the positives
LOWEST_PLOTTED = 1e-4  # a loss of exactly 0 has no place on a logarithmic axis


class Curves:
    """Appends to the two tables of a folder. Every row is on disk when the call returns."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def cut(self, pairs: int) -> None:
        """Drop the rows beyond `pairs`, which a resumed run writes anew, and a last one cut short by a crash."""
        for path in (self._folder / CURVE, self._folder / VALIDATION):
            kept = [row for row in read_rows(path) if int(row["pairs"]) <= pairs]
            if kept:
                _rewrite(path, tuple(kept[0]), kept)
            else:
                path.unlink(missing_ok=True)

    def add(self, common: Mapping[str, object], losses: Mapping[str, float]) -> None:
        """One row of curve.csv: the fields of COMMON, then the losses by name."""
        row = {**common, **{k: f"{v:.5g}" for k, v in losses.items()}}
        _append(self._folder / CURVE, (*COMMON, *losses), row)

    def add_validation(self, pairs: int, minutes: float, scores: Sequence[SequenceScore]) -> None:
        """One row per sequence and one for the mean."""
        mean = mean_score(scores)
        for score in (*scores, mean) if mean else scores:
            row = dict(zip(SCORES, (pairs, f"{minutes:.2f}", score.name, score.frames, *_shown(score)), strict=True))
            _append(self._folder / VALIDATION, SCORES, row)

    def draw(self) -> Path | None:
        """curves.png: losses, rate and validation over pairs; None when there is no row yet."""
        rows = read_rows(self._folder / CURVE)
        if not rows:
            return None
        path = self._folder / PICTURE
        part = path.with_suffix(".part.png")
        _figure(rows, [r for r in read_rows(self._folder / VALIDATION) if r["sequence"] == MEAN], part)
        part.replace(path)
        return path


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a table by column; empty when there is none. A last line cut short by a crash is left out."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            return [row for row in csv.DictReader(file) if None not in row.values() and None not in row]
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise TrainingError(f"{path}: the table cannot be read ({error}); move it away and resume") from error


def _shown(score: SequenceScore) -> tuple[str, str]:
    return ("" if score.auc is None else f"{score.auc:.4f}", "" if score.p20 is None else f"{score.p20:.4f}")


def _append(path: Path, columns: Sequence[str], row: Mapping[str, object]) -> None:
    def write(file: Any) -> None:
        if file.tell() == 0:
            csv.writer(file).writerow(columns)
        csv.DictWriter(file, columns).writerow(row)

    _write(path, "a", write)


def _rewrite(path: Path, columns: Sequence[str], rows: Sequence[Mapping[str, str]]) -> None:
    def write(file: Any) -> None:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)

    part = path.with_suffix(".csv.part")
    _write(part, "w", write)
    part.replace(path)


def _write(path: Path, mode: str, write: Callable[[Any], None]) -> None:
    try:
        with path.open(mode, newline="", encoding="utf-8") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise TrainingError(f"{path}: cannot be written ({error}); make room and resume") from error


def _figure(rows: list[dict[str, str]], scores: list[dict[str, str]], path: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # lazily: only runs that draw need it
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter

    figure = Figure(figsize=(9, 10), layout="constrained")
    FigureCanvasAgg(figure)
    loss_axis, rate_axis, score_axis = figure.subplots(3, 1, sharex=True, height_ratios=(2, 1, 1.5))
    pairs = [int(r["pairs"]) for r in rows]
    for name in [k for k in rows[0] if k not in COMMON]:
        values = [max(float(r[name]), LOWEST_PLOTTED) for r in rows]
        style = {"color": "black", "linestyle": "--"} if name == OVERLAP else {}  # the one that is to rise
        loss_axis.plot(pairs, values, label=name, linewidth=2.0 if name == "total" else 1.0, **style)
    loss_axis.set(yscale="log", ylabel="loss, mean overlap")
    plain = FuncFormatter(lambda value, _: f"{value:g}")  # the powers of ten are set as formulas, which takes a second
    loss_axis.yaxis.set_major_formatter(plain)
    loss_axis.yaxis.set_minor_formatter(FuncFormatter(lambda value, _: ""))
    rate_axis.plot(pairs, [float(r["rate"]) for r in rows], color="tab:gray")
    rate_axis.set(ylabel="learning rate", ylim=(0, None))
    for key, label in (("auc", "AUC"), ("p20", "P20")):
        known = [(int(r["pairs"]), float(r[key])) for r in scores if r[key]]
        score_axis.plot([p for p, _ in known], [v for _, v in known], marker="o", label=label)
    score_axis.set(xlabel="pairs", ylabel="validation, raw tracker", ylim=(0, 1))
    loss_axis.legend(ncols=4, fontsize="small", loc="upper right")
    score_axis.legend(loc="upper left")
    for axis in (loss_axis, rate_axis, score_axis):
        axis.grid(alpha=0.3)
    figure.savefig(path, dpi=100, format="png")
