"""An ideal follower over a scenario: a point mass by the trail law, a gimbal that never misses, what is then in sight.

Run as a script it prints the table by which the layout of a scenario is judged:
python -m tests.sitl.scenario.follower [NAME] [SEEDS]
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

import numpy as np

from sitl.render.geometry import GeometryCamera
from sitl.scenario import Scenario, load_scenario
from sitl.scenario.build import camera_model, world_spec
from sitl.scene import CameraPose, ObjectTruth
from sitl.world.motion import Placement
from sitl.world.world import World

HZ = 20
MAX_M_S, MAX_M_S2, POSITION_TIME_S, VELOCITY_FILTER_S = 5.0, 2.0, 3.0, 1.0  # those of the application


@dataclass(frozen=True)
class Moment:
    t_s: float
    vehicle_ne: tuple[float, float]
    target: Placement
    truths: dict[str, ObjectTruth]


def fly(scenario: Scenario, seed: int, range_by_size: bool = False) -> list[Moment]:
    """`range_by_size`: the range is read off the box, as the application does it: short when the target turns."""
    world = World(world_spec(scenario, seed), seed)
    camera = GeometryCamera(world, camera_model(scenario))
    v, name = scenario.vehicle, scenario.target.name
    place = np.array([v.start_north_m, v.start_east_m])
    velocity, feed = np.zeros(2), np.zeros(2)
    reference: tuple[float, float] | None = None
    moments = []
    for tick in range(round(scenario.duration_s * HZ)):
        t_s = tick / HZ
        target = world.placements(t_s)[name]
        to = np.array([target.north_m, target.east_m]) - place
        ground_m = float(np.hypot(*to))
        pitch = -math.atan2(v.takeoff_height_m - 0.75, ground_m)
        pose = CameraPose((place[0], place[1], -v.takeoff_height_m), 0.0, pitch, math.atan2(to[1], to[0]))
        truths = camera.observe(t_s, pose)
        moments.append(Moment(t_s, (float(place[0]), float(place[1])), target, truths))
        box = truths[name].amodal
        size = math.sqrt(box.w_px * box.h_px) if box else 1.0
        reference = reference or (ground_m, size)
        read_m = reference[0] * reference[1] / size if range_by_size else ground_m
        heading = np.array([math.cos(target.yaw_rad), math.sin(target.yaw_rad)])
        feed += (heading * target.speed_m_s - feed) / HZ / VELOCITY_FILTER_S
        if t_s >= 2.0:
            wanted = to / ground_m * (read_m - scenario.guidance.standoff_m) / POSITION_TIME_S + feed
            wanted *= min(1.0, MAX_M_S / max(float(np.hypot(*wanted)), 1e-9))
            change = wanted - velocity
            velocity += change * min(1.0, MAX_M_S2 / HZ / max(float(np.hypot(*change)), 1e-9))
        place = place + velocity / HZ
    return moments


def hidden_times(moments: list[Moment], name: str, below: float = 0.1) -> list[tuple[float, float]]:
    """(start, duration) of each time in which less than `below` of the target is visible."""
    times: list[tuple[float, float]] = []
    start: float | None = None
    for m in moments:
        if m.truths[name].visibility < below:
            start = m.t_s if start is None else start
        elif start is not None:
            times.append((round(start, 2), round(m.t_s - start, 2)))
            start = None
    return times if start is None else [*times, (start, math.inf)]


def meeting(moments: list[Moment], name: str, other: str) -> tuple[float, float, float]:
    """When the other one's middle is nearest to the target's in the picture: (time, pixels, its visibility)."""
    best = (math.nan, math.inf, 0.0)
    for m in moments:
        a, b = m.truths[name].centre_px, m.truths[other].centre_px
        if a is not None and b is not None and math.dist(a, b) < best[1] and m.truths[other].visibility > 0.3:
            best = (m.t_s, math.dist(a, b), m.truths[other].visibility)
    return best


def main() -> None:
    name = sys.argv[1] if len(sys.argv) > 1 else "default"
    seeds = int(sys.argv[2]) if len(sys.argv) > 2 else 3
    scenario = load_scenario(name)
    print("law   seed  hidden (start s, for s)  |  below 0.7  |  nearest look-alike (s, px)  |  range m  |  box px")
    for by_size in (False, True):
        for seed in range(seeds):
            moments = fly(scenario, seed, by_size)
            target = scenario.target.name
            ranges = [m.truths[target].range_m for m in moments]
            boxes = [math.sqrt(b.w_px * b.h_px) for m in moments if (b := m.truths[target].amodal)]
            near = meeting(moments, target, scenario.distractors[0].name)
            print(
                f"{'size' if by_size else 'ideal':5s} {seed:4d}  {hidden_times(moments, target)}  |  "
                f"{hidden_times(moments, target, 0.7)}  |  {near[0]:.1f}, {near[1]:.0f}  |  "
                f"{min(ranges):.0f}..{max(ranges):.0f}  |  {min(boxes):.0f}..{max(boxes):.0f}"
            )


if __name__ == "__main__":
    main()
