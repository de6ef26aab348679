"""table.md and the lines for the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from tracker.benchmark.attributes import NAMES
from tracker.benchmark.long_term import BACK_WITHIN_FRAMES, BACK_WITHIN_S, LEAVE_WITHIN_S, USEFUL_IOU
from tracker.benchmark.scores import ON_TARGET_IOU, Curves, Mode
from tracker.benchmark.shares import Share
from uavfollow.benchmark import published
from uavfollow.benchmark.coverage import Coverage, coverages, differences, notes, published_share
from uavfollow.benchmark.report import Report
from uavfollow.benchmark.scoring import SequenceScore, TrackerScore, by_attribute

NONE = "-"
MODES = {
    Mode.HONEST: "frames without a target count for nothing, frames without a box are misses",
    Mode.TOOLKIT: "as the toolkit of the published tables counts: frames without a target fail in success and are "
    "hits in precision",
}
SCORES = "AUC / P20 / normalised P"


def as_markdown(report: Report) -> str:
    """The whole page."""
    parts = [
        _head(report), _coverage(report), _scores(report), _honesty(report), _attributes(report), _failures(report),
    ]  # fmt: skip
    return "\n".join(line for part in parts for line in part)


def as_text(report: Report) -> list[str]:
    """The means and what they are made of, for the terminal."""
    rows: list[tuple[str, ...]] = [("", "AUC", "P20", "norm P", "honest lock", "false conf.", "ROC AUC", "frames/s")]
    for total in report.totals:
        long, curves = total.long_term, total.curves
        values = (curves.auc, curves.p20, curves.norm_p20) if curves else (None, None, None)
        rest = (_percent(long.honest_lock), _percent(long.false_confirmed), _number(total.reliability.roc_auc))
        rows.append((total.spec.label, *map(_number, values), *rest, _rate(total.speed_frames_per_s)))
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = [
        "  ".join([row[0].ljust(widths[0]), *(v.rjust(w) for v, w in zip(row[1:], widths[1:], strict=True))])
        for row in rows
    ]
    found = coverages(report)
    sequences, frames = sum(one.sequences for one in found), sum(one.frames for one in found)
    rates = ", ".join(f"{one.dataset} at {_fps(one, report)} images/s" for one in found)
    about = f"mean of {sequences} sequences, {frames} images, mode {report.mode.value}"
    return [f"{about} ({rates})" if rates else about, *lines, *notes(report)]


def _head(report: Report) -> list[str]:
    engines = ", ".join(f"{spec.label} ({engine})" for spec, engine in report.engines.items())
    return [
        "# Tracker benchmark",
        "",
        f"Mode `{report.mode.value}`: {MODES[report.mode]}. While a tracker is not LOCKED the scored box is its "
        "prediction.",
        "",
        f"Trackers: {engines}; one thread each. Processor of this table: {report.cpu}.",
    ]


def _coverage(report: Report) -> list[str]:
    columns = ("data set", "sequences scored", "images scored", "images per second", "images not read")
    lines = ["", "## What was scored", "", *_header(columns)]
    for one in coverages(report):
        sequences = f"{one.sequences} of {one.size}" if one.size is not None else str(one.sequences)
        cut = f" of {one.whole_frames} (cut by --max-frames {report.max_frames})" if one.cut_sequences else ""
        cells = (f"{one.frames}{cut}", _fps(one, report), str(one.unread_frames))
        lines.append(_line([one.dataset, sequences, *cells]))
    return [*lines, *(line for note in notes(report) for line in ("", note))]


def _fps(one: Coverage, report: Report) -> str:
    rates = ", ".join(f"{rate:g}" for rate in one.fps)
    if report.fps is not None:
        return f"{rates} (--fps)"
    return f"{rates} (assumed)" if one.is_rate_assumed else rates


def _scores(report: Report) -> list[str]:
    lines = ["", f"## {SCORES}", "", *_header(["sequence", "frames", *(s.label for s in report.specs)])]
    for name in report.names:
        found = [report.score_of(spec, name) for spec in report.specs]
        cells = [NONE if score is None else _triple(score.curves) for score in found]
        lines.append(_line([name, _frames_of([score for score in found if score is not None]), *cells]))
    means = [(f"mean of {dataset}", report.total_of(dataset)) for dataset in report.datasets]
    for title, totals in [*(means if len(means) > 1 else []), ("mean", report.totals)]:
        cells = [f"**{_triple(total.curves)}**" for total in totals]
        lines.append(_line([f"**{title}** ({totals[0].sequences} sequences)", _frames(totals), *cells]))
    lines.append(_line(["speed, frames per second", "", *(_rate(total.speed_frames_per_s) for total in report.totals)]))
    return lines


def _honesty(report: Report) -> list[str]:
    columns = (
        "tracker", "honest_lock_share", "false_confirmed_share", "still LOCKED after a loss",
        f"left in {LEAVE_WITHIN_S:g} s", f"re-acquired in {BACK_WITHIN_FRAMES} frames", f"in {BACK_WITHIN_S:g} s",
        "wrong memory writes", "ROC AUC", "ECE",
    )  # fmt: skip
    lines = ["", "## Is it honest, and does it get its target back?", "", *_header(columns)]
    for total in report.totals:
        long, trust = total.long_term, total.reliability
        stay = NONE if long.leave_s is None else f"{long.leave_s:.2f} s"
        shares = (long.left_in_time, long.back_in_frames, long.back_in_s, long.wrong_writes)
        cells = [_percent(long.honest_lock), _percent(long.false_confirmed), stay, *map(_count, shares)]
        lines.append(_line([total.spec.label, *cells, _number(trust.roc_auc), _number(trust.ece)]))
    return [
        *lines,
        "",
        f"honest_lock_share: LOCKED, of the frames whose box overlaps the target by more than {USEFUL_IOU:g}. "
        "false_confirmed_share: LOCKED while the target is absent or the overlap is below "
        f"{ON_TARGET_IOU:g}, of all frames. Frames, losses and chances of all sequences are pooled; the time LOCKED "
        "after a loss is the median. A bare tracker (`+raw`) counts as LOCKED in every frame; its confidence is its "
        "score. summary.json tells of every column of summary.csv.",
    ]


def _attributes(report: Report) -> list[str]:
    own = [by_attribute(s for s in report.compared if s.spec == spec) for spec in report.specs]
    if not own or not own[0]:
        return []
    lines = ["", "## By attribute: AUC / P20", ""]
    shared = [name for name in published.ATTRIBUTES if name in own[0]]
    others = [name for name in own[0] if name not in shared]
    if shared:
        titles = [f"{name} ({NAMES[name]}), {own[0][name][2]} sequences" for name in shared]
        lines += _header(["tracker", *titles])
        differs = differences(report)
        ours = _ours(report) if differs else ""
        for spec, scores in zip(report.specs, own, strict=True):
            lines.append(_line([f"{spec.label}{ours}", *(_pair(*scores[name][:2]) for name in shared)]))
        for row in published.TABLE_I:
            lines.append(_line([f"{row.tracker} (published)", *(_pair(*row.scores(name)) for name in shared)]))
        warning = f" **Do not compare directly**: ours {'; '.join(differs)}." if differs else ""
        lines += ["", f"Published: {published.SOURCE}.{warning}", ""]
    if others:
        lines += _header(["attribute", "sequences", *(spec.label for spec in report.specs)])
        lines += [_line([name, str(own[0][name][2]), *(_pair(*scores[name][:2]) for scores in own)]) for name in others]
    return lines


def _ours(report: Report) -> str:
    """Stands in our rows beside the published ones, so that no row is read without it."""
    count, of = published_share(report)
    cut = ", cut" if any(score.is_cut for score in report.compared) else ""
    return f" (ours: {count} of {of} sequences{cut})"


def _failures(report: Report) -> list[str]:
    if not report.failures:
        return [""]
    return ["", f"## Not scored ({len(report.failures)})", "", *(f"- {failure}" for failure in report.failures), ""]


def _frames_of(scores: Sequence[SequenceScore]) -> str:
    """Of one sequence; its trackers saw the same images."""
    one, unread = scores[0], max(score.unread_frames for score in scores)
    cut = f" of {one.whole_frames}" if one.is_cut else ""
    return f"{one.frames}{cut}{f', {unread} not read' if unread else ''}"


def _frames(totals: Sequence[TrackerScore]) -> str:
    return "" if totals[0].curves is None else f"{totals[0].curves.frames} counted"


def _triple(curves: Curves | None) -> str:
    return NONE if curves is None else f"{curves.auc:.3f} / {curves.p20:.3f} / {curves.norm_p20:.3f}"


def _pair(auc: float, p20: float) -> str:
    return f"{auc:.3f} / {p20:.3f}"


def _number(value: float | None) -> str:
    return NONE if value is None else f"{value:.3f}"


def _rate(value: float | None) -> str:
    return NONE if value is None else f"{value:.1f}"


def _percent(share: Share) -> str:
    return NONE if share.value is None else f"{100 * share.value:.1f} %"


def _count(share: Share) -> str:
    return f"{share.hits} of {share.of}"


def _header(cells: Iterable[str]) -> list[str]:
    cells = list(cells)
    return [_line(cells), "|" + "---|" * len(cells)]


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(' '.join(cell.replace('|', '/').split()) for cell in cells)} |"
