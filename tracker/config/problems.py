"""What pydantic found, said in the terms of the file: the path of the key, its line, and what to do."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, get_args, get_origin

from pydantic import BaseModel, Tag, ValidationError

from tracker.config.errors import suggestion
from tracker.config.strict_yaml import KeyPath, dotted

_Location = tuple[int | str, ...]


def problems_of(error: ValidationError, root: type[BaseModel], lines: Mapping[KeyPath, int] | None = None) -> list[str]:
    """One line for each finding of reading a `root`, in the order of the file, the likeliest key named."""
    found: list[tuple[int, str]] = []
    for item in error.errors(include_url=False):
        path = tuple(part for part in item["loc"] if not _is_tag(part))
        line = _line(path, lines or {})
        where = f"line {line}: " if line else ""
        found.append((line, f"{where}{dotted(path) or root.__name__.lower()}: {_said(dict(item), path, root)}"))
    return [text for _, text in sorted(found, key=lambda entry: entry[0])]


def _is_tag(part: int | str) -> bool:
    return isinstance(part, str) and part.startswith("@")


def _line(path: KeyPath, lines: Mapping[KeyPath, int]) -> int:
    """The line of the path, or of the nearest section around it; 0 when nothing is known."""
    for length in range(len(path), -1, -1):
        if path[:length] in lines:
            return lines[path[:length]]
    return 0


def _said(item: dict[str, Any], path: KeyPath, root: type[BaseModel]) -> str:
    kind, given, context = item["type"], item.get("input"), item.get("ctx", {})
    if kind == "extra_forbidden":
        known = sorted(_keys_at(root, item["loc"][:-1]))
        return f"unknown key{suggestion(path[-1], known) or '; known are ' + ', '.join(known)}"
    if kind == "missing":
        return "missing; it must be given"
    if kind in ("enum", "literal_error"):
        expected = str(context["expected"]).replace("'", "")
        near = suggestion(given, expected.replace(" or ", ", ").split(", "))
        return f"{given!r} is not one of {expected}{near}"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return f"{_short(given)}: must be a section with keys of its own"
    if kind in ("tuple_type", "list_type"):
        return f"{_short(given)}: must be a list"
    if kind in ("too_short", "too_long"):
        return f"{_short(given)}: {item['msg'][0].lower()}{item['msg'][1:]}"
    if kind == "string_pattern_mismatch":
        return f"{given!r}: must match {context['pattern']}"
    if kind in ("not_a_number", "out_of_range", "unknown_kind"):
        return str(item["msg"])
    return f"{_short(given)}: {item['msg'][0].lower()}{item['msg'][1:]}"


def _short(given: object) -> str:
    text = repr(given)
    return text if len(text) <= 40 else text[:37] + "..."


def _keys_at(root: type[BaseModel], location: _Location) -> set[str]:
    """Every key that the section at `location` (with tags) may have."""
    places: list[Any] = [root]
    for part in location:
        if isinstance(part, int):
            continue
        if _is_tag(part):
            places = [member for place in places for member in _tagged(place, str(part))]
        else:
            places = [
                _kept(field.annotation, field.metadata)
                for place in places
                for section in _sections(place)
                for name, field in section.model_fields.items()
                if part in (name, field.alias)
            ]
    return {f.alias or name for place in places for s in _sections(place) for name, f in s.model_fields.items()}


def _kept(annotation: Any, metadata: list[Any]) -> Any:
    """The annotation of a field with its metadata, which pydantic keeps apart."""
    for extra in metadata:
        annotation = Annotated[annotation, extra]
    return annotation


def _parts(annotation: Any) -> tuple[Any, ...]:
    return get_args(annotation)[:1] if get_origin(annotation) is Annotated else get_args(annotation)


def _sections(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
        return
    for part in _parts(annotation):
        yield from _sections(part)


def _tagged(annotation: Any, tag: str) -> Iterator[Any]:
    """The members of a union that carry this tag."""
    if get_origin(annotation) is Annotated and any(
        isinstance(m, Tag) and m.tag == tag for m in annotation.__metadata__
    ):
        yield annotation
        return
    for part in _parts(annotation):
        yield from _tagged(part, tag)
