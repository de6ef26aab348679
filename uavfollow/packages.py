"""Are `tracker` and `control` ours? Other distributions install packages of these names (python-control does)."""

from __future__ import annotations

import importlib.util
from importlib import metadata
from pathlib import Path

from uavfollow.errors import InputError

OURS = ("tracker", "control")
MARKER = "UAVFOLLOW"  # a file, so that nothing of a foreign package has to be run to find out


def check_packages(names: tuple[str, ...] = OURS) -> None:
    """Raise InputError, naming the foreign distribution, when a package of ours is shadowed or missing."""
    for name in names:
        spec = importlib.util.find_spec(name)
        places = [Path(p) for p in (spec.submodule_search_locations or [])] if spec else []
        if not spec:
            raise InputError(f"package `{name}` of uavfollow is missing; reinstall it (README)")
        if any((place / MARKER).is_file() for place in places):
            continue
        where = places[0] if places else Path(spec.origin or "?")
        raise InputError(
            f"package `{name}` at {where} belongs to {_owner(name, where)}, not to uavfollow; "
            "install uavfollow into a virtual environment of its own"
        )


def _owner(name: str, where: Path) -> str:
    """Distributions that own files below `where`."""
    found = []
    for owner in metadata.packages_distributions().get(name, []):
        try:
            files = metadata.files(owner) or []
        except metadata.PackageNotFoundError:
            continue
        if any(Path(str(f.locate())).resolve().is_relative_to(where.resolve()) for f in files):
            found.append(f"the distribution '{owner}' {metadata.version(owner)}")
    return " and ".join(found) or "something else"
