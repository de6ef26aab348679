"""How long a step takes: `python -m sitl.plant.bench`, microseconds of process time, best of some rounds."""

from __future__ import annotations

import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path

from sitl.plant.gimbal import GimbalPlant
from sitl.plant.pose import camera_pose
from sitl.plant.quadrotor import Quadrotor
from sitl.plant.shaping import VelocityShaper
from sitl.plant.wind import Wind

DT_S = 1.0 / 400.0
STEPS = 8000  # 20 s of flight
ROUNDS = 5
_FEATURES = ("avx2", "avx512f", "amx_tile", "asimd")


class Bench:
    """A flight in gusts with a moving gimbal, commanded at 50 Hz, timed part by part."""

    def __init__(self) -> None:
        self.quad = Quadrotor(wind=Wind((3.0, 1.0, 0.0), 1.0, 2.0, seed=1), pos_ned_m=(0.0, 0.0, -30.0))
        self.quad.hover()
        self.gimbal = GimbalPlant()
        self.shaper = VelocityShaper(2.5, 5.0, 2)

    def fly_quad(self) -> None:
        """Steps of the quadrotor, commands included."""
        quad = self.quad
        quad.idle()
        quad.hover()
        for index in range(STEPS):
            if index % 8 == 0:
                quad.command((4.0, 1.0 if index % 1600 < 800 else -1.0, 0.0), 0.2, index * DT_S)
            quad.step(index * DT_S, DT_S)

    def turn_gimbal(self) -> None:
        """Steps of the gimbal, commands included."""
        self.gimbal = gimbal = GimbalPlant()
        for index in range(STEPS):
            if index % 8 == 0:
                gimbal.command_rate(-0.1 if index % 1600 < 800 else 0.1, 0.05, index * DT_S)
            gimbal.step(index * DT_S, DT_S, 0.05, -0.1)

    def shape(self) -> None:
        """Steps of the horizontal shaping."""
        for index in range(STEPS):
            self.shaper.step((5.0, 1.0) if index % 4000 < 2000 else (0.0, 0.0), DT_S)

    def see(self) -> None:
        """Camera poses."""
        for _ in range(STEPS):
            camera_pose(self.quad, self.gimbal)


def microseconds(run: Callable[[], None]) -> float:
    """Process time of one of the `STEPS` steps in `run`."""
    best = float("inf")
    for _ in range(ROUNDS):
        start = time.process_time()
        run()
        best = min(best, time.process_time() - start)
    return 1e6 * best / STEPS


def processor() -> str:
    """Name of the processor and what it can do that matters to compare timings."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    pairs = [line.split(":", 1) for line in lines if ":" in line]
    fields = {key.strip(): value.strip() for key, value in pairs}
    flags = (fields.get("flags") or fields.get("Features") or "").split()
    found = ", ".join(name for name in _FEATURES if name in flags)
    return f"{fields.get('model name', platform.machine())} ({found or 'none of ' + ', '.join(_FEATURES)})"


def main() -> None:
    """Print the table."""
    bench = Bench()
    print(f"{processor()}, Python {sys.version.split()[0]}; us per step, best of {ROUNDS} x {STEPS}")
    for name, run in (
        ("quadrotor", bench.fly_quad),
        ("gimbal", bench.turn_gimbal),
        ("shaping, horizontal", bench.shape),
        ("camera pose", bench.see),
    ):
        print(f"  {name:20s} {microseconds(run):6.2f}")


if __name__ == "__main__":
    main()
