"""One run in one folder: a lock of the file system, which ends with the process however it ends."""

from __future__ import annotations

import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from uavfollow.errors import InputError

LOCK = ".lock"  # stays: deleting it would let a third process lock another file of the same name
HELD = (errno.EACCES, errno.EAGAIN)


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """The folder is this process's inside; it is made if need be, and gone again if nothing was written.

    Raises InputError when another run is writing there, or nothing can be written. Where the file system knows no
    locks (some network disks) nothing is locked.
    """
    made = [p for p in (folder, *folder.parents) if not p.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        _remove(made)
        raise InputError(
            f"--out {folder}: cannot be written ({error.strerror or error}); choose a folder that you may write to"
        ) from error
    try:
        _take(lock, folder)
        try:
            yield
        finally:
            if made and [p.name for p in folder.iterdir()] == [LOCK]:
                (folder / LOCK).unlink()
                _remove(made)
            with suppress(OSError):  # there are none
                fcntl.flock(lock, fcntl.LOCK_UN)  # the processes that make batches have the file open as well
    finally:
        os.close(lock)


def _take(lock: int, folder: Path) -> None:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in HELD:
            raise InputError(
                f"--out {folder}: another run is writing there; wait for it or choose another folder"
            ) from error
        return
    # The other run may have ended without a trace between our open and our lock, and have taken the folder with it.
    if os.fstat(lock).st_nlink == 0:
        raise InputError(f"--out {folder}: another run has just ended there; start again")


def _remove(folders: list[Path]) -> None:
    for folder in folders:  # innermost first
        try:
            folder.rmdir()
        except OSError:
            return  # not ours alone any more, or never made
