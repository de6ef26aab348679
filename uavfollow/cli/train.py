"""`uavfollow train`: weights of one's own: recipes, runs, packs, a look at the pairs, diagnosis."""

from __future__ import annotations

import argparse
import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uavfollow.errors import EXIT_DONE, EXIT_INTERRUPTED, InputError
from uavfollow.tell import tell

if TYPE_CHECKING:
    from uavfollow.training.confidence import ConfidenceReport
    from uavfollow.training.run import RunOptions, RunResult

NAME = "train"
RECIPE_HELP = "YAML file or built-in name (see `uavfollow train list`)"
DATA_HELP = "folder that the recipe's paths are relative to (default: here)"
MAX_COUNT = 10**10
EPILOG = """A run can be stopped at any time (Ctrl-C, kill): it saves, and goes on with --resume. Several GPUs:
torchrun --nproc-per-node N -m uavfollow train run RECIPE ..."""


def add_parser(commands: Any) -> Any:
    """Add the command and its own commands to the subparsers; returns its parser."""
    parser = commands.add_parser(NAME, help="train weights; recipes, packed data, diagnosis")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    _add_run(verbs)
    _add_material(verbs)
    _add_weights(verbs)
    listed = verbs.add_parser("list", help="names of the built-in recipes")
    listed.set_defaults(run=_list)
    show = verbs.add_parser("show", help="print a built-in recipe, to copy and change")
    show.add_argument("recipe", metavar="NAME")
    show.set_defaults(run=_show)
    return parser


def add_run_options(parser: Any) -> None:
    """Options of everything that trains."""
    parser.add_argument("--data", metavar="DIR", type=Path, default=Path(), help=DATA_HELP)
    parser.add_argument("--packed", metavar="DIR", type=Path, help="take the pictures from a pack of `train prepare`")
    parser.add_argument("--resident", action="store_true", help="keep the packed crops in the GPU's memory")
    parser.add_argument("--workers", type=int, help="processes that make pairs (default: 1, with a GPU up to 8)")
    parser.add_argument("--threads", type=int, help="threads of the network (default: as PyTorch chooses)")
    parser.add_argument("--device", choices=["auto", "cpu", "cuda"], default="auto")


def run_options(arguments: argparse.Namespace, **more: Any) -> RunOptions:
    """From parsed arguments. Raises InputError for numbers out of range."""
    check_range("--workers", arguments.workers, 0, 256)
    check_range("--threads", arguments.threads, 1, 256)
    from uavfollow.training.run import RunOptions

    return RunOptions(
        data=arguments.data,
        packed=arguments.packed,
        workers=arguments.workers,
        threads=arguments.threads,
        device=arguments.device,
        resident=arguments.resident,
        **more,
    )


def check_range(option: str, value: float | None, low: float, high: float) -> None:
    """Raise InputError unless the value is none or lies in the range."""
    if value is not None and not low <= value <= high:
        raise InputError(f"{option} {value} is out of range, must lie in {low:g}..{high:g}")


def _add_run(verbs: Any) -> None:
    run = verbs.add_parser("run", help="train by a recipe", epilog=EPILOG)
    run.add_argument("recipe", metavar="RECIPE", help=RECIPE_HELP)
    run.add_argument("--out", metavar="DIR", type=Path, help="run folder (default: runs/train-NAME, then -2, -3)")
    run.add_argument("--resume", action="store_true", help="go on with the run in --out")
    length = run.add_mutually_exclusive_group()
    length.add_argument("--minutes", type=float, help="scale the stages to so many minutes in all")
    length.add_argument("--pairs", type=int, help="scale the stages to so many pairs in all")
    add_run_options(run)
    run.add_argument("--json", action="store_true", help="print the outcome as JSON")
    run.set_defaults(run=_run)


