"""What a benchmark writes beside its results: table.md, summary.csv, summary.json and the plots."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tracker.benchmark.long_term import LongTerm
from tracker.benchmark.reliability import Reliability
from tracker.benchmark.scores import Curves
from tracker.benchmark.shares import Share
from uavfollow import __version__
from uavfollow.benchmark.plots import plot_errors, plot_means
from uavfollow.benchmark.report import Report
from uavfollow.benchmark.scoring import SequenceScore, TrackerScore, by_attribute
from uavfollow.benchmark.store import placed, write_json
from uavfollow.benchmark.tables import as_markdown

TABLE, SUMMARY_CSV, SUMMARY_JSON, PLOTS = "table.md", "summary.csv", "summary.json", "plots"
COLUMNS = (
    "tracker", "dataset", "sequence", "frames", "auc", "p20", "norm_p20", "norm_auc", "honest_lock_share",
    "false_confirmed_share", "losses", "leave_s", "back_in_30_frames", "back_in_1_s", "chances", "wrong_writes",
    "writes", "frames_per_s",
)  # fmt: skip


def write_report(report: Report, folder: Path, tick: Callable[[int, int], None]) -> list[Path]:
    """Everything, each file replaced whole; returns the paths. `tick`(plots done, of) is called as it goes."""
    with placed(folder / TABLE) as part:
        part.write_text(as_markdown(report), encoding="utf-8")
    _write_csv(report, folder / SUMMARY_CSV)
    write_json(folder / SUMMARY_JSON, as_json(report))
    means = plot_means(report, folder)
    for done, name in enumerate(report.names):
        tick(done, len(report.names))
        plot_errors(folder / PLOTS / f"{name}.png", [score for score in report.scores if score.name == name])
    return [folder / TABLE, folder / SUMMARY_CSV, folder / SUMMARY_JSON, *means, folder / PLOTS]


def as_json(report: Report) -> dict[str, Any]:
    """Plain values; what is undefined is None."""
    trackers = {}
    for total in report.totals:
        own = [score for score in report.scores if score.spec == total.spec]
        attributes = by_attribute(score for score in report.compared if score.spec == total.spec)
        trackers[total.spec.label] = {
            "spec": str(total.spec),
            "engine": report.engines[total.spec],
            "sequences": total.sequences,
            **_values(total),
            "reliability": _reliability(total.reliability),
            "curves": _curves(total.curves),
            "attributes": {n: {"auc": a, "p20": p, "sequences": c} for n, (a, p, c) in attributes.items()},
            "by_sequence": {score.name: {"frames": score.frames, **_values(score)} for score in own},
        }
    return {
        "schema": 1,
        "version": __version__,
        "mode": report.mode.value,
        "cpu": report.cpu,
        "compared": sorted({score.name for score in report.compared}),
        "trackers": trackers,
        "failures": [asdict(failure) for failure in report.failures],
    }


def _write_csv(report: Report, path: Path) -> None:
    """A row for each tracker and sequence."""
    with placed(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for score in report.scores:
            values, long = _values(score), score.long_term
            sequence = score.name.partition("/")[2]
            row = [score.spec.label, score.dataset, sequence, score.frames]
            row += [values[name] for name in ("auc", "p20", "norm_p20", "norm_auc")]
            row += [values["honest_lock_share"], values["false_confirmed_share"], long.losses, long.leave_s]
            row += [long.back_in_frames.hits, long.back_in_s.hits, long.back_in_frames.of]
            row += [long.wrong_writes.hits, long.wrong_writes.of, values["frames_per_s"]]
            writer.writerow([_cell(value) for value in row])


def _cell(value: object) -> object:
    """Numbers as short as they are true; what is undefined is empty."""
    return "" if value is None else f"{value:.5g}" if isinstance(value, float) else value


def _values(score: SequenceScore | TrackerScore) -> dict[str, Any]:
    curves, long = score.curves, score.long_term
    return {
        "auc": curves.auc if curves else None,
        "p20": curves.p20 if curves else None,
        "norm_p20": curves.norm_p20 if curves else None,
        "norm_auc": curves.norm_auc if curves else None,
        "honest_lock_share": long.honest_lock.value,
        "false_confirmed_share": long.false_confirmed.value,
        "long_term": _long_term(long),
        "frames_per_s": score.frames_per_s,
    }


def _long_term(long: LongTerm) -> dict[str, Any]:
    return {
        "false_confirmed": _share(long.false_confirmed),
        "honest_lock": _share(long.honest_lock),
        "locked_after_loss_s": list(long.locked_after_loss_s),
        "leave_s": long.leave_s,
        "left_in_time": _share(long.left_in_time),
        "never_left": long.never_left,
        "back_in_frames": _share(long.back_in_frames),
        "back_in_s": _share(long.back_in_s),
        "wrong_writes": _share(long.wrong_writes),
    }


def _share(share: Share) -> dict[str, int]:
    return {"hits": share.hits, "of": share.of}


def _reliability(trust: Reliability) -> dict[str, Any]:
    return {**asdict(trust), "bins": [asdict(bin_) for bin_ in trust.bins]}


def _curves(curves: Curves | None) -> dict[str, list[float]] | None:
    if curves is None:
        return None
    names = ("success", "precision", "norm_precision")
    return {name: [round(float(v), 6) for v in getattr(curves, name)] for name in names}
