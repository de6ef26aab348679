"""An output folder that is filled whole or left as it was."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from uavfollow.errors import InputError


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
        """Where to write a file of this name until `commit`."""
        return self.work / name

    def commit(self) -> list[Path]:
        """Move every file into place, replacing those of the same name; returns the final paths."""
        final = []
        for path in sorted(self.work.iterdir()):
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
