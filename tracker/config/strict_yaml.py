"""YAML read strictly: a key twice is an error, `1e-3` is a number, `on` is text and `010` is ten."""

from __future__ import annotations

import re

import yaml

from tracker.config.errors import ConfigError

KeyPath = tuple[str | int, ...]

# Files are written by hand: one beyond this was not meant as such a file.
MAX_CHARACTERS = 1_000_000


class _Loader(yaml.SafeLoader):
    """SafeLoader with the scalars of YAML 1.2: decimal integers, floats, true/false, null; all else is text."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012  the base class wants it


def _resolve(kind: str, pattern: str, first: str) -> None:
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{kind}", re.compile(pattern), list(first) if first else [""])


_resolve("null", r"^(?:~|null|Null|NULL)$", "~nN")
_resolve("null", r"^$", "")
_resolve("bool", r"^(?:true|True|TRUE|false|False|FALSE)$", "tTfF")
_resolve("int", r"^[-+]?[0-9]+$", "-+0123456789")
_resolve("float", r"^[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?$", "-+.0123456789")
_resolve("float", r"^(?:[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$", "-+.")


def _decimal(loader: _Loader, node: yaml.ScalarNode) -> int | float:
    try:
        return int(node.value)
    except ValueError:  # Python refuses thousands of digits
        return float(node.value)


_Loader.add_constructor("tag:yaml.org,2002:int", _decimal)


def read_yaml(text: str, where: str, error: type[ConfigError] = ConfigError) -> tuple[object, dict[KeyPath, int]]:
    """The data of one YAML document, and the line (from 1) of each key path in it.

    Raises `error` with the line for a syntax error, a key that stands twice or is no text, and for aliases.
    """
    if len(text) > MAX_CHARACTERS:
        raise error(where, [f"{len(text)} characters: more than {MAX_CHARACTERS}, not a file of settings"])
    lines: dict[KeyPath, int] = {}
    try:
        loader = _Loader(text)
        node = loader.get_single_node()
        if node is None:
            raise error(where, ["the file is empty"])
        problems: list[str] = []
        _walk(node, (), lines, problems, set())
        if problems:
            raise error(where, problems)
        return loader.construct_document(node), lines
    except yaml.MarkedYAMLError as fault:
        line = f"line {fault.problem_mark.line + 1}: " if fault.problem_mark else ""
        raise error(where, [f"{line}not valid YAML: {fault.problem}"]) from fault
    except yaml.YAMLError as fault:  # characters that no YAML holds
        raise error(where, [f"not valid YAML: {str(fault).splitlines()[0]}"]) from fault
    except RecursionError as fault:
        raise error(where, ["not valid YAML: nested too deeply"]) from fault


def _walk(node: yaml.Node, path: KeyPath, lines: dict[KeyPath, int], problems: list[str], seen: set[int]) -> None:
    """Note the line of each path; find doubled keys and nodes that stand at two places (aliases)."""
    line = node.start_mark.line + 1
    lines.setdefault(path, line)
    if id(node) in seen:
        problems.append(f"line {line}: aliases (*name) are not used here; write the value out")
        return
    seen.add(id(node))
    if isinstance(node, yaml.SequenceNode):
        for index, item in enumerate(node.value):
            _walk(item, (*path, index), lines, problems, seen)
    elif isinstance(node, yaml.MappingNode):
        keys: set[str] = set()
        for key, value in node.value:
            key_line = key.start_mark.line + 1
            if not isinstance(key, yaml.ScalarNode) or key.tag != "tag:yaml.org,2002:str":
                problems.append(f"line {key_line}: a key must be a word, not {_shown(key)}")
                continue
            here = (*path, key.value)
            if key.value in keys:
                problems.append(f"line {key_line}: {dotted(here)}: the key stands twice")
                continue
            keys.add(key.value)
            lines[here] = key_line
            _walk(value, here, lines, problems, seen)


def _shown(node: yaml.Node) -> str:
    return repr(node.value) if isinstance(node, yaml.ScalarNode) else "a list or a mapping"


def dotted(path: KeyPath) -> str:
    """`events[0].at_s` for ("events", 0, "at_s")."""
    text = ""
    for part in path:
        word = part if isinstance(part, str) and part.isprintable() else repr(part)
        text += f"[{part}]" if isinstance(part, int) else f".{word}" if text else word
    return text
