"""What a benchmark writes beside its results: table.md, summary.csv, summary.json and the plots."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tracker.benchmark.long_term import BACK_WITHIN_FRAMES, BACK_WITHIN_S, LEAVE_WITHIN_S, USEFUL_IOU
from tracker.benchmark.reliability import Reliability
from tracker.benchmark.scores import ON_TARGET_IOU, PRECISION_PX, Curves
from uavfollow import __version__
from uavfollow.benchmark import store
from uavfollow.benchmark.coverage import coverages, notes
from uavfollow.benchmark.plots import plot_errors, plot_means
from uavfollow.benchmark.report import Report
from uavfollow.benchmark.scoring import SequenceScore, TrackerScore, by_attribute
from uavfollow.benchmark.store import placed, write_json
from uavfollow.benchmark.tables import as_markdown

SCHEMA = 2  # of summary.json
TABLE, SUMMARY_CSV, SUMMARY_JSON, PLOTS = "table.md", "summary.csv", "summary.json", "plots"

# The numbers of summary.csv and summary.json go by the same names, each told here once.
ABOUT = {
    "tracker": "NAME[@MODEL][+raw]",
    "dataset": "data set, as the folder of its results is called",
    "sequence": "sequence, as its results are called",
    "whole_frames": "images that the data set has of the sequence; more than frames: it was cut by --max-frames",
    "fps": "images per second at which it was tracked",
}
VALUES = {
    "frames": "images tracked",
    "unread_frames": "images that could not be read: steps without a picture",
    "auc": "area under the success curve, 0 to 1",
    "p20": f"precision: share of frames with a centre error of at most {PRECISION_PX:g} px",
    "norm_p20": "normalised precision: the same with the error in target sizes, at 0.2",
    "norm_auc": "area under the curve of normalised precision",
    "honest_lock_share": f"LOCKED, of the frames whose box overlaps the target by more than {USEFUL_IOU:g}",
    "false_confirmed_share": f"LOCKED while the target is absent or overlapped by less than {ON_TARGET_IOU:g}, of all",
    "losses": "true losses: LOCKED on the target, and in the next frame it is absent or the box is off it",
    "leave_locked_median_s": "median time that the status stays LOCKED after a loss",
    "left_in_time": f"losses after which it was left within {LEAVE_WITHIN_S:g} s",
    "left_in_time_of": "losses of which that can be said",
    "never_left": "losses that the status never showed",
    "reacquired_in_frames": f"chances after which the target was followed within {BACK_WITHIN_FRAMES} frames",
    "reacquired_in_frames_of": "chances to get the target back whose target stays as long",
    "reacquired_in_time": f"chances after which the target was followed within {BACK_WITHIN_S:g} s",
    "reacquired_in_time_of": "chances to get the target back whose target stays as long",
    "wrong_writes": "boxes written to the tracker's memory that were not on the target",
    "writes": "boxes written to it",
    "speed_frames_per_s": "speed of tracker and target estimate by one thread, without reading images",
}
COLUMNS = {**ABOUT, **VALUES}


def write_report(report: Report, folder: Path, tick: Callable[[int, int], None]) -> list[Path]:
    """Everything, each file replaced whole; returns the paths. `tick`(plots done, of) is called as it goes.

    Raises InputError, which names the file, when one cannot be written.
    """
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
    return {
        "schema": SCHEMA,
        "version": __version__,
        "mode": report.mode.value,
        "max_frames": report.max_frames,
        "fps": report.fps,
        "cpu": report.cpu,
        "scored": [asdict(one) for one in coverages(report)],
        "notes": notes(report),
        "compared": sorted({score.name for score in report.compared}),
        "trackers": {total.spec.label: _tracker(report, total) for total in report.totals},
        "further_trackers": list(report.further),
        "failures": [asdict(failure) for failure in report.failures],
        "columns": COLUMNS,
        "frame_columns": store.COLUMNS,
    }


def _tracker(report: Report, total: TrackerScore) -> dict[str, Any]:
    own = [score for score in report.scores if score.spec == total.spec]
    attributes = by_attribute(score for score in report.compared if score.spec == total.spec)
    return {
        "spec": str(total.spec),
        "engine": report.engines[total.spec],
        "sequences": total.sequences,
        **_values(total),
        "reliability": _reliability(total.reliability),
        "curves": _curves(total.curves),
        "attributes": {n: {"auc": a, "p20": p, "sequences": c} for n, (a, p, c) in attributes.items()},
        "by_sequence": {
            score.name: {
                "whole_frames": score.whole_frames,
                "fps": score.fps,
                **_values(score),
                "locked_after_loss_s": list(score.long_term.locked_after_loss_s),
            }
            for score in own
        },
    }


def _write_csv(report: Report, path: Path) -> None:
    """A row for each tracker and sequence."""
    with placed(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for score in report.scores:
            dataset, _, sequence = score.name.partition("/")
            about = (score.spec.label, dataset, sequence, score.whole_frames, score.fps)
            values = _values(score)
            writer.writerow([_cell(value) for value in (*about, *(values[name] for name in VALUES))])


def _cell(value: object) -> object:
    """Numbers as short as they are true; what is undefined is empty."""
    return "" if value is None else f"{value:.5g}" if isinstance(value, float) else value


def _values(score: SequenceScore | TrackerScore) -> dict[str, Any]:
    """By the names of `VALUES`."""
    curves, long = score.curves, score.long_term
    return {
        "frames": score.frames,
        "unread_frames": score.unread_frames,
        "auc": curves.auc if curves else None,
        "p20": curves.p20 if curves else None,
        "norm_p20": curves.norm_p20 if curves else None,
        "norm_auc": curves.norm_auc if curves else None,
        "honest_lock_share": long.honest_lock.value,
        "false_confirmed_share": long.false_confirmed.value,
        "losses": long.losses,
        "leave_locked_median_s": long.leave_s,
        "left_in_time": long.left_in_time.hits,
        "left_in_time_of": long.left_in_time.of,
        "never_left": long.never_left,
        "reacquired_in_frames": long.back_in_frames.hits,
        "reacquired_in_frames_of": long.back_in_frames.of,
        "reacquired_in_time": long.back_in_s.hits,
        "reacquired_in_time_of": long.back_in_s.of,
        "wrong_writes": long.wrong_writes.hits,
        "writes": long.wrong_writes.of,
        "speed_frames_per_s": score.speed_frames_per_s,
    }


def _reliability(trust: Reliability) -> dict[str, Any]:
    return {**asdict(trust), "bins": [asdict(bin_) for bin_ in trust.bins]}


def _curves(curves: Curves | None) -> dict[str, list[float]] | None:
    if curves is None:
        return None
    names = ("success", "precision", "norm_precision")
    return {name: [round(float(v), 6) for v in getattr(curves, name)] for name in names}
