"""Plots of a run, as PNG files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tracker.benchmark.scores import PRECISION_PX
from tracker.messages import TargetStatus
from uavfollow.app import StepRecord

STATUS_COLOURS = {
    TargetStatus.IDLE: "#bbbbbb",
    TargetStatus.ACQUIRING: "#4cc3ff",
    TargetStatus.LOCKED: "#3fae49",
    TargetStatus.COASTING: "#ffb000",
    TargetStatus.SEARCHING: "#ff7a1a",
    TargetStatus.LOST: "#d64545",
}
LEGEND: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.005, 1.0), "fontsize": 8, "frameon": False}
matplotlib.rcParams["axes.grid"] = True
matplotlib.rcParams["grid.alpha"] = 0.3


def _figure(rows: int, height: float) -> tuple[Figure, list[Any]]:
    figure = Figure(figsize=(10, height), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)
    return figure, list(axes[:, 0])


def _shade(axis: Any, records: Sequence[StepRecord]) -> None:
    """Colour the background by status."""
    start = 0
    for i in range(1, len(records) + 1):
        if i == len(records) or records[i].target.status is not records[start].target.status:
            end = records[min(i, len(records) - 1)].t_s
            colour = STATUS_COLOURS[records[start].target.status]
            axis.axvspan(records[start].t_s, end, color=colour, alpha=0.22, lw=0)
            start = i


def _status_legend(axis: Any, records: Sequence[StepRecord]) -> None:
    present = {r.target.status for r in records}
    for status in (s for s in TargetStatus if s in present):
        axis.plot([], [], color=STATUS_COLOURS[status], lw=6, alpha=0.5, label=status.value)
    axis.legend(**LEGEND)


def plot_centre_error(path: Path, records: Sequence[StepRecord], errors_px: Any, title: str) -> None:
    """Centre error over time with the 20 px line of the precision score; status as background."""
    figure, (axis,) = _figure(1, 3.6)
    _shade(axis, records)
    axis.plot([r.t_s for r in records], errors_px, color="#222222", lw=1.2)
    axis.axhline(PRECISION_PX, color="#d64545", ls="--", lw=1, label=f"{PRECISION_PX:g} px")
    finite = np.asarray(errors_px)[np.isfinite(errors_px)]
    axis.set_ylim(0, max(2 * PRECISION_PX, float(np.percentile(finite, 98)) * 1.2 if finite.size else 0.0))
    axis.set(xlabel="time [s]", ylabel="centre error [px]", title=title)
    _status_legend(axis, records)
    figure.savefig(path, dpi=110)


def plot_commands(path: Path, records: Sequence[StepRecord], title: str) -> None:
    """Confidence, gimbal rates and velocity setpoints over time; status as background."""
    figure, (confidence, gimbal, velocity, turn) = _figure(4, 8.8)
    t_s = [r.t_s for r in records]
    for axis in (confidence, gimbal, velocity, turn):
        _shade(axis, records)
    confidence.plot(t_s, [r.target.confidence for r in records], color="#222222", lw=1.2)
    confidence.set(ylabel="confidence", ylim=(0, 1.02), title=title)
    _status_legend(confidence, records)
    degrees = 180.0 / np.pi
    gimbal.plot(t_s, [r.gimbal_command.yaw_rate_rad_s * degrees for r in records], label="yaw rate (right +)")
    gimbal.plot(t_s, [r.gimbal_command.pitch_rate_rad_s * degrees for r in records], label="pitch rate (up +)")
    gimbal.set_ylabel("gimbal [deg/s]")
    for axis_index, name in enumerate(("north", "east", "down")):
        velocity.plot(t_s, [r.velocity_command.v_ned_m_s[axis_index] for r in records], label=name)
    velocity.set(ylabel="vehicle [m/s]")
    turn.plot(t_s, [r.velocity_command.yaw_rate_rad_s * degrees for r in records], label="yaw rate (right +)")
    turn.set(ylabel="vehicle [deg/s]", xlabel="time [s]")
    for axis in (gimbal, velocity, turn):
        axis.legend(**LEGEND)
    figure.savefig(path, dpi=110)
