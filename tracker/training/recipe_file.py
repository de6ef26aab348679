"""Recipes from files and from those that come with the package, checked as a whole."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path

from pydantic import ValidationError

from tracker.config.errors import ConfigError, suggestion
from tracker.config.problems import line_of, problems_of
from tracker.config.strict_yaml import KeyPath, dotted, read_yaml
from tracker.training.recipe import AnySource, Folders, Got10k, Recipe, Simulator, Variant
from tracker.training.source_names import source_name

_SUFFIXES = (".yaml", ".yml")
_PACKAGE = "tracker.training.recipes"
_BUILTIN_FOLDER = "recipes"  # `recipes/smoke.yaml` is how the documents name a built-in recipe
WHOLE_SEQUENCES = (Folders, Got10k, Simulator)  # kinds that validation can use


class RecipeError(ConfigError):
    """A recipe that cannot be used. `problems` holds every finding; the text is one line with the first of them."""


def builtin_names() -> tuple[str, ...]:
    """Names of the recipes of the package, sorted."""
    entries = resources.files(_PACKAGE).iterdir()
    return tuple(sorted(e.name.removesuffix(".yaml") for e in entries if e.name.endswith(".yaml")))


def recipe_text(name: str) -> str:
    """The file of a built-in recipe, comments and all. Raises RecipeError for a name that is not built in."""
    names = builtin_names()
    if name not in names:
        raise RecipeError(name, [f"no such recipe{suggestion(name, names)} (built in: {', '.join(names)})"])
    return (resources.files(_PACKAGE) / f"{name}.yaml").read_text("utf-8")


def load_recipe(path_or_name: str | Path) -> Recipe:
    """The recipe of a file or of a built-in name, checked as a whole.

    A file that is there comes first; `NAME` (when no folder or suffix is in it) and `recipes/NAME.yaml` are else built
    in. Raises RecipeError with every finding.
    """
    text, where = _read(path_or_name)
    return parse_recipe(text, where)


def parse_recipe(text: str, where: str) -> Recipe:
    """The recipe in `text`, checked as a whole; `where` names it in errors. Raises RecipeError."""
    data, lines = read_yaml(text, where, RecipeError)
    try:
        recipe = Recipe.model_validate(data)
    except ValidationError as error:
        raise RecipeError(where, problems_of(error, Recipe, lines)) from error
    problems = [_placed(path, text, lines) for path, text in _contradictions(recipe)]
    if problems:
        raise RecipeError(where, problems)
    return recipe


def _contradictions(recipe: Recipe) -> Iterator[tuple[KeyPath, str]]:
    """What no section can see by itself."""
    yield from _same_names(recipe.sources, ("sources",))
    yield from _same_names(recipe.validation.sources, ("validation", "sources"))
    for index, spec in enumerate(recipe.validation.sources):
        if not isinstance(spec, WHOLE_SEQUENCES):
            yield (
                ("validation", "sources", index, "kind"),
                f"{spec.kind} has no whole sequences; validation takes folders, got10k or simulator",
            )
    if recipe.variant is not Variant.AAN:
        yield from _foreign_weights(recipe)


def _foreign_weights(recipe: Recipe) -> Iterator[tuple[KeyPath, str]]:
    """Weights of SiamAPN++ in a run of another variant."""
    why = f"weights of SiamAPN++ do not fit variant {recipe.variant.value}; start from a backbone, or set variant: aan"
    if recipe.start.model:
        yield ("start", "model"), why
    if recipe.start.widen:
        yield ("start", "widen"), why
    if recipe.teacher:
        yield ("teacher",), f"SiamAPN++ would teach variant {recipe.variant.value} what the comparison is to show"


def _same_names(sources: Sequence[AnySource], path: KeyPath) -> Iterator[tuple[KeyPath, str]]:
    first: dict[str, int] = {}
    for index, spec in enumerate(sources):
        name = source_name(spec)
        if name in first:
            yield (*path, index), f"is called {name}, as {dotted((*path, first[name]))} is; give one another name:"
        first.setdefault(name, index)


def _placed(path: KeyPath, text: str, lines: Mapping[KeyPath, int]) -> str:
    line = line_of(path, lines)
    return f"{f'line {line}: ' if line else ''}{dotted(path)}: {text}"


def _read(path_or_name: str | Path) -> tuple[str, str]:
    """Text, and what to call it in errors."""
    given = str(path_or_name)
    path = Path(path_or_name)
    if not path.exists():
        name = _builtin_name(path)
        if name in builtin_names() or path.suffix not in _SUFFIXES:
            return recipe_text(name), given
    try:
        return path.read_text("utf-8"), given
    except UnicodeDecodeError as error:
        raise RecipeError(given, [f"not text in UTF-8: {error.reason} at byte {error.start}"]) from error
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise RecipeError(given, [f"cannot be read: {reason} (built in: {', '.join(builtin_names())})"]) from error


def _builtin_name(path: Path) -> str:
    """`smoke` for `smoke` and `recipes/smoke.yaml`; other paths as they are."""
    if path.suffix in _SUFFIXES and str(path.parent) == _BUILTIN_FOLDER:
        return path.stem
    return str(path)