def _add_material(verbs: Any) -> None:
    prepare = verbs.add_parser("prepare", help="pack a recipe's pictures into small files that train at full speed")
    prepare.add_argument("recipe", metavar="RECIPE", help=RECIPE_HELP)
    prepare.add_argument("--data", metavar="DIR", type=Path, default=Path(), help=DATA_HELP)
    prepare.add_argument("--out", metavar="PACK", type=Path, required=True, help="folder to make")
    prepare.add_argument("--crop-px", type=int, help="side of the crops (default: what the recipe's crops can show)")
    prepare.add_argument("--limit", type=int, metavar="N", help="at most N crops of each source")
    prepare.add_argument("--workers", type=int, default=0, help="processes that cut (default: 0, this one)")
    prepare.set_defaults(run=_prepare)
    preview = verbs.add_parser("preview", help="a contact sheet of pairs with their labels")
    preview.add_argument("recipe", metavar="RECIPE", help=RECIPE_HELP)
    preview.add_argument("--data", metavar="DIR", type=Path, default=Path(), help=DATA_HELP)
    preview.add_argument("--out", metavar="FILE", type=Path, default=Path("sheet.jpg"), help="(default: sheet.jpg)")
    preview.add_argument("--stage", type=int, default=1, metavar="N", help="of which stage (default: 1)")
    preview.add_argument("--seed", type=int, help="instead of the recipe's")
    preview.set_defaults(run=_preview)


def _add_weights(verbs: Any) -> None:
    diagnose = verbs.add_parser(
        "diagnose", help="what a model gets wrong: hits, centres, sizes, shapes",
        description="Give folders with img/ and groundtruth_rect.txt, folders of such, or a recipe (validation).",
    )  # fmt: skip
    diagnose.add_argument("model", metavar="MODEL", help="s, full or a .safetensors file")
    diagnose.add_argument("sequences", metavar="SEQUENCE_DIR", type=Path, nargs="*")
    diagnose.add_argument("--recipe", metavar="RECIPE", help=RECIPE_HELP)
    diagnose.add_argument("--data", metavar="DIR", type=Path, default=Path(), help=DATA_HELP)
    diagnose.add_argument("--pairs", type=int, default=400, help="in all (default: 400)")
    diagnose.add_argument("--seed", type=int, default=1, help="(default: 1)")
    diagnose.add_argument("--json", action="store_true", help="the numbers as JSON")
    diagnose.set_defaults(run=_diagnose)
    judge = verbs.add_parser(
        "validate", help="the raw tracker over sequences: success AUC and precision of a model",
        description="Give folders with img/ and groundtruth_rect.txt, folders of such, or a recipe (validation). "
        "--starts and --max-frames are the recipe's unless given.",
    )  # fmt: skip
    judge.add_argument("model", metavar="MODEL", help="s, full or a .safetensors file")
    judge.add_argument("sequences", metavar="SEQUENCE_DIR", type=Path, nargs="*")
    judge.add_argument("--recipe", metavar="RECIPE", help=RECIPE_HELP)
    judge.add_argument("--data", metavar="DIR", type=Path, default=Path(), help=DATA_HELP)
    judge.add_argument("--starts", type=int, help="track each so many times, from frames spread over it")
    judge.add_argument("--max-frames", type=int, help="at most so many frames from each start")
    judge.add_argument("--threads", type=int, help="threads of the network (default: as PyTorch chooses)")
    judge.add_argument("--json", action="store_true", help="the numbers as JSON")
    judge.set_defaults(run=_validate)
    _add_confidence(verbs)
    widen = verbs.add_parser("widen", help="from weights of size s those of size full that compute the same")
    widen.add_argument("model", metavar="S.safetensors", help="or s, the embedded one")
    widen.add_argument("--out", metavar="FULL.safetensors", type=Path, required=True)
    widen.set_defaults(run=_widen)
    maps = verbs.add_parser("maps", help="draw what the attention looks at in a picture of a sequence")
    maps.add_argument("model", metavar="MODEL", help="s, full or a .safetensors file")
    maps.add_argument("source", metavar="SOURCE", help="folder of images, sequence folder, or video file")
    maps.add_argument("--box", metavar="X,Y,W,H", help="target in the first picture")
    maps.add_argument("--truth", metavar="FILE", type=Path, help="x,y,w,h per picture; the first row is the target")
    maps.add_argument("--frame", type=int, default=10, metavar="N", help="picture to draw, from 1 (default: 10)")
    maps.add_argument("--out", metavar="FILE", type=Path, default=Path("maps.png"), help="(default: maps.png)")
    maps.set_defaults(run=_maps)


