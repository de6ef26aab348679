"""A simulated run with the application in it: build, run, judge, write the files."""

from __future__ import annotations

import json
import math
import platform
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from control.camera import Intrinsics
from control.gimbal import MAX_LOOP_DELAY_S, GimbalLaw, GimbalLawConfig
from control.guidance.trail import TrailConfig, TrailGuidance
from control.limits import VelocityLimiter, VelocityLimits
from sitl.eyes import Eyes, GeometryEyes, PixelEyes
from sitl.flight import Flight, build_world
from sitl.measure import MeasurementModel
from sitl.metrics import CriterionResult, Setpoint, Source, Verdict, all_passed, compute, judge, run_json
from sitl.operator import OperatorError
from sitl.render.geometry import GeometryCamera
from sitl.render.renderer import Renderer
from sitl.run import Run, RunLog, Step
from sitl.scenario import build, drawn
from sitl.scenario.schema import LimitsSection, Scenario, Vary
from sitl.scenario.seeds import seed_for
from sitl.world.world import World
from tracker.engines.cpu import describe_cpu
from tracker.filter import FilterConfig
from tracker.target import TargetTracker
from tracker.weights.build import BuiltTracker
from uavfollow import __version__
from uavfollow.app import App
from uavfollow.companion import Companion
from uavfollow.errors import InputError
from uavfollow.interrupts import hold_off
from uavfollow.mavlink.connection import Connection
from uavfollow.mavlink.ids import CONTROLLER_COMPONENT
from uavfollow.mavlink.pipe import PipeLink
from uavfollow.sim.driver import CompanionDriver
from uavfollow.sim.files import SimFiles
from uavfollow.sim.report import write_sim_report
from uavfollow.trackers import DEFAULT_NAME, TrackerSpec
from uavfollow.trackers import build as build_tracker

# The camera's own motion is taken out of the estimate here, so what is left is the target's, and a car that goes behind
# a tree does not stop there. (The filter's default is for video without telemetry, where most of it is the camera's.)
COAST_TAU_S = 4.0
# Tlogs carry unix time; a simulated flight has none, and the same run is to give the same bytes.
TLOG_EPOCH_US = 1_600_000_000_000_000


@dataclass(frozen=True, slots=True)
class SimOptions:
    """What the user chose. `model` None: no pixels and no network, candidates from the geometry camera."""

    seed: int
    model: str | None
    precision: str
    device: str
    threads: int
    out: Path | None
    video: bool
    realtime: bool
    physics_hz: int = 400


@dataclass(frozen=True, slots=True, eq=False)
class SimResult:
    """A run that came to its end."""

    scenario: Scenario
    options: SimOptions
    engine: str
    log: RunLog
    metrics: dict[str, float | None]
    criteria: tuple[CriterionResult, ...]
    scene_s: float
    wall_s: float
    files: tuple[Path, ...] = ()

    @property
    def passed(self) -> bool:
        """Every criterion that applies is met, there is one, and the run came to its end."""
        return all_passed(self.criteria) and not self.log.interrupted

    def lines(self) -> list[str]:
        """The summary for people."""
        steps = self.log.steps
        shares: dict[str, int] = {}
        for step in steps:
            shares[step.sample.status] = shares.get(step.sample.status, 0) + 1
        status = ", ".join(f"{name} {100 * n / len(steps):.0f} %" for name, n in shares.items()) or "nothing seen"
        lines = [
            f"{self.scenario.name}, seed {self.options.seed}: {self.scene_s:.1f} s, {len(steps)} pictures taken up, "
            f"{self.engine}{', interrupted' if self.log.interrupted else ''}",
            f"  status: {status}",
            "  events: " + ", ".join(
                f"{h.kind} at {h.t_s - self.log.begin_s:.1f} s ({h.answer})" for h in self.log.happenings
            ),
            f"  {self.scene_s / max(self.wall_s, 1e-9):.2f} times real time on {describe_cpu()}",
        ]  # fmt: skip
        width = max(len(name) for name in self.metrics)
        lines += [f"  {name:{width}}  {_shown(value)}" for name, value in self.metrics.items() if value is not None]
        marks = {Verdict.PASSED: "ok  ", Verdict.FAILED: "FAIL", Verdict.NOT_APPLICABLE: "-   "}
        lines += [f"  {marks[c.verdict]}  {c.reason}" for c in self.criteria]
        return [*lines, f"  {self.verdict()}"]

    def verdict(self) -> str:
        """One line: passed or failed, and why."""
        judged = [c for c in self.criteria if c.verdict is not Verdict.NOT_APPLICABLE]
        met = sum(c.verdict is Verdict.PASSED for c in judged)
        if not judged:
            return "FAILED: the scenario has no criterion for this kind of run"
        if self.log.interrupted:
            return f"INTERRUPTED: {met} of {len(judged)} criteria are met so far, which counts for nothing"
        return f"{'PASSED' if self.passed else 'FAILED'}: {met} of {len(judged)} criteria are met"

    def as_json(self) -> dict[str, object]:
        """run.json (docs/interfaces.md)."""
        return run_json(
            scenario=self.scenario.name,
            seed=self.options.seed,
            flavour=self.scenario.vehicle.flavour.value,
            engine=self.engine,
            versions=versions(),
            commit=commit(),
            metrics=self.metrics,
            criteria=self.criteria,
            interrupted=self.log.interrupted,
            about={
                "source": "geometry" if self.options.model is None else "pixels",
                "model": self.options.model,
                "duration_s": self.scenario.duration_s,
                "flown_s": round(self.scene_s, 3),
                "begin_s": round(self.log.begin_s, 6),  # of the scenario's time 0 in link.tlog, from its first message
                "pictures": len(self.log.steps),
                "events": [
                    {"t_s": round(h.t_s - self.log.begin_s, 3), "kind": h.kind, "answer": h.answer}
                    for h in self.log.happenings
                ],
            },
        )


