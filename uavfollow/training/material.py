"""The data of a recipe, opened: pairs come from the mix, sequences to validate on beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from tracker.training.recipe import Folders, Recipe
from tracker.training.sources import open_footage, open_mix, reserved_names
from tracker.training.sources.mix import Mix
from tracker.training.types import Footage
from uavfollow.errors import InputError
from uavfollow.tell import tell


def injected() -> Mapping[str, Callable[[Any], Any]]:
    """Sources that the training package does not know: it must not import the simulator."""
    from uavfollow.sim.pictures import SimulatorPictures  # draws; only recipes that name it need it

    return {"simulator": SimulatorPictures}


def open_sources(recipe: Recipe, root: Path) -> Mix:
    """All sources, without the sequences of the validation. Raises TrainingError."""
    return open_mix(recipe.sources, root, injected(), reserved_names(recipe.validation, root))


def open_validation(recipe: Recipe, root: Path) -> list[Footage]:
    """The sequences of the recipe's validation, in its order. Raises TrainingError."""
    return [item for spec in recipe.validation.sources for item in open_footage(spec, root, injected())]


def footage_of_folders(folders: Iterable[Path]) -> list[Footage]:
    """Sequences: folders with pictures and truth, or folders of such folders. Raises InputError, TrainingError."""
    found: list[Footage] = []
    for folder in folders:
        if not folder.is_dir():
            raise InputError(f"{folder}: no such folder; a sequence is a folder with img/ and groundtruth_rect.txt")
        place = folder.resolve()
        if not _is_sequence(place):
            found += open_footage(Folders(kind="folders", path=str(place)), place, injected())
            continue
        found += open_footage(
            Folders(kind="folders", path=str(place.parent), only=(place.name,)), place.parent, injected()
        )
    return found


def _is_sequence(folder: Path) -> bool:
    return (folder / "img").is_dir() or any(folder.glob("groundtruth*.txt"))


def tell_sources(mix: Mix) -> None:
    """One line per source on standard error: targets, share, what could not be used."""
    for source, share in zip(mix.sources, mix.shares, strict=True):
        frames = sum(len(track.frames) for track in source.tracks)
        tell(f"{source.name}: {len(source.tracks)} targets in {frames} views, {share:.1%} of the pairs")
        for line in source.skipped.lines():
            tell(f"  left out: {line}")
