"""Scenarios from files and from those that come with the package."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import Path

from pydantic import ValidationError

from sitl.scenario.check import check_scenario
from sitl.scenario.errors import ScenarioError
from sitl.scenario.schema import Scenario
from tracker.config.errors import suggestion
from tracker.config.problems import problems_of
from tracker.config.strict_yaml import KeyPath, read_yaml

_SUFFIXES = (".yaml", ".yml")


def builtin_names() -> tuple[str, ...]:
    """Names of the scenarios of the package, sorted."""
    folder = resources.files("sitl") / "scenarios"
    return tuple(sorted(entry.name[: -len(".yaml")] for entry in folder.iterdir() if entry.name.endswith(".yaml")))


def load_scenario(path_or_name: str | Path) -> Scenario:
    """The scenario of a file (anything with a folder or .yaml in it) or of a built-in name, checked as a whole.

    Raises ScenarioError with every finding: a file that is not there or no YAML, unknown keys, values out of range,
    impossible geometry.
    """
    text, where = _read(path_or_name)
    return parse_scenario(text, where)


def parse_scenario(text: str, where: str) -> Scenario:
    """The scenario in `text`, checked as a whole; `where` names it in errors. Raises ScenarioError."""
    data, lines = read_yaml(text, where, ScenarioError)
    return from_mapping(data, where, lines)


def from_mapping(data: object, where: str, lines: Mapping[KeyPath, int] | None = None) -> Scenario:
    """The scenario in plain data, checked as a whole. Raises ScenarioError."""
    try:
        scenario = Scenario.model_validate(data)
    except ValidationError as error:
        raise ScenarioError(where, problems_of(error, Scenario, lines)) from error
    check_scenario(scenario, where)
    return scenario


def _read(path_or_name: str | Path) -> tuple[str, str]:
    """Text, and what to call it in errors."""
    given = str(path_or_name)
    path = Path(path_or_name)
    is_name = isinstance(path_or_name, str) and path.name == given and path.suffix not in _SUFFIXES
    if is_name and given in builtin_names():
        return (resources.files("sitl") / "scenarios" / f"{given}.yaml").read_text("utf-8"), given
    if is_name and not path.is_file():
        names = builtin_names()
        hint = suggestion(given, names)
        raise ScenarioError(given, [f"no such scenario{hint} (built in: {', '.join(names)}; or give a .yaml file)"])
    try:
        return path.read_text("utf-8"), given
    except UnicodeDecodeError as error:
        raise ScenarioError(given, [f"not text in UTF-8: {error.reason} at byte {error.start}"]) from error
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise ScenarioError(given, [f"cannot be read: {reason}"]) from error
