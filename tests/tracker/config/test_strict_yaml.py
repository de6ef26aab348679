from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tracker.config.errors import ConfigError
from tracker.config.strict_yaml import MAX_CHARACTERS, dotted, read_yaml


def value_of(text: str) -> object:
    data, _ = read_yaml(f"key: {text}", "file")
    assert isinstance(data, dict)
    return data["key"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1e-3", 0.001),
        ("1.5e3", 1500.0),
        ("-2E+2", -200.0),
        (".5", 0.5),
        ("3.", 3.0),
        ("010", 10),
        ("-7", -7),
        ("true", True),
        ("on", "on"),
        ("no", "no"),
        ("1:30", "1:30"),
        ("2026-11-25", "2026-11-25"),
        ("0x10", "0x10"),
        ("null", None),
        ("", None),
        ("~", None),
        ("'1e-3'", "1e-3"),
    ],
)
def test_scalars(text: str, expected: object) -> None:
    value = value_of(text)
    assert value == expected
    assert type(value) is type(expected)


def test_not_finite_numbers_are_numbers_that_the_schema_refuses() -> None:
    assert value_of(".inf") == math.inf
    assert math.isnan(value_of(".nan"))  # type: ignore[arg-type]
    assert value_of("1e400") == math.inf
    assert value_of("9" * 5000) == math.inf


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_float_that_python_writes_comes_back(number: float) -> None:
    assert float(value_of(repr(number))) == number  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a: 1\nb: 2\na: 3\n", "line 3: a: the key stands twice"),
        ("a:\n  b: 1\n  b: 1\n", "line 3: a.b: the key stands twice"),
        ("a: [1\nb: 2\n", "line 2: not valid YAML"),
        ("a: 1\n\tb: 2\n", "line 2: not valid YAML"),
        ("a: &x 1\nb: *x\n", "aliases"),
        ("1: a\n", "line 1: a key must be a word, not '1'"),
        ("[1, 2]: a\n", "a key must be a word, not a list"),
        ("", "empty"),
        ("a: !!python/object:os.system 1\n", "not valid YAML"),
        ("a: 1\n---\nb: 1\n", "not valid YAML"),
        ("a: \x00", "not valid YAML"),
        ("[" * 600, "not valid YAML"),
        (" " * (MAX_CHARACTERS + 1), "characters"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(text: str, expected: str) -> None:
    with pytest.raises(ConfigError) as caught:
        read_yaml(text, "some.yaml")
    assert expected in str(caught.value)
    assert str(caught.value).startswith("some.yaml: ")
    assert "\n" not in str(caught.value)


def test_lines_of_keys_and_items() -> None:
    _, lines = read_yaml("a: 1\nb:\n  - c: 2\n  - c: 3\n", "file")
    assert lines["a",] == 1
    assert lines["b",] == 2
    assert lines["b", 0, "c"] == 3
    assert lines["b", 1, "c"] == 4


def test_dotted() -> None:
    assert dotted(("events", 0, "at_s")) == "events[0].at_s"
    assert dotted(()) == ""


@given(st.text(max_size=60))
def test_any_text_gives_data_or_one_clear_error(text: str) -> None:
    told = "file: "
    try:
        read_yaml(text, "file")
    except ConfigError as error:
        told = str(error)
    assert told.startswith("file: ")
    assert "\n" not in told
