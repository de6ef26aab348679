"""What pydantic found, said in the terms of the file: the path of the key, its line, and what to do."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, get_args, get_origin

from pydantic import BaseModel, Field, Tag, ValidationError
from pydantic.fields import FieldInfo

from tracker.config.errors import suggestion
from tracker.config.strict_yaml import KeyPath, dotted

_Location = tuple[int | str, ...]

_SHOWN_CHARACTERS = 40  # of a value: more hides what is said about it
_NO_CHOICE = ("union_tag_invalid", "union_tag_not_found")  # of a union told apart by a key of its members
_ONE_OF_US = ("model_type", "model_attributes_type", "dict_type")


def problems_of(error: ValidationError, root: type[BaseModel], lines: Mapping[KeyPath, int] | None = None) -> list[str]:
    """One line for each finding of reading a `root`, in the order of the file, the likeliest key named."""
    found: list[tuple[int, str]] = []
    for item in error.errors(include_url=False):
        path, places = _follow(root, item["loc"])
        if item["type"] in _NO_CHOICE:
            path = (*path, *_deciding_key(dict(item)))
        line = line_of(path, lines or {})
        where = f"line {line}: " if line else ""
        found.append((line, f"{where}{dotted(path) or root.__name__.lower()}: {_said(dict(item), places, root)}"))
    return [text for _, text in sorted(found, key=lambda entry: entry[0])]


def line_of(path: KeyPath, lines: Mapping[KeyPath, int]) -> int:
    """The line of the path, or of the nearest section around it; 0 when nothing is known."""
    for length in range(len(path), -1, -1):
        if path[:length] in lines:
            return lines[path[:length]]
    return 0


def _said(item: dict[str, Any], places: Sequence[Any], root: type[BaseModel]) -> str:
    kind, given, context = item["type"], item.get("input"), item.get("ctx", {})
    if kind == "extra_forbidden":
        known = sorted(_keys_of(_follow(root, item["loc"][:-1])[1]))
        return f"unknown key{suggestion(item['loc'][-1], known) or '; known are ' + ', '.join(known)}"
    if kind == "missing":
        return "missing; it must be given"
    if kind in _NO_CHOICE:
        return _no_choice(item, places)
    if kind in ("enum", "literal_error"):
        return _not_one_of(given, str(context["expected"]).replace("'", ""))
    if kind in _ONE_OF_US:
        return f"{_short(given)}: must be a section with keys of its own"
    if kind in ("tuple_type", "list_type"):
        return f"{_short(given)}: must be a list"
    return _said_of_a_value(item)


def _said_of_a_value(item: dict[str, Any]) -> str:
    kind, given, context, message = item["type"], item.get("input"), item.get("ctx", {}), str(item["msg"])
    if kind == "string_pattern_mismatch":
        return f"{given!r}: must match {context['pattern']}"
    if kind in ("not_a_number", "out_of_range", "unknown_kind"):
        return message
    if kind == "value_error":  # a validator of ours: it says itself what it found
        return str(context["error"])
    return f"{_short(given)}: {message[0].lower()}{message[1:]}"


def _not_one_of(given: object, expected: str) -> str:
    return f"{given!r} is not one of {expected}{suggestion(given, expected.replace(' or ', ', ').split(', '))}"


def _no_choice(item: dict[str, Any], places: Sequence[Any]) -> str:
    """No member of a union carries the tag that stands there, or none stands there."""
    (key,) = _deciding_key(item) or ("",)
    known = ", ".join(tag for place in places for tag in _tags(place, key))
    given = item["input"].get(key) if isinstance(item.get("input"), Mapping) else None
    return f"missing; it must be one of {known}" if given is None else _not_one_of(given, known)


def _deciding_key(item: dict[str, Any]) -> tuple[str, ...]:
    """The key that decides between the members of a union; none when a function decides."""
    key = str(item.get("ctx", {}).get("discriminator", "")).strip("'")
    return (key,) if key.isidentifier() else ()


def _short(given: object) -> str:
    text = "empty" if given is None else repr(given)
    return text if len(text) <= _SHOWN_CHARACTERS else text[: _SHOWN_CHARACTERS - 3] + "..."


def _follow(root: type[BaseModel], location: _Location) -> tuple[KeyPath, list[Any]]:
    """Where pydantic's location leads: the keys of the file, without the tags of unions, and the annotations there."""
    places: list[Any] = [root]
    path: list[str | int] = []
    for part in location:
        members = [] if isinstance(part, int) else [m for place in places for m in _tagged(place, part)]
        if members:
            places = members
            continue
        path.append(part)
        if isinstance(part, str):
            places = [
                _kept(field)
                for place in places
                for section in _sections(place)
                for name, field in section.model_fields.items()
                if part in (name, field.alias)
            ]
    return tuple(path), places


def _keys_of(places: Sequence[Any]) -> set[str]:
    """Every key that the sections at these places may have."""
    return {f.alias or name for place in places for s in _sections(place) for name, f in s.model_fields.items()}


def _kept(field: FieldInfo) -> Any:
    """The annotation of a field with its metadata and what tells its members apart, which pydantic keeps apart."""
    annotation: Any = field.annotation
    for extra in field.metadata:
        annotation = Annotated[annotation, extra]
    return Annotated[annotation, Field(discriminator=field.discriminator)] if field.discriminator else annotation


def _parts(annotation: Any) -> tuple[Any, ...]:
    return get_args(annotation)[:1] if get_origin(annotation) is Annotated else get_args(annotation)


def _sections(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
        return
    for part in _parts(annotation):
        yield from _sections(part)


def _tagged(annotation: Any, tag: str) -> Iterator[Any]:
    """The members of a union that carry this tag: as a Tag, or as the value of the key that tells them apart."""
    if get_origin(annotation) is Annotated:
        for extra in annotation.__metadata__:
            if isinstance(extra, Tag) and extra.tag == tag:
                yield get_args(annotation)[0]
                return
            key = extra.discriminator if isinstance(extra, FieldInfo) else None
            if isinstance(key, str):
                yield from (section for section in _sections(annotation) if tag in _values(section, key))
                return
    for part in _parts(annotation):
        yield from _tagged(part, tag)


def _tags(annotation: Any, key: str) -> Iterator[str]:
    for section in _sections(annotation):
        yield from _values(section, key)


def _values(section: type[BaseModel], key: str) -> tuple[str, ...]:
    """What the key of a member may be: the values of its Literal."""
    field = section.model_fields.get(key)
    return tuple(str(value) for value in get_args(field.annotation)) if field else ()
