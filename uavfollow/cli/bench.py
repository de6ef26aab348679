"""`uavfollow bench`: comparisons that take long: trackers over data sets, hard scenes, the paper's component study."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from uavfollow.cli import bench_suite, bench_track
from uavfollow.cli.train import MAX_COUNT, RECIPE_HELP, add_run_options, check_range, run_options
from uavfollow.errors import EXIT_DONE, EXIT_INTERRUPTED
from uavfollow.tell import tell

NAME = "bench"
VARIANTS = ("siamapn", "apn_df", "self_aan", "aan")


def add_parser(commands: Any) -> Any:
    """Add the command and its own commands to the subparsers; returns its parser."""
    parser = commands.add_parser(
        NAME, help="long comparisons: trackers on data sets and in hard scenes, the paper's components"
    )
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    bench_track.add_verb(verbs)
    bench_suite.add_verb(verbs)
    ablation = verbs.add_parser(
        "ablation",
        help="train each variant of the paper for equally many pairs and tabulate",
        description="Trains SiamAPN, + APN-DF, + self-AAN and + AAN for --pairs pairs each from the same start, and "
        "sweeps w1. The table stands beside the paper's and is no reproduction of it. Stopped, it goes on where it "
        "was when the same command is given again.",
    )
    ablation.add_argument("recipe", metavar="RECIPE", nargs="?", default="ablation", help=RECIPE_HELP)
    ablation.add_argument("--pairs", type=int, required=True, help="for each variant")
    ablation.add_argument("--out", metavar="DIR", type=Path, required=True, help="folder of the results")
    ablation.add_argument("--variants", nargs="+", choices=VARIANTS, default=list(VARIANTS), help="(default: all)")
    add_run_options(ablation)
    ablation.add_argument("--json", action="store_true", help="print ablation.json instead of the table")
    ablation.set_defaults(run=_ablation)
    return parser


def _ablation(arguments: argparse.Namespace) -> int:
    check_range("--pairs", arguments.pairs, 1, MAX_COUNT)
    from tracker.training.recipe_file import load_recipe
    from uavfollow.training.errors import as_bad_input

    with as_bad_input():
        recipe = load_recipe(arguments.recipe)
        from tracker.training.ablation_report import as_markdown
        from tracker.training.recipe import Variant
        from uavfollow.training.ablate import ablate

        variants = tuple(Variant(name) for name in arguments.variants)
        result = ablate(recipe, arguments.pairs, arguments.out, run_options(arguments), variants)
    if result is None:
        tell("stopped; the same command goes on where it was")
        return EXIT_INTERRUPTED
    print(json.dumps(result.as_json(), indent=1, allow_nan=False) if arguments.json else "\n".join(as_markdown(result)))
    return EXIT_DONE
