"""ablation.json, ablation.md and ablation.png: own results beside the published ones, told apart."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tracker.training.ablation_results import (
    NOT_A_REPRODUCTION,
    PAPER_BEST_W1,
    PAPER_P20,
    TITLES,
    Ablation,
    SweepPoint,
    VariantResult,
)

FILES = ("ablation.json", "ablation.md", "ablation.png")
OURS, THEIRS, GREY = "#2a6fdb", "#c9a227", "#666666"


def write_report(ablation: Ablation, folder: Path) -> tuple[Path, ...]:
    """The three files, each replaced whole; returns their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    parts = tuple(folder / f".part-{name}" for name in FILES)
    parts[0].write_text(json.dumps(ablation.as_json(), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    parts[1].write_text("\n".join(as_markdown(ablation)) + "\n", encoding="utf-8")
    _figure(ablation).savefig(parts[2], dpi=110, format="png")
    return tuple(part.replace(folder / name) for part, name in zip(parts, FILES, strict=True))


def as_markdown(ablation: Ablation) -> list[str]:
    """The tables, line by line."""
    lines = [
        f"# Ablation: recipe {ablation.recipe}, size {ablation.size}",
        "",
        f"Raw tracker on {len(ablation.footage)} validation sequences ({ablation.tracks.words()}): "
        f"{', '.join(ablation.footage)}.",
        "",
        NOT_A_REPRODUCTION,
        "",
        "| variant | pairs | pairs/s | parameters | AUC | P20 | P20 published (UAV20L, another training) |",
        "|---|---|---|---|---|---|---|",
        *(_row(result) for result in ablation.variants),
    ]
    if ablation.sweep:
        lines += ["", f"## w1, changed at inference only: {_best(ablation.sweep)}", ""]
        lines += ["| w1 | AUC | P20 |", "|---|---|---|"]
        lines += [f"| {point.w1:g} | {point.auc:.3f} | {point.p20:.3f} |" for point in ablation.sweep]
    return lines


def _row(result: VariantResult) -> str:
    rate = "-" if result.pairs_per_s is None else f"{result.pairs_per_s:.1f}"
    return (
        f"| {TITLES[result.variant]} | {result.pairs} | {rate} | {result.parameters} | {result.auc:.3f} "
        f"| {result.p20:.3f} | {PAPER_P20[result.variant]:.3f} |"
    )


def _best(sweep: Sequence[SweepPoint]) -> str:
    """By P20, then AUC, as they are printed: what differs by less is a tie."""
    ranks = [(round(point.p20, 3), round(point.auc, 3)) for point in sweep]
    best = [f"{point.w1:g}" for point, rank in zip(sweep, ranks, strict=True) if rank == max(ranks)]
    ours = "no difference" if len(best) == len(sweep) > 1 else f"best {', '.join(best)}"
    return f"{ours} here, best {PAPER_BEST_W1:g} in the paper (published)"


def _figure(ablation: Ablation) -> Figure:
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    bars, sweep = figure.subplots(1, 2)
    _bars(bars, ablation)
    if ablation.sweep:
        values = [point.w1 for point in ablation.sweep]
        sweep.plot(values, [point.p20 for point in ablation.sweep], "o-", color=OURS, label="P20")
        sweep.plot(values, [point.auc for point in ablation.sweep], "s--", color=GREY, label="AUC")
        sweep.axvline(PAPER_BEST_W1, color=THEIRS, lw=1, label="best in the paper (published)")
        sweep.legend(fontsize=8)
    sweep.set(xlabel="w1 (inference only)", ylabel="mean over sequences", title="weight of the first classification")
    figure.suptitle(f"{ablation.recipe}, size {ablation.size}: no reproduction of the paper", fontsize=10)
    return figure


def _bars(axis: Any, ablation: Ablation) -> None:
    places = range(len(ablation.variants))
    series = (
        ("P20 here", OURS, [result.p20 for result in ablation.variants]),
        ("AUC here", GREY, [result.auc for result in ablation.variants]),
        ("P20 published (UAV20L, another training)", THEIRS, [PAPER_P20[r.variant] for r in ablation.variants]),
    )
    for shift, (label, colour, heights) in zip((-0.27, 0.0, 0.27), series, strict=True):
        axis.bar([place + shift for place in places], heights, 0.25, color=colour, label=label)
    names = [TITLES[result.variant].replace(" (", "\n(").replace("DF + ", "DF\n+ ") for result in ablation.variants]
    axis.set_xticks(list(places), names, fontsize=7)
    axis.set(ylim=(0, 1), title=f"{ablation.variants[0].pairs} pairs each")
    axis.legend(fontsize=7, loc="upper left")
