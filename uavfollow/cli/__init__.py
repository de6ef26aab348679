"""The command line: one parser, one module per command. Nothing heavy is imported before a command needs it."""

from __future__ import annotations

import argparse
import difflib
from typing import NoReturn

import uavfollow
from uavfollow.cli import bench, sim, sitl, track, train, weights
from uavfollow.errors import InputError

DESCRIPTION = "MAVLink visual servoing: follow a target in the picture, steer gimbal and vehicle."


class Parser(argparse.ArgumentParser):
    """argparse with one-line errors that go the way of every other bad input."""

    def error(self, message: str) -> NoReturn:
        """Raise InputError instead of printing the whole usage."""
        if "expected one argument" in message:
            message += "; a value that begins with - is written with =, as in --box=-20,10,50,50"
        raise InputError(f"{message} (see `{self.prog} --help`)")

    def known_options(self) -> list[str]:
        """Long options of this parser and of its own commands."""
        own = [o for action in self._actions for o in action.option_strings if o.startswith("--")]
        below = [a.choices.values() for a in self._actions if isinstance(a, argparse._SubParsersAction)]
        return own + [o for parsers in below for parser in parsers for o in parser.known_options()]


def build_parser() -> tuple[Parser, dict[str, Parser]]:
    """The parser and its commands by name."""
    parser = Parser(prog="uavfollow", description=DESCRIPTION)
    parser.add_argument("--version", action="version", version=f"uavfollow {uavfollow.__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    made = {module.NAME: module.add_parser(commands) for module in (sim, sitl, track, train, weights, bench)}
    return parser, made


def run(argv: list[str]) -> int:
    """Parse and run. Raises InputError on anything the user must mend."""
    for argument in argv:
        _check_argument(argument)
    parser, commands = build_parser()
    arguments, unknown = parser.parse_known_args(argv)
    if unknown:
        command = commands[arguments.command]
        close = difflib.get_close_matches(unknown[0].split("=")[0], command.known_options(), 1)
        hint = f"; did you mean {close[0]}?" if close else f" (see `{command.prog} --help`)"
        raise InputError(f"unknown argument {unknown[0]}{hint}")
    code: int = arguments.run(arguments)
    return code


def _check_argument(argument: str) -> None:
    if not argument:
        raise InputError("an argument is empty; is a variable of the shell not set?")
    try:
        argument.encode()
    except UnicodeEncodeError as error:  # OpenCV ends the program on such a name
        raise InputError(f"{argument!r} is not UTF-8; rename the file, or set LC_ALL=C.UTF-8") from error
