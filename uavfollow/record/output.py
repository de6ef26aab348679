"""An output folder that is filled whole or left as it was."""

from __future__ import annotations

import itertools
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from uavfollow.errors import InputError

# What a tracking run may write. One that another run left and this one does not make would tell of that other run.
RUN_FILES = (
    "track.csv", "commands.csv", "overlay.mp4", "setpoints.tlog", "report.html", "summary.json", "snapshots.jpg",
    "centre_error.png", "commands.png",
)  # fmt: skip


def free_folder(name: str, marker: str) -> Path:
    """runs/NAME, numbered when a run lies there already (its file `marker` does): none is written over unasked."""
    return next(p for p in numbered_folders(name) if not (p / marker).exists())


def numbered_folders(name: str) -> Iterator[Path]:
    """runs/NAME, runs/NAME-2 and so on, without end."""
    first = Path("runs") / name
    return itertools.chain([first], (first.with_name(f"{first.name}-{n}") for n in itertools.count(2)))


class OutputFolder:
    """Files are made in a hidden folder inside `target`; `commit` moves them into place, `abort` leaves no trace."""

    def __init__(self, target: Path) -> None:
        self.target = target
        self._made = [p for p in (target, *target.parents) if not p.exists()]
        try:
            target.mkdir(parents=True, exist_ok=True)
            self.work = Path(tempfile.mkdtemp(prefix=".partial-", dir=target))
        except OSError as error:
            self._remove_made()
            raise InputError(
                f"--out {target}: cannot be written ({error.strerror or error}); choose a folder that you may write to"
            ) from error

    def path(self, name: str) -> Path:
        """Where to write a file of this name until `commit`. Raises InputError when a folder stands in its place."""
        if (self.target / name).is_dir():
            raise InputError(f"--out {self.target}: {name} is a folder there; remove it or choose another --out")
        return self.work / name

    def commit(self, replaces: Iterable[str] = ()) -> list[Path]:
        """Move every file into place, replacing those of the same name; returns the final paths.

        Files named in `replaces` that were not made this time are deleted.
        """
        made = sorted(self.work.iterdir())
        for name in replaces:
            if not (self.work / name).exists() and (self.target / name).is_file():
                (self.target / name).unlink()
        final = []
        for path in made:
            destination = self.target / path.name
            path.replace(destination)
            final.append(destination)
        self.work.rmdir()
        return final

    def abort(self) -> None:
        """Delete what was made, and the folders that this object created."""
        shutil.rmtree(self.work, ignore_errors=True)
        self._remove_made()

    def _remove_made(self) -> None:
        for folder in self._made:  # innermost first
            try:
                folder.rmdir()
            except OSError:
                return  # not ours alone any more, or never made
