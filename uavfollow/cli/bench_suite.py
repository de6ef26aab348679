"""`uavfollow bench suite`: scenarios of the simulator that a tracker has to survive, many seeds of each."""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path
from typing import Any

from uavfollow.errors import EXIT_DONE, EXIT_INTERRUPTED, EXIT_SHORT, InputError
from uavfollow.sim.suite_aims import AIMS, MIN_RUNS
from uavfollow.tell import tell

VERB = "suite"
MAX_JOBS = 256
MAX_SEEDS = 1000
MAX_SEED = 2**32 - 1
DESCRIPTION = """Flies each scenario with each seed, pictures rendered and the network in the loop, and writes
suite.json, suite.md and NAME.jpg (pictures of two seeds) into DIR. A finished run is not flown again unless code,
weights or the scenario changed; the same command goes on where it was stopped. The exit code is 1 when a floor is
missed or a run could not be made.
"""


def add_verb(verbs: Any) -> None:
    """Add the command to those of `bench`."""
    parser = verbs.add_parser(
        VERB,
        help="occlusions, look-alikes and losses in the simulator",
        description=DESCRIPTION,
        epilog=_scenarios(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", metavar="NAME", nargs="*", help="scenarios of the suite (default: all)")
    parser.add_argument("--seeds", default="0-19", metavar="SEEDS", help="as 0-19 or 0,3,7 (default: 0-19)")
    parser.add_argument(
        "--jobs", metavar="N", type=int, default=1, help="runs at the same time, one core each (default: 1)"
    )
    parser.add_argument("--model", default="s", help="s, full or a .safetensors file (default: s)")
    parser.add_argument("--geometry", action="store_true", help="no pixels, no network: candidates from the truth")
    parser.add_argument("--precision", choices=["auto", "fp32", "bf16"], default="auto")
    parser.add_argument("--device", choices=["auto", "cpu", "cuda"], default="auto")
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder of the results (default: runs/suite-MODEL)")
    parser.add_argument("--json", action="store_true", help="print suite.json instead of the tables")
    parser.set_defaults(run=_run)


def _scenarios() -> str:
    """A line for each scenario."""
    width = max(len(aim.scenario) for aim in AIMS)
    lines = [f"  {aim.scenario:{width}}  {aim.measures}" for aim in AIMS]
    return "\n".join(["what each scenario measures:", *lines, f"A verdict takes at least {MIN_RUNS} seeds."])


def _run(arguments: argparse.Namespace) -> int:
    if not 1 <= arguments.jobs <= MAX_JOBS:
        raise InputError(f"--jobs {arguments.jobs} is out of range, must lie in 1..{MAX_JOBS}")
    seeds = parse_seeds(arguments.seeds)
    from uavfollow.sim.suite import SuiteOptions, run_suite, suite_names  # only now: it imports the simulator

    label = "geometry" if arguments.geometry else Path(arguments.model).stem
    options = SuiteOptions(
        names=suite_names(arguments.names),
        seeds=seeds,
        jobs=arguments.jobs,
        model=None if arguments.geometry else arguments.model,
        precision=arguments.precision,
        device=arguments.device,
        out=arguments.out or Path("runs") / f"suite-{label}",
    )
    try:
        result = run_suite(options)
    except KeyboardInterrupt:
        tell("stopped; what was finished is kept, and the same command goes on where it was")
        return EXIT_INTERRUPTED
    text = json.dumps(result.json, indent=1, allow_nan=False) if arguments.json else "\n".join(result.markdown)
    print(text)
    return EXIT_DONE if result.passed else EXIT_SHORT


def parse_seeds(text: str) -> tuple[int, ...]:
    """Seeds from `0-19`, `3` or `0,3,7-9`, sorted, each once. Raises InputError."""
    found: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,10})(?:-(\d{1,10}))?\s*", part, re.ASCII)
        if match is None:
            raise InputError(f"--seeds {text}: {part!r} is neither a seed nor a range; write 0-19 or 0,3,7")
        first, last = int(match[1]), int(match[2] or match[1])
        if not first <= last <= MAX_SEED or last - first >= MAX_SEEDS:
            raise InputError(f"--seeds {text}: {part.strip()} must rise, by less than {MAX_SEEDS}, up to {MAX_SEED}")
        found |= set(range(first, last + 1))
    return tuple(sorted(found))
