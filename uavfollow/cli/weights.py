"""`uavfollow weights`: print a card, import an official checkpoint."""

from __future__ import annotations

import argparse
import json
import shlex
from pathlib import Path
from typing import Any

from uavfollow.errors import EXIT_DONE, InputError

NAME = "weights"


def add_parser(commands: Any) -> Any:
    """Add the command to the subparsers; returns its parser."""
    parser = commands.add_parser(NAME, help="print a weights card, import an official checkpoint")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    info = verbs.add_parser("info", help="print the card of a model")
    info.add_argument("model", nargs="?", default="s", help="s, full or a .safetensors file (default: s)")
    info.add_argument("--json", action="store_true", help="the card as JSON")
    info.set_defaults(run=_info)
    convert = verbs.add_parser("import", help="official .pth to .safetensors, without running pickled code")
    convert.add_argument("checkpoint", metavar="FILE.pth")
    convert.add_argument("--out", metavar="FILE", help="where to write (default: FILE.safetensors beside it)")
    convert.set_defaults(run=_import)
    return parser


def _info(arguments: argparse.Namespace) -> int:
    from tracker.weights.errors import WeightsError
    from tracker.weights.store import load

    try:
        weights = load(arguments.model)
    except WeightsError as error:
        raise InputError(str(error)) from error
    card = weights.card or {"name": weights.path.stem, "size": weights.size, "note": "this file has no card"}
    if arguments.json:
        print(json.dumps({"file": str(weights.path), **card}, indent=1))
        return EXIT_DONE
    print(f"{card['name']}  ({weights.path})")
    for key, value in card.items():
        if key != "name":
            _print_entry(key, value)
    return EXIT_DONE


def _print_entry(key: str, value: Any, indent: str = "  ") -> None:
    if isinstance(value, dict):
        print(f"{indent}{key}:")
        for inner, item in value.items():
            _print_entry(inner, item, indent + "  ")
    elif isinstance(value, list) and any(isinstance(item, str) for item in value):
        print(f"{indent}{key}:")
        for item in value:
            print(f"{indent}  - {item}")
    else:
        print(f"{indent}{key}: {value}")


def _import(arguments: argparse.Namespace) -> int:
    from tracker.weights.checkpoint import import_checkpoint
    from tracker.weights.errors import WeightsError

    source = Path(arguments.checkpoint)
    target = Path(arguments.out) if arguments.out else source.with_suffix(".safetensors")
    if target.suffix != ".safetensors":
        raise InputError(f"{target}: weights are written as .safetensors; choose such a name for --out")
    try:
        card = import_checkpoint(source, target)
    except WeightsError as error:
        raise InputError(str(error)) from error
    print(f"{target}: SiamAPN++ `{card['size']}`, {card['parameters']:,} parameters, sha256 {card['sha256'][:12]}...")
    print(f"use it with: uavfollow track SOURCE --box X,Y,W,H --model {shlex.quote(str(target))}")
    return EXIT_DONE