def _add_confidence(verbs: Any) -> None:
    fit = verbs.add_parser(
        "confidence", help="fit the probability that a candidate is the target",
        description="Follows and probes sequences with truth, fits a regression, and judges each sequence by a model "
        "fitted on the others. Give folders with img/ and groundtruth_rect.txt, folders of such, or a recipe (its "
        "validation); sequences beside a recipe are fitted on too, the figures stay those of the recipe's.",
    )  # fmt: skip
    fit.add_argument("model", metavar="MODEL", help="s, full or a .safetensors file")
    fit.add_argument("sequences", metavar="SEQUENCE_DIR", type=Path, nargs="*")
    fit.add_argument("--recipe", metavar="RECIPE", help=RECIPE_HELP)
    fit.add_argument("--data", metavar="DIR", type=Path, default=Path(), help=DATA_HELP)
    fit.add_argument("--starts", type=int, help="track each so many times (default: the recipe's, else 1)")
    fit.add_argument("--max-frames", type=int, help="at most so many frames from each start")
    fit.add_argument("--seed", type=int, default=1, help="of the probes' places (default: 1)")
    fit.add_argument("--threads", type=int, help="threads of the network (default: as PyTorch chooses)")
    where = fit.add_mutually_exclusive_group()
    where.add_argument("--out", metavar="CARD.json", type=Path, help="write the model's card with the fit there")
    where.add_argument("--write", action="store_true", help="write the fit into the model's own card")
    fit.add_argument("--json", action="store_true", help="the fit and its figures as JSON")
    fit.set_defaults(run=_confidence)


def _run(arguments: argparse.Namespace) -> int:
    check_range("--pairs", arguments.pairs, 1, MAX_COUNT)
    if arguments.minutes is not None and not 0 < arguments.minutes < MAX_COUNT:
        raise InputError(f"--minutes {arguments.minutes}: give a number above 0")
    from tracker.training.recipe_file import load_recipe
    from uavfollow.training.errors import as_bad_input

    with as_bad_input():
        recipe = load_recipe(arguments.recipe)
        from uavfollow.training.run import run_training  # only now: it imports PyTorch

        options = run_options(
            arguments, out=arguments.out, resume=arguments.resume, minutes=arguments.minutes, pairs=arguments.pairs
        )
        result = run_training(recipe, options)
    if result.leads:
        _tell(result, arguments)
    return EXIT_DONE if result.outcome.finished else EXIT_INTERRUPTED


def _tell(result: RunResult, arguments: argparse.Namespace) -> None:
    from uavfollow.training.run import outcome_lines

    if not result.outcome.finished:
        tell(f"stopped; go on with: {_again(arguments, result.folder)}")
    if arguments.json:
        print(json.dumps(result.as_json(), indent=1, allow_nan=False))
        return
    print("\n".join(outcome_lines(result)))
    weights = next((p for p in result.outcome.files if p.suffix == ".safetensors"), None)
    if weights is not None and not weights.name.startswith("variant"):
        print(f"use them with: uavfollow track SOURCE --box X,Y,W,H --model {shlex.quote(str(weights))}")


