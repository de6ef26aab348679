"""What a run did, row by row: curve.csv, validation.csv, and a picture of both."""

from __future__ import annotations

import csv
import itertools
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tracker.training.errors import TrainingError
from tracker.training.validate import SequenceScore, Validated, mean_score

CURVE = "curve.csv"
VALIDATION = "validation.csv"
PICTURE = "curves.png"
COMMON = ("pairs", "minutes", "stage", "rate", "pairs_per_s", "skipped")
SCORES = ("pairs", "minutes", "sequence", "frames", "auc", "p20")
MEAN = "mean"
ENCODING: Any = {"encoding": "utf-8", "errors": "surrogateescape"}  # names of folders may hold any bytes
OVERLAP = "overlap"  # of `losses`: the mean IoU of the positives
NAME, WHOLE, MAYBE = "sequence", ("pairs", "stage", "frames", "skipped"), ("pairs_per_s", "auc", "p20")  # may be empty
LOWEST_PLOTTED = 1e-4  # a loss of exactly 0 has no place on a logarithmic axis


class Curves:
    """Appends to the two tables of a folder. Every row is on disk when the call returns."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def cut(self, pairs: int, validations: Sequence[Validated] = ()) -> list[str]:
        """Back to a checkpoint at `pairs` with these `validations`; the resumed run writes anew what came after.

        Drops damaged rows. A table of something else is moved aside; returns what was, in words.
        """
        curve, scores = self._folder / CURVE, self._folder / VALIDATION
        moved = [note for path in (curve, scores) if (note := _moved_aside(path))]
        kept = {int(row["pairs"]): row for row in reversed(read_rows(curve)) if int(row["pairs"]) <= pairs}
        rows = [kept[at] for at in sorted(kept)]  # the first of several at the same place
        _rewrite(curve, rows)
        _rewrite(
            scores, [row for known in validations for row in _score_rows(known.pairs, known.minutes, known.scores)]
        )
        return moved

    def add(self, common: Mapping[str, object], losses: Mapping[str, float]) -> None:
        """One row of curve.csv: the fields of COMMON, then the losses by name."""
        row = {**common, **{k: f"{v:.5g}" for k, v in losses.items()}}
        _append(self._folder / CURVE, (*COMMON, *losses), row)

    def add_validation(self, pairs: int, minutes: float, scores: Sequence[SequenceScore]) -> None:
        """One row per sequence and one for the mean."""
        for row in _score_rows(pairs, minutes, scores):
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
    """Rows of a table by column; empty when there is none. What a crash or a disk has damaged is left out.

    Raises TrainingError for a table of something else, or one that cannot be read.
    """
    header, *lines = _fields_of_lines(path) or [[]]
    if header and not _is_ours(header):
        raise TrainingError(f"{path}: not a curve of this program; move it away and resume")
    rows = (dict(zip(header, line, strict=True)) for line in lines if len(line) == len(header))
    return [row for row in rows if all(_is_sound(key, value) for key, value in row.items())]


def _fields_of_lines(path: Path) -> list[list[str]]:
    """Of every whole line; each is read alone, as a torn quote would swallow those after it."""
    whole = _text(path).split("\n")[:-1]  # what no newline ends was cut short by a crash
    return [fields for line in whole if (fields := _fields(line.rstrip("\r")))]


def _text(path: Path) -> str:
    try:
        with path.open(newline="", **ENCODING) as file:
            return str(file.read())
    except FileNotFoundError:
        return ""
    except OSError as error:
        raise TrainingError(f"{path}: the table cannot be read ({error}); move it away and resume") from error


def _fields(line: str) -> list[str]:
    try:
        return next(csv.reader([line]), [])
    except csv.Error:
        return []


def _is_ours(header: Sequence[str]) -> bool:
    return tuple(header[: len(COMMON)]) == COMMON or tuple(header) == SCORES


def _is_sound(key: str, value: str) -> bool:
    if key == NAME or (key in MAYBE and not value):
        return True
    try:
        (int if key in WHOLE else float)(value)
    except ValueError:
        return False
    return True


def _moved_aside(path: Path) -> str | None:
    """Make way for a table of ours; None when nothing stood there."""
    text, lines = _text(path), _fields_of_lines(path)
    torn = any(",".join(columns).startswith(text[: len(",".join(columns))]) for columns in (COMMON, SCORES))
    if _is_ours(lines[0]) if lines else torn:
        return None
    names = (path.with_name(f"{path.name}.old{n or ''}") for n in itertools.count())
    aside = next(name for name in names if not name.exists())
    try:
        path.replace(aside)
    except OSError as error:
        raise TrainingError(f"{path}: not a curve of this program ({error}); move it away and resume") from error
    return f"{path.name} was not a curve of this program and is {aside.name} now"


def _score_rows(pairs: int, minutes: float, scores: Sequence[SequenceScore]) -> list[dict[str, object]]:
    mean = mean_score(scores)
    values = ((pairs, f"{minutes:.2f}", s.name, s.frames, *_shown(s)) for s in (*scores, *([mean] if mean else [])))
    return [dict(zip(SCORES, row, strict=True)) for row in values]


def _shown(score: SequenceScore) -> tuple[str, str]:
    return ("" if score.auc is None else f"{score.auc:.4f}", "" if score.p20 is None else f"{score.p20:.4f}")


def _append(path: Path, columns: Sequence[str], row: Mapping[str, object]) -> None:
    def write(file: Any) -> None:
        if file.tell() == 0:
            csv.writer(file).writerow(columns)
        csv.DictWriter(file, columns).writerow(row)

    _write(path, "a", write)


def _rewrite(path: Path, rows: Sequence[Mapping[str, object]]) -> None:
    """No rows: no file."""
    if not rows:
        path.unlink(missing_ok=True)
        return

    def write(file: Any) -> None:
        writer = csv.DictWriter(file, tuple(rows[0]))
        writer.writeheader()
        writer.writerows(rows)

    part = path.with_suffix(".csv.part")
    _write(part, "w", write)
    part.replace(path)


def _write(path: Path, mode: str, write: Callable[[Any], None]) -> None:
    try:
        with path.open(mode, newline="", **ENCODING) as file:
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
