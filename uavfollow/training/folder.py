"""The folder of a run: a new one, or one whose run goes on with the very same recipe."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tracker.training.checkpoint import BEST, LAST, RECIPE, has_checkpoint, read_recipe
from tracker.training.curves import CURVE, PICTURE, VALIDATION
from tracker.training.export import BEST_WEIGHTS, VARIANT_PREFIX, WEIGHTS
from tracker.training.recipe import Recipe
from tracker.training.sources.packed import without_places
from uavfollow.errors import InputError
from uavfollow.record.output import numbered_folders

# What a run writes beside its recipe: found without one it is of something else, and would be written over.
TRACES = (CURVE, VALIDATION, PICTURE, LAST, f"{WEIGHTS}.*", f"{BEST_WEIGHTS}.*", f"{VARIANT_PREFIX}*")


def run_folder(recipe: Recipe, out: Path | None, resume: bool) -> Path:
    """The folder to run in, which need not be there yet; nothing is touched.

    Raises InputError: a run or its files lie there unasked, none to resume, another recipe.
    """
    if resume:
        return _to_resume(recipe, out)
    if out is None:
        return next(p for p in numbered_folders(f"train-{recipe.name}") if not (p / RECIPE).exists() and not _traces(p))
    if (out / RECIPE).exists():
        raise InputError(f"--out {out}: a run lies there; add --resume to go on with it, or choose another folder")
    if found := _traces(out):
        raise InputError(f"--out {out}: files of something else lie there ({found}): choose another folder")
    return out


def _traces(folder: Path) -> str:
    """Names of files as a run writes them."""
    return ", ".join(sorted({path.name for pattern in TRACES for path in folder.glob(pattern)}))


def difference(then: Recipe, now: Recipe) -> str | None:
    """The first difference of two recipes as `stages[0].lr was 0.001 and is 0.002`; None when they are the same.

    Where packed crops lie is none: a pack may be moved between one start of a run and the next.
    """
    for path, old, new in _differences(without_places(then), without_places(now), ""):
        return f"{path} was {_shown(old)} and is {_shown(new)}"
    return None


def _to_resume(recipe: Recipe, out: Path | None) -> Path:
    if out is None:
        raise InputError("--resume: name the folder of the run by --out DIR")
    then = read_recipe(out)
    if then is None and (found := _traces(out)):
        raise InputError(f"--out {out}: {RECIPE} is missing beside {found}: put it back, or choose another folder")
    if then is None:
        raise InputError(f"--out {out}: no run to resume lies there ({RECIPE} is missing); leave --resume out")
    if (changed := difference(then, recipe)) is not None:
        raise InputError(
            f"--out {out}: its run has another recipe: {changed}; give the same recipe (and --minutes, --pairs, "
            "--packed as then), or start from its weights in a new folder (start.model)"
        )
    if not has_checkpoint(out) and (out / BEST).exists():
        raise InputError(
            f"--out {out}: {LAST} is missing; go on from the best validation (mv {out / BEST} {out / LAST}), or choose "
            "another folder"
        )
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