def _again(arguments: argparse.Namespace, folder: Path) -> str:
    """The command that resumes a run."""
    words = ["uavfollow", "train", "run", arguments.recipe, "--out", str(folder), "--resume"]
    for option in ("data", "minutes", "pairs", "packed", "workers", "threads"):
        value = getattr(arguments, option)
        if value not in (None, Path()):
            words += [f"--{option}", str(value)]
    words += ["--device", arguments.device] if arguments.device != "auto" else []
    words += ["--resident"] if arguments.resident else []
    return shlex.join(words)


def _prepare(arguments: argparse.Namespace) -> int:
    check_range("--limit", arguments.limit, 1, MAX_COUNT)
    check_range("--workers", arguments.workers, 0, 256)
    from tracker.training.recipe_file import load_recipe
    from uavfollow.training.errors import as_bad_input

    with as_bad_input():
        recipe = load_recipe(arguments.recipe)
        from uavfollow.training.tools import pack

        report = pack(recipe, arguments.data, arguments.out, arguments.crop_px, arguments.limit, arguments.workers)
    for source in report.sources:
        print(f"{source.name}: {source.crops} crops of {source.tracks} targets, {source.size_bytes / 1e6:.1f} MB")
    for line in report.skipped.lines():
        tell(f"left out: {line}")
    command = shlex.join(["uavfollow", "train", "run", arguments.recipe, "--packed", str(report.folder)])
    print(f"{report.folder}: packed; train from it with: {command}")
    return EXIT_DONE


def _preview(arguments: argparse.Namespace) -> int:
    check_range("--seed", arguments.seed, 0, 2**31)
    from tracker.training.recipe_file import load_recipe
    from uavfollow.training.errors import as_bad_input

    with as_bad_input():
        recipe = load_recipe(arguments.recipe)
        from uavfollow.training.tools import preview

        print(f"wrote {preview(recipe, arguments.data, arguments.out, arguments.stage, arguments.seed)}")
    return EXIT_DONE


def _diagnose(arguments: argparse.Namespace) -> int:
    check_range("--pairs", arguments.pairs, 1, MAX_COUNT)
    check_range("--seed", arguments.seed, 0, 2**31)
    if bool(arguments.sequences) == bool(arguments.recipe):
        raise InputError("give sequence folders, or --recipe RECIPE --data DIR for the sequences of its validation")
    from tracker.training.recipe_file import load_recipe
    from uavfollow.training.errors import as_bad_input

    with as_bad_input():
        recipe = load_recipe(arguments.recipe) if arguments.recipe else None
        from uavfollow.training.material import footage_of_folders, open_validation
        from uavfollow.training.tools import diagnosis_of

        footage = open_validation(recipe, arguments.data) if recipe else footage_of_folders(arguments.sequences)
        diagnosis = diagnosis_of(arguments.model, footage, arguments.pairs, arguments.seed)
    if arguments.json:
        print(json.dumps(diagnosis.as_json(), indent=1, allow_nan=False))
        return EXIT_DONE
    print("\n".join([*diagnosis.table(), *(f"- {line}" for line in diagnosis.verdict())]))
    for line in diagnosis.skipped:
        tell(f"not used: {line}")
    return EXIT_DONE


def _validate(arguments: argparse.Namespace) -> int:
    for option, value in (("--starts", arguments.starts), ("--max-frames", arguments.max_frames)):
        check_range(option, value, 1, 10**6)
    check_range("--threads", arguments.threads, 1, 256)
    if bool(arguments.sequences) == bool(arguments.recipe):
        raise InputError("give sequence folders, or --recipe RECIPE --data DIR for the sequences of its validation")
    from tracker.training.recipe_file import load_recipe
    from uavfollow.training.errors import as_bad_input

    with as_bad_input():
        recipe = load_recipe(arguments.recipe) if arguments.recipe else None
        from tracker.training.recipe import Validation
        from uavfollow.training.judge import judged
        from uavfollow.training.material import footage_of_folders, open_validation

        footage = open_validation(recipe, arguments.data) if recipe else footage_of_folders(arguments.sequences)
        rules = recipe.validation if recipe else Validation()
        result = judged(arguments.model, footage, rules, arguments.starts, arguments.max_frames, arguments.threads)
    print(json.dumps(result.as_json(), indent=1) if arguments.json else "\n".join(result.lines()))
    return EXIT_DONE


