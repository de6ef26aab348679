"""`uavfollow sim`: fly a scenario in the simulator with this application in the loop, and judge it."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uavfollow.errors import EXIT_DONE, EXIT_INTERRUPTED, EXIT_SHORT, InputError
from uavfollow.interrupts import orderly_end
from uavfollow.progress import SimProgress

if TYPE_CHECKING:
    from uavfollow.sim.session import SimOptions, SimResult

NAME = "sim"
SPARE_CORES = 1  # left to the simulator
MAX_SEED = 2**32 - 1
EPILOG = """SCENARIO is a YAML file or the name of a built-in scenario (default: default). The exit code is 0 when every
criterion of the scenario is met, 1 when one is not."""


def add_parser(commands: Any) -> Any:
    """Add the command to the subparsers; returns its parser."""
    parser = commands.add_parser(NAME, help="fly a simulated vehicle and judge the flight", epilog=EPILOG)
    parser.add_argument("scenario", metavar="SCENARIO", nargs="?", default="default", help="YAML file or built-in name")
    parser.add_argument("--seed", type=int, default=0, help="what chance decides: light, wind, noise, click, speed")
    parser.add_argument(
        "--out", metavar="DIR", type=Path, help="output folder (default: runs/sim-NAME-SEED, then -2, -3)"
    )
    parser.add_argument("--model", default="s", help="s, full or a .safetensors file (default: s)")
    parser.add_argument("--geometry", action="store_true", help="no pixels, no network: candidates from the truth")
    parser.add_argument("--realtime", action="store_true", help="hold the run back to the wall clock")
    parser.add_argument("--precision", choices=["auto", "fp32", "bf16"], default="auto")
    parser.add_argument("--device", choices=["auto", "cpu", "cuda"], default="auto")
    parser.add_argument("--threads", type=int, help="threads of the network (default: cores less one)")
    parser.add_argument("--no-video", action="store_true", help="write no overlay video")
    parser.add_argument("--json", action="store_true", help="print run.json instead of the table")
    parser.set_defaults(run=_run)
    return parser


def _run(arguments: argparse.Namespace) -> int:
    if not 0 <= arguments.seed <= MAX_SEED:
        raise InputError(f"--seed {arguments.seed} is out of range, must lie in 0..{MAX_SEED}")
    if arguments.threads is not None and not 1 <= arguments.threads <= 256:
        raise InputError(f"--threads {arguments.threads} is out of range, must lie in 1..256")
    from sitl.scenario import ScenarioError, load_scenario

    try:
        scenario = load_scenario(arguments.scenario)
    except ScenarioError as error:
        raise InputError(f"scenario {error}") from error
    pending = scenario.pending_reasons()
    if pending:
        print(f"{scenario.name} is pending: {'; '.join(pending)}", file=sys.stderr)
        return EXIT_SHORT
    from uavfollow.sim.session import run_sim

    progress = SimProgress(scenario.duration_s)
    try:
        with orderly_end():
            result = run_sim(
                scenario,
                _options(arguments, scenario.name),
                lambda step, scene_s: progress.show(scene_s, step.sample.status),
            )
    finally:
        progress.close()
    _show(result, arguments.json)
    if result.log.interrupted:
        return EXIT_INTERRUPTED
    return EXIT_DONE if result.passed else EXIT_SHORT


def _options(arguments: argparse.Namespace, name: str) -> SimOptions:
    from uavfollow.record.output import free_folder
    from uavfollow.sim.session import SimOptions

    return SimOptions(
        seed=arguments.seed,
        model=None if arguments.geometry else arguments.model,
        precision=arguments.precision,
        device=arguments.device,
        threads=arguments.threads or max(1, (os.cpu_count() or 1) - SPARE_CORES),
        out=arguments.out or free_folder(f"sim-{name}-{arguments.seed}", "run.json"),
        video=not arguments.no_video,
        realtime=arguments.realtime,
    )


def _show(result: SimResult, as_json: bool) -> None:
    if as_json:
        print(json.dumps(result.as_json(), indent=1, allow_nan=False))
        return
    print("\n".join(result.lines()))
    for path in result.files:
        print(f"  wrote {path}")
    report = next((p for p in result.files if p.name == "report.html"), None)
    if report is not None:
        print(f"report: {report.resolve()}")