def run_sim(scenario: Scenario, options: SimOptions, on_step: Callable[[Step, float], None] | None = None) -> SimResult:
    """Fly the scenario, as it is for the seed. `on_step` is told of each step and the scenario's time.

    Raises InputError for what cannot be built or written, and leaves nothing behind then.
    """
    try:
        scenario = drawn(scenario, options.seed)
        world = build_world(scenario, options.seed)
    except ValueError as error:
        raise InputError(f"scenario {scenario.name}: {error}") from error
    built, engine = _tracker(options)
    files = SimFiles(options.out, options.video and options.model is not None, scenario) if options.out else None
    try:
        result = _fly(scenario, options, world, built, engine, files, on_step)
        return result if files is None else _write(result, files)
    except OSError as error:
        raise InputError(
            f"--out {options.out}: {error.strerror or error}; free some space or choose another"
        ) from error
    except OperatorError as error:
        raise InputError(f"scenario {scenario.name}: {error}") from error
    finally:
        if files is not None:
            files.abort()  # nothing is left to abort after a commit


def _fly(
    scenario: Scenario,
    options: SimOptions,
    world: World,
    built: BuiltTracker | None,
    engine: str,
    files: SimFiles | None,
    on_step: Callable[[Step, float], None] | None,
) -> SimResult:
    flight = Flight(scenario, options.seed, world, options.physics_hz)
    ours, theirs = PipeLink.pair()
    now = {"s": 0.0}
    tap = files.tap(lambda: TLOG_EPOCH_US + round(now["s"] * 1e6)) if files is not None else None
    connection = Connection(ours, 1, [CONTROLLER_COMPONENT], tap)
    companion = Companion(build_app(scenario, built), connection)
    begun: list[float] = []  # wall clock at the scenario's time 0
    pacer = Pacer() if options.realtime else None

    def pace(now_s: float) -> None:
        now["s"] = now_s
        if not begun and not math.isnan(run.log.begin_s):
            begun.append(time.perf_counter())
        if pacer is not None:
            pacer.wait(now_s)

    def step(made: Step) -> None:
        if files is not None:
            files.add(made, run.log.begin_s)
        if on_step is not None:
            on_step(made, made.sample.now_s - run.log.begin_s)

    eyes = _eyes(scenario, options, world)
    run = Run(scenario, options.seed, flight, eyes, CompanionDriver(companion), theirs, step, pace)
    log = run.run()
    wall_s = time.perf_counter() - begun[0]
    hold_off()
    if connection.tap_failures:
        raise OSError(None, f"link.tlog could not be written whole ({connection.tap_failures} messages are missing)")
    end_s = log.steps[-1].sample.now_s if log.steps and log.interrupted else log.begin_s + scenario.duration_s
    scene_s = end_s - log.begin_s
    metrics = compute(
        [s.sample for s in log.steps],
        build.wanted(scenario),
        [Setpoint(s.t_s, s.v_ned_m_s, s.yaw_rate_rad_s) for s in log.setpoints],
        log.override_s,
        log.resumed_s,
        scene_s / max(wall_s, 1e-9),
    )
    source = Source.GEOMETRY if options.model is None else Source.PIXELS
    results = judge(build.criteria(scenario), metrics, source)
    return SimResult(scenario, options, engine, log, metrics, results, scene_s, wall_s)


