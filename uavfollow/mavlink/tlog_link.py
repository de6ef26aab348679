"""A link that only writes: every frame goes into a tlog."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from uavfollow.mavlink.tlog import TlogError, TlogWriter
from uavfollow.mavlink.transport import Counters, LinkError, LinkStats


def unix_time_us() -> int:
    """Unix time in microseconds, as tlogs carry it."""
    return time.time_ns() // 1000


class TlogLink:
    """Writes frames to the tlog `path`, stamped by `unix_us`; reads nothing.

    Raises `LinkError` when the file can't be begun, and at `close` when it can't be completed.
    """

    def __init__(self, path: Path | str, unix_us: Callable[[], int] = unix_time_us) -> None:
        try:
            self._writer = TlogWriter(path)
        except TlogError as error:
            raise LinkError(str(error)) from error
        self._unix_us = unix_us
        self._is_open = True
        self._counters = Counters()

    def write(self, data: bytes) -> None:
        """Append one frame; a full disk or anything but one frame is counted."""
        if not self._is_open:
            self._counters.dropped()
            return
        try:
            self._writer.write(self._unix_us(), data)
        except TlogError as error:
            self._counters.failed(error)
            self._counters.dropped()
        else:
            self._counters.sent(len(data))

    def read_available(self) -> bytes:
        """Always b""."""
        return b""

    def close(self) -> None:
        """Complete the file under its final name."""
        if not self._is_open:
            return
        self._is_open = False
        try:
            self._writer.close()
        except TlogError as error:
            raise LinkError(str(error)) from error

    def fileno(self) -> int | None:
        """None: there is nothing to wait on."""
        return None

    @property
    def is_open(self) -> bool:
        """Whether `close` has not been called."""
        return self._is_open

    @property
    def is_connected(self) -> bool:
        """Whether writes are recorded."""
        return self._is_open

    @property
    def stats(self) -> LinkStats:
        """What has been written."""
        return self._counters.snapshot()
