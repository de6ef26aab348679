"""Plots of a simulated run: errors and commands over time, and both ways seen from above."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from sitl.run import Happening, Step
from sitl.world.spec import WorldSpec
from tracker.messages import TargetStatus
from uavfollow.record.plots import LEGEND, STATUS_COLOURS

HIDDEN_BELOW = 0.5  # visibility at which a stretch is marked as hidden


def plot_run(path: Path, steps: Sequence[Step], happenings: Sequence[Happening], begin_s: float, standoff_m: float,
             title: str) -> None:  # fmt: skip
    """Centre error, standoff, confidence, vehicle and gimbal commands over time; the status is the background."""
    figure = Figure(figsize=(10, 11), layout="constrained")
    FigureCanvasAgg(figure)
    axes = list(figure.subplots(5, 1, sharex=True))
    times = [s.sample.t_s - begin_s for s in steps]
    decided = [s.sample.now_s - begin_s for s in steps]
    for axis in axes:
        _shade(axis, steps, times)
        for happening in happenings:
            axis.axvline(happening.t_s - begin_s, color="#444444", lw=0.8, ls=":")
    error, distance, confidence, velocity, gimbal = axes
    error.plot(times, [_centre_error(s) for s in steps], color="#222222", lw=1.1)
    error.set(ylabel="centre error [px]", title=title)
    error.set_ylim(bottom=0)
    for happening in happenings:
        error.annotate(happening.kind, (happening.t_s - begin_s, 1.0), xycoords=("data", "axes fraction"), fontsize=7,
                       rotation=90, va="top", ha="right")  # fmt: skip
    _legend(error, steps)
    distance.plot(times, [_ground_range(s) for s in steps], color="#222222", lw=1.1, label="vehicle to target")
    distance.axhline(standoff_m, color="#d64545", ls="--", lw=1, label="wanted")
    distance.set(ylabel="ground range [m]")
    confidence.plot(times, [s.decision.confidence for s in steps], color="#222222", lw=1.1, label="confidence")
    confidence.plot(times, [s.sample.iou for s in steps], color="#2a6fdb", lw=0.9, label="overlap with truth")
    confidence.plot(times, [s.sample.visibility for s in steps], color="#b05fc7", lw=0.9, label="visible share")
    confidence.set(ylim=(0, 1.05), ylabel="shares [-]")
    for index, name in enumerate(("north", "east", "down")):
        velocity.plot(decided, [_sent(s, s.sample.command_v_ned_m_s[index]) for s in steps], lw=1.1, label=name)
    velocity.set(ylabel="vehicle [m/s]")
    degrees = 180.0 / math.pi
    gimbal.plot(decided, [s.sample.gimbal_yaw_rate_rad_s * degrees for s in steps], lw=1.0, label="gimbal yaw")
    gimbal.plot(decided, [s.sample.gimbal_pitch_rate_rad_s * degrees for s in steps], lw=1.0, label="gimbal pitch")
    gimbal.plot(
        decided, [_sent(s, s.sample.command_yaw_rate_rad_s * degrees) for s in steps], lw=1.0, label="vehicle yaw"
    )
    gimbal.set(ylabel="rates [deg/s]", xlabel="time [s]")
    for axis in (distance, confidence, velocity, gimbal):
        axis.legend(**LEGEND)
    figure.savefig(path, dpi=100)


def plot_top_view(path: Path, steps: Sequence[Step], world: WorldSpec, title: str) -> None:
    """Both ways over the map, north up; the vehicle's is coloured by status."""
    figure = Figure(figsize=(8.5, 8.5), layout="constrained")
    FigureCanvasAgg(figure)
    axis = figure.subplots()
    _map(axis, world)
    target = [s.sample.target_pos_ned_m for s in steps]
    axis.plot([p[1] for p in target], [p[0] for p in target], color="#c0392b", lw=2, label="target")
    for start, end in _stretches(steps):
        part = [s.sample.vehicle_pos_ned_m for s in steps[start : end + 1]]
        colour = STATUS_COLOURS[TargetStatus(steps[start].sample.status)]
        axis.plot([p[1] for p in part], [p[0] for p in part], color=colour, lw=2.5, solid_capstyle="round")
    for status in TargetStatus:
        if any(s.sample.status == status.value for s in steps):
            axis.plot([], [], color=STATUS_COLOURS[status], lw=3, label=f"vehicle, {status.value}")
    for s in steps[:: max(1, len(steps) // 12)]:
        (vn, ve, _), (tn, te, _) = s.sample.vehicle_pos_ned_m, s.sample.target_pos_ned_m
        axis.plot([ve, te], [vn, tn], color="#000000", lw=0.4, alpha=0.4)
    places = [p for s in steps for p in (s.sample.vehicle_pos_ned_m, s.sample.target_pos_ned_m)]
    norths, easts = [p[0] for p in places], [p[1] for p in places]
    half = max(max(norths) - min(norths), max(easts) - min(easts), 20.0) / 2 + 10.0
    middle = ((max(norths) + min(norths)) / 2, (max(easts) + min(easts)) / 2)
    axis.set(xlim=(middle[1] - half, middle[1] + half), ylim=(middle[0] - half, middle[0] + half),
             xlabel="east [m]", ylabel="north [m]", title=title, aspect="equal")  # fmt: skip
    axis.legend(loc="upper left", fontsize=8)
    figure.savefig(path, dpi=100)


def _map(axis: Any, world: WorldSpec) -> None:
    for road in world.roads:
        for (n0, e0), (n1, e1) in pairwise(road.points):
            length, yaw = math.dist((n0, e0), (n1, e1)), math.atan2(e1 - e0, n1 - n0)
            corners = _corners((n0 + n1) / 2, (e0 + e1) / 2, length, road.width_m, yaw)
            axis.add_patch(Polygon(corners, color="#cfcfcf", zorder=0))
    for house in world.buildings:
        axis.add_patch(Polygon(_corners(house.north_m, house.east_m, house.length_m, house.width_m, house.yaw_rad),
                               color="#8d7f72", alpha=0.6))  # fmt: skip
    for bridge in world.bridges:
        axis.add_patch(Polygon(_corners(bridge.north_m, bridge.east_m, bridge.length_m, bridge.width_m, bridge.yaw_rad),
                               color="#5b6b7a", alpha=0.6))  # fmt: skip
    for tree in world.trees:
        axis.add_patch(Circle((tree.east_m, tree.north_m), tree.crown_m / 2, color="#5f9e4a", alpha=0.5))


def _corners(north: float, east: float, length: float, width: float, yaw: float) -> list[tuple[float, float]]:
    """Corners as (east, north) of a rectangle whose length lies along its own x axis."""
    c, s = math.cos(yaw), math.sin(yaw)
    half = [(length / 2, width / 2), (length / 2, -width / 2), (-length / 2, -width / 2), (-length / 2, width / 2)]
    return [(east + s * x + c * y, north + c * x - s * y) for x, y in half]


def _stretches(steps: Sequence[Step]) -> list[tuple[int, int]]:
    """First and last index of each stretch of one status; the last is where the next begins."""
    found, start = [], 0
    for i in range(1, len(steps) + 1):
        if i == len(steps) or steps[i].sample.status != steps[start].sample.status:
            found.append((start, min(i, len(steps) - 1)))
            start = i
    return found


def _shade(axis: Any, steps: Sequence[Step], times: Sequence[float]) -> None:
    for start, end in _stretches(steps):
        colour = STATUS_COLOURS[TargetStatus(steps[start].sample.status)]
        axis.axvspan(times[start], times[end], color=colour, alpha=0.22, lw=0)


def _legend(axis: Any, steps: Sequence[Step]) -> None:
    present = {s.sample.status for s in steps}
    for status in (s for s in TargetStatus if s.value in present):
        axis.plot([], [], color=STATUS_COLOURS[status], lw=6, alpha=0.5, label=status.value)
    axis.legend(**LEGEND)


def _centre_error(step: Step) -> float:
    truth = step.sample.truth
    if truth is None or truth.centre_px is None or truth.visibility < HIDDEN_BELOW:
        return math.nan
    return math.dist(truth.centre_px, step.sample.aim_px)


def _ground_range(step: Step) -> float:
    return math.dist(step.sample.vehicle_pos_ned_m[:2], step.sample.target_pos_ned_m[:2])


def _sent(step: Step, value: float) -> float:
    return value if step.sample.command_sent else math.nan
