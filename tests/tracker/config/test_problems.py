from __future__ import annotations

from typing import Annotated, Literal

import pytest
from pydantic import Field, Tag, ValidationError, model_validator

from tracker.config.errors import ConfigError
from tracker.config.fields import Bounds, Section
from tracker.config.problems import problems_of
from tracker.config.strict_yaml import read_yaml


class Inner(Section):
    gain: tuple[float, float] = (0.0, 1.0)


class Still(Section):
    kind: Literal["still"]
    path: str
    inner: Inner = Inner()


class Video(Section):
    kind: Literal["video", "film"]
    path: str
    fps: Annotated[float, Bounds(1.0, 100.0)] = 25.0


Any = Annotated[Still | Video, Field(discriminator="kind")]


class Root(Section):
    sources: tuple[Any, ...]
    main: Any | None = None
    only: Annotated[Still | Video, Field(discriminator="kind")] = Field(default=Still(kind="still", path="x"))
    inner: Inner = Inner()
    curve: Literal["flat", "steep"] = "flat"

    @model_validator(mode="after")
    def _some(self) -> Root:
        if not self.sources:
            raise ValueError("at least one source")
        return self


def problems(text: str) -> list[str]:
    data, lines = read_yaml(text, "file", ConfigError)
    with pytest.raises(ValidationError) as caught:
        Root.model_validate(data)
    return problems_of(caught.value, Root, lines)


KNOWN = "still, video, film"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("sources: [{kind: stil, path: a}]", f"sources[0].kind: 'stil' is not one of {KNOWN}; did you mean still?"),
        ("sources: [{kind: 7, path: a}]", f"sources[0].kind: 7 is not one of {KNOWN}"),
        ("sources: [{path: a}]", f"sources[0].kind: missing; it must be one of {KNOWN}"),
        ("sources: [{kind:, path: a}]", f"sources[0].kind: missing; it must be one of {KNOWN}"),
        ("sources: [3]", "sources[0]: 3: must be a section with keys of its own"),
        ("sources: [~]", "sources[0]: empty: must be a section with keys of its own"),
        ("sources: [{kind: still}]", "sources[0].path: missing; it must be given"),
        ("sources: [{kind: film, path: a, fp: 3}]", "sources[0].fp: unknown key; did you mean fps?"),
        ("sources: [{kind: film, path: a, still: 3}]", "sources[0].still: unknown key; known are fps, kind, path"),
        ("sources: [{kind: still, path: a, still: 3}]", "sources[0].still: unknown key; known are inner, kind, path"),
        ("sources: [{kind: film, path: a, fps: 0}]", "sources[0].fps: 0: must be a number from 1 to 100"),
        ("sources: [{kind: still, path: a, inner: {gan: 1}}]", "sources[0].inner.gan: unknown key; did you mean gain?"),
        ("sources: [{kind: still, path: a, inner: {gain: [1]}}]", "sources[0].inner.gain[1]: missing"),
        ("sources: []", "root: at least one source"),
        ("sources:", "sources: empty: must be a list"),
        ("sources: [{kind: film, path: a}]\ninner:", "inner: empty: must be a section with keys of its own"),
        ("sources: [{kind: film, path: a}]\nmain: {kind: fil, path: a}", "main.kind: 'fil' is not one of"),
        (
            "sources: [{kind: film, path: a}]\nmain: {kind: film, path: a, pth: 1}",
            "main.pth: unknown key; did you mean",
        ),
        ("sources: [{kind: film, path: a}]\nonly: {kind: fil, path: a}", "only.kind: 'fil' is not one of"),
        (
            "sources: [{kind: film, path: a}]\nonly: {kind: film, path: a, pth: 1}",
            "only.pth: unknown key; did you mean",
        ),
        (
            "sources: [{kind: film, path: a}]\ncurve: flut",
            "curve: 'flut' is not one of flat or steep; did you mean flat?",
        ),
    ],
)
def test_each_finding_in_the_terms_of_the_file(text: str, expected: str) -> None:
    (found,) = problems(text)
    assert found.partition(": ")[2].startswith(expected), found
    assert "alue error" not in found


def test_the_line_is_that_of_the_key_and_the_order_that_of_the_file() -> None:
    found = problems(
        "inner:\n  gan: 1\nsources:\n  - kind: film\n    path: a\n    fps: 0\n  - kind: fils\n    path: b\n"
    )
    assert [text.split(":")[0] for text in found] == ["line 2", "line 6", "line 7"]


def test_an_optional_section_may_be_null() -> None:
    data, _ = read_yaml("sources: [{kind: film, path: a}]\nmain:\n", "file", ConfigError)
    assert Root.model_validate(data).main is None


def test_tags_of_functions_do_not_show_and_a_key_like_a_tag_does() -> None:
    from pydantic import Discriminator

    class Tagged(Section):
        items: tuple[
            Annotated[
                Annotated[Still, Tag("@still")] | Annotated[Inner, Tag("@inner")],
                Discriminator(lambda value: "@still" if "path" in value else "@inner"),
            ],
            ...,
        ]

    with pytest.raises(ValidationError) as caught:
        Tagged.model_validate({"items": [{"kind": "still", "path": "a", "@still": 1}, {"gan": 1}]})
    assert problems_of(caught.value, Tagged) == [
        "items[0].@still: unknown key; known are inner, kind, path",
        "items[1].gan: unknown key; did you mean gain?",
    ]