def _confidence(arguments: argparse.Namespace) -> int:
    for option, value in (("--starts", arguments.starts), ("--max-frames", arguments.max_frames)):
        check_range(option, value, 1, 10**6)
    check_range("--seed", arguments.seed, 0, 2**31)
    check_range("--threads", arguments.threads, 1, 256)
    if not (arguments.sequences or arguments.recipe):
        raise InputError("give sequence folders, or --recipe RECIPE --data DIR for the sequences of its validation")
    from tracker.training.recipe_file import load_recipe
    from uavfollow.training.errors import as_bad_input

    with as_bad_input():
        recipe = load_recipe(arguments.recipe) if arguments.recipe else None
        from tracker.training.recipe import Validation
        from tracker.training.validate import Tracks
        from uavfollow.training.confidence import CollectOptions, card_place, confidence_of, write_confidence
        from uavfollow.training.material import footage_of_folders, open_validation

        place = card_place(arguments.model, arguments.out) if arguments.out or arguments.write else None
        folders = footage_of_folders(arguments.sequences)
        judged, more = (open_validation(recipe, arguments.data), folders) if recipe else (folders, [])
        rules = recipe.validation if recipe else Validation()
        tracks = Tracks(arguments.starts or rules.starts, arguments.max_frames or rules.max_frames)
        options = CollectOptions(tracks, arguments.seed, arguments.threads)
        report = confidence_of(arguments.model, judged, more, options)
        try:
            if place is not None:
                tell(f"wrote {write_confidence(arguments.model, report, place)}")
        finally:  # what was worked out is told even when it cannot be written
            _show_confidence(report, arguments.json)
    return EXIT_DONE


def _show_confidence(report: ConfidenceReport, as_json: bool) -> None:
    print(json.dumps(report.as_json(), indent=1, allow_nan=False) if as_json else "\n".join(report.lines()))
    for line in report.skipped:
        tell(f"not used: {line}")


def _widen(arguments: argparse.Namespace) -> int:
    from uavfollow.training.errors import as_bad_input
    from uavfollow.training.tools import widened

    with as_bad_input():
        card = widened(arguments.model, arguments.out)
    print(f"{arguments.out}: SiamAPN++ `full`, {card['parameters']:,} parameters, computes what {arguments.model} does")
    return EXIT_DONE


def _maps(arguments: argparse.Namespace) -> int:
    from uavfollow.cli.track import parse_box
    from uavfollow.record.truth import read_truth
    from uavfollow.training.errors import as_bad_input
    from uavfollow.video.source import open_source

    check_range("--frame", arguments.frame, 2, MAX_COUNT)
    if bool(arguments.box) == bool(arguments.truth):
        raise InputError("give the target in the first picture: --box X,Y,W,H or --truth FILE, one of them")
    source = open_source(arguments.source, None)
    box = parse_box(arguments.box) if arguments.box else read_truth(arguments.truth)[0]
    if box is None:
        raise InputError(f"--truth {arguments.truth}: the first row has no target; give the box with --box X,Y,W,H")
    from uavfollow.training.maps import write_maps

    with as_bad_input():
        print(f"wrote {write_maps(arguments.model, source, box, arguments.frame, arguments.out)}")
    return EXIT_DONE


def _list(arguments: argparse.Namespace) -> int:
    from tracker.training.recipe_file import builtin_names, load_recipe

    for name in builtin_names():
        print(f"{name:10} {load_recipe(name).description}")
    return EXIT_DONE


def _show(arguments: argparse.Namespace) -> int:
    from tracker.training.recipe_file import recipe_text
    from uavfollow.training.errors import as_bad_input

    with as_bad_input():
        print(recipe_text(arguments.recipe), end="")
    return EXIT_DONE
