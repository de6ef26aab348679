"""The folder of a run: a new one, or one whose run goes on with the very same recipe."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tracker.training.checkpoint import RECIPE, has_checkpoint, read_recipe
from tracker.training.recipe import Recipe
from uavfollow.errors import InputError
from uavfollow.record.output import free_folder


def run_folder(recipe: Recipe, out: Path | None, resume: bool) -> Path:
    """The folder, made if need be. Raises InputError: a run lies there unasked, none to resume, another recipe."""
    if resume:
        return _to_resume(recipe, out)
    folder = out or free_folder(f"train-{recipe.name}", RECIPE)
    if (folder / RECIPE).exists():
        raise InputError(f"--out {folder}: a run lies there; add --resume to go on with it, or choose another folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {folder}: cannot be made ({error.strerror or error}); choose another one") from error
    return folder


def difference(then: Recipe, now: Recipe) -> str | None:
    """The first difference of two recipes as `stages[0].lr was 0.001 and is 0.002`; None when they are the same."""
    for path, old, new in _differences(then.model_dump(mode="json"), now.model_dump(mode="json"), ""):
        return f"{path} was {_shown(old)} and is {_shown(new)}"
    return None


def _to_resume(recipe: Recipe, out: Path | None) -> Path:
    if out is None:
        raise InputError("--resume: name the folder of the run by --out DIR")
    then = read_recipe(out)
    if then is None:
        raise InputError(f"--out {out}: no run to resume lies there ({RECIPE} is missing); leave --resume out")
    if (changed := difference(then, recipe)) is not None:
        raise InputError(
            f"--out {out}: its run has another recipe: {changed}; give the same recipe (and --minutes, --pairs, "
            "--packed as then), or start from its weights in a new folder (start.model)"
        )
    if not has_checkpoint(out):
        raise InputError(f"--out {out}: its run ended before the first checkpoint; delete the folder and start anew")
    return out


def _differences(old: Any, new: Any, path: str) -> Iterator[tuple[str, Any, Any]]:
    if isinstance(old, dict) and isinstance(new, dict):
        for key in [*old, *(k for k in new if k not in old)]:
            yield from _differences(old.get(key), new.get(key), f"{path}.{key}" if path else key)
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for index, (a, b) in enumerate(zip(old, new, strict=True)):
            yield from _differences(a, b, f"{path}[{index}]")
    elif old != new:
        yield path, old, new


def _shown(value: Any) -> str:
    if isinstance(value, (dict, list)):
        return f"a list of {len(value)}" if isinstance(value, list) else "a section"
    return "nothing" if value is None else str(value)