def build_app(scenario: Scenario, built: BuiltTracker | None) -> App:
    """The loop with the application's own defaults, and of the scenario only what an operator would set."""
    camera, guidance = scenario.camera, scenario.guidance
    intrinsics = Intrinsics.from_hfov(camera.width_px, camera.height_px, math.radians(camera.hfov_deg))
    trail = TrailConfig(
        standoff_m=guidance.standoff_m,
        min_standoff_m=min(TrailConfig().min_standoff_m, guidance.standoff_m),
        height_m=guidance.height_m,
    )
    return App(
        tracker=built.tracker if built is not None else None,
        target=TargetTracker(
            filter_config=FilterConfig(coast_tau_s=COAST_TAU_S),
            confidence=built.confidence if built is not None else None,
        ),
        gimbal_law=GimbalLaw(GimbalLawConfig(loop_delay_s=loop_delay_s(scenario))),
        guidance=TrailGuidance(trail),
        limiter=VelocityLimiter(VelocityLimits().tighten(_limits(guidance.limits))),
        intrinsics=intrinsics,
        reference_range_m=None,  # only what the application finds out by itself
    )


def loop_delay_s(scenario: Scenario) -> float:
    """Exposure to motion of the camera, as whoever sets the vehicle up would have measured it."""
    gimbal_s = 1e-3 * (scenario.gimbal.delay_ms + scenario.gimbal.lag_ms)
    return min(1e-3 * scenario.camera.latency_ms + scenario.tracker_compute_delay_s + gimbal_s, MAX_LOOP_DELAY_S)


def _limits(tight: LimitsSection) -> VelocityLimits:
    default = VelocityLimits()
    yaw_rate = tight.max_yaw_rate_deg_s
    return VelocityLimits(
        max_horizontal_m_s=tight.max_horizontal_m_s or default.max_horizontal_m_s,
        max_up_m_s=tight.max_up_m_s or default.max_up_m_s,
        max_down_m_s=tight.max_down_m_s or default.max_down_m_s,
        max_yaw_rate_rad_s=math.radians(yaw_rate) if yaw_rate is not None else default.max_yaw_rate_rad_s,
        max_horizontal_accel_m_s2=tight.max_horizontal_accel_m_s2 or default.max_horizontal_accel_m_s2,
    )


def _eyes(scenario: Scenario, options: SimOptions, world: World) -> Eyes:
    camera = build.camera_model(scenario)
    if options.model is not None:
        return PixelEyes(Renderer(world, camera, seed_for(scenario, options.seed, Vary.NOISE)), camera)
    noise_seed = seed_for(scenario, options.seed, Vary.NOISE)
    errors = MeasurementModel(None, noise_seed, build.look_alikes(scenario), scenario.mirrored)
    return GeometryEyes(GeometryCamera(world, camera), errors, scenario.target.name, camera)


def _tracker(options: SimOptions) -> tuple[BuiltTracker | None, str]:
    if options.model is None:
        return None, "geometry camera"
    spec = TrackerSpec(DEFAULT_NAME, options.model, raw=False)
    built = build_tracker(spec, options.precision, options.device, options.threads)
    threads = f"{options.threads} thread{'s' if options.threads > 1 else ''}"
    return built, f"model {options.model}, {built.engine}, {threads}"


def _write(result: SimResult, files: SimFiles) -> SimResult:
    folder = files.folder
    files.finish(result.log)
    text = json.dumps(result.as_json(), indent=1, allow_nan=False)
    folder.path("run.json").write_text(text + "\n", encoding="utf-8")
    write_sim_report(folder, result.scenario, result.options.seed, result.log, result.lines(), files.snapshots)
    placed = files.commit()
    return SimResult(
        result.scenario, result.options, result.engine, result.log, result.metrics, result.criteria, result.scene_s,
        result.wall_s, tuple(placed),
    )  # fmt: skip


class Pacer:
    """Holds a run back to the wall clock; a run that is slower than real time is not held at all."""

    def __init__(self) -> None:
        self._offset_s: float | None = None

    def wait(self, now_s: float) -> None:
        """Sleep until the wall clock has come to `now_s`."""
        wall_s = time.monotonic()
        if self._offset_s is None:
            self._offset_s = wall_s - now_s
        ahead_s = now_s + self._offset_s - wall_s
        if ahead_s > 0:
            time.sleep(ahead_s)
        elif ahead_s < -1.0:  # too slow for the clock: no catching up later in a hurry
            self._offset_s = wall_s - now_s


def versions() -> dict[str, str]:
    """What made the run."""
    import cv2

    return {
        "uavfollow": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "opencv": str(cv2.__version__),
    }


def commit() -> str | None:
    """Commit of the checkout that this runs from, None when there is none; "+" marks changes."""
    here = Path(__file__).resolve().parent
    try:
        found = subprocess.run(
            ["git", "describe", "--always", "--dirty=+", "--abbrev=12"],
            cwd=here, capture_output=True, text=True, timeout=10, check=True,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return None
    return found.stdout.strip() or None


def _shown(value: float) -> str:
    return f"{value:.3f}" if abs(value) < 1000 else f"{value:.0f}"
