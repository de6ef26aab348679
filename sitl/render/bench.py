"""How long pictures take: `python -m sitl.render.bench [--frames N] [--out FOLDER]`. Prints, asserts nothing."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from sitl.render.geometry import GeometryCamera
from sitl.render.renderer import Renderer
from sitl.scene import CameraModel, CameraPose
from sitl.world.spec import (
    BridgeSpec,
    BuildingSpec,
    CarBody,
    CarSpec,
    PathSpec,
    PersonSpec,
    RoadSpec,
    TreeSpec,
    WorldSpec,
)
from sitl.world.world import World

FEATURES = ("sse4_2", "avx2", "fma", "avx512f", "avx512_vnni", "amx_tile")
FPS = 30.0


def street_spec() -> WorldSpec:
    """A suburban street: 6 cars, a person, 40 trees, 8 houses, a footbridge; the road turns east at a junction."""
    road = RoadSpec(((-118.0, 0.0), (60.0, 0.0), (60.0, 118.0)))
    side = RoadSpec(((60.0, -118.0), (60.0, 0.0)), 6.0)
    trees = [TreeSpec(-100.0 + 11.0 * i, -7.6 if i % 2 else 7.6, 6.5 + i % 3, 4.2 + 0.5 * (i % 3)) for i in range(14)]
    trees += [TreeSpec(52.0 if i % 2 else 68.0, 12.0 + 9.5 * i, 7.0, 4.6) for i in range(11)]
    trees += [TreeSpec(-95.0 + 13.0 * i, 34.0 + 7 * math.sin(3.0 * i), 8.5, 5.5) for i in range(8)]
    trees += [TreeSpec(-90.0 + 21.0 * i, -36.0 + 6 * math.cos(2.0 * i), 9.0, 6.0) for i in range(7)]
    houses = (
        BuildingSpec(-80.0, 20.0, 13.0, 9.0, 7.5), BuildingSpec(-52.0, 21.0, 11.0, 9.5, 7.0, 0.1),
        BuildingSpec(-22.0, 20.5, 14.0, 10.0, 8.0), BuildingSpec(12.0, 23.0, 18.0, 15.0, 10.0),
        BuildingSpec(-70.0, -20.0, 12.0, 9.0, 7.2), BuildingSpec(-35.0, -21.0, 12.0, 10.0, 6.8, -0.12),
        BuildingSpec(0.0, -20.0, 13.0, 9.0, 7.4), BuildingSpec(85.0, 30.0, 24.0, 16.0, 11.0, math.pi / 2),
    )  # fmt: skip
    red = (168, 32, 30)
    cars = (
        CarSpec("target", CarBody.SEDAN, red, PathSpec(((-95.0, 1.75), (61.75, 1.75), (61.75, 110.0)), 8.0)),
        CarSpec("twin", CarBody.SEDAN, red, PathSpec(((110.0, -1.75), (-100.0, -1.75)), 7.0, 4.0)),
        CarSpec("van", CarBody.VAN, (225, 225, 222), PathSpec(((40.0, -9.5),), yaw_rad=1.5)),
        CarSpec("hatch", CarBody.HATCHBACK, (40, 70, 130), PathSpec(((-76.0, -2.5),), yaw_rad=math.pi)),
        CarSpec("pickup", CarBody.PICKUP, (60, 62, 66), PathSpec(((-45.0, -2.4), (-110.0, -2.4)), 5.0, 1.0)),
        CarSpec("grey", CarBody.SEDAN, (150, 152, 156), PathSpec(((50.0, -1.75), (-90.0, -1.75)), 6.0)),
    )
    person = PersonSpec("walker", (190, 160, 40), PathSpec(((-80.0, 4.6), (40.0, 4.6)), 1.4))
    bridge = BridgeSpec(-30.0, 0.0, 17.0, 3.0, yaw_rad=math.pi / 2)
    return WorldSpec(240.0, (0.0, 0.0), (road, side), houses, tuple(trees), (bridge,), cars, (person,))


def chase_pose(world: World, t_s: float, back_m: float = 20.0, height_m: float = 12.0) -> CameraPose:
    """A camera behind the target that looks at it."""
    at = world.placements(t_s)["target"]
    north, east = at.north_m - back_m * math.cos(at.yaw_rad), at.east_m - back_m * math.sin(at.yaw_rad)
    return CameraPose((north, east, -height_m), 0.02 * math.sin(t_s), -math.atan2(height_m, back_m), at.yaw_rad)


def main(argv: list[str] | None = None) -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=120)
    parser.add_argument("--out", type=Path, help="write every 20th picture there")
    args = parser.parse_args(argv)
    cv2.setNumThreads(1)
    start = time.process_time()
    world = World(street_spec(), 0)
    print(f"processor features: {' '.join(_features()) or 'unknown'}")
    print(f"world built in {time.process_time() - start:.2f} s of CPU")
    camera = CameraModel()
    renderer, geometry = Renderer(world, camera, 0), GeometryCamera(world, camera)
    times = [i / FPS for i in range(args.frames)]
    poses = [chase_pose(world, t) for t in times]
    if args.out:
        args.out.mkdir(parents=True, exist_ok=True)
        for i in range(0, args.frames, 20):
            cv2.imwrite(str(args.out / f"{i:04d}.png"), renderer.render(times[i], poses[i], i).image_bgr_u8)
    print(f"{camera.width_px}x{camera.height_px}, median of {args.frames} pictures, ms of CPU:")
    whole = _median_ms(lambda i: renderer.render(times[i], poses[i], i), args.frames)
    print(f"  picture with truth {whole:6.2f}")
    for name, part in _parts(renderer, times, poses).items():
        print(f"    {name:<16} {_median_ms(part, args.frames):6.2f}")
    print(f"  geometry only      {_median_ms(lambda i: geometry.observe(times[i], poses[i]), args.frames):6.2f}")
    return 0


def _parts(renderer: Renderer, times: list[float], poses: list[CameraPose]) -> dict[str, Callable[[int], object]]:
    from sitl.render.backdrop import draw_backdrop
    from sitl.render.posed import pose_movers
    from sitl.render.projection import View
    from sitl.render.surface import Surface

    world, camera = renderer.world, renderer.camera
    image = np.zeros((camera.height_px, camera.width_px, 4), np.uint8)
    ids = np.zeros(image.shape[:2], np.uint8)

    def view(i: int) -> View:
        return View(camera, poses[i])

    def items(i: int) -> object:
        surface = Surface.new(image, ids, view(i), world.light, 1.0)
        return renderer.draw_things(surface, pose_movers(world, times[i]))

    return {
        "ground and sky": lambda i: draw_backdrop(image, view(i), world.ground, world.light, 1.0),
        "things": items,
        "camera effects": lambda i: renderer._post.apply(image, view(i), poses[i], i),
    }


def _median_ms(call: Callable[[int], object], count: int) -> float:
    spent = []
    for i in range(count):
        start = time.process_time()
        call(i)
        spent.append(time.process_time() - start)
    return 1e3 * float(np.median(spent))


def _features() -> list[str]:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return []
    flags = next((line for line in text.splitlines() if line.startswith("flags")), "")
    return [name for name in FEATURES if name in flags.split()]


if __name__ == "__main__":
    sys.exit(main())
