"""Recordings in tlog form: 8 bytes of big-endian unix microseconds, then one MAVLink frame, again and again.

The low two bits of the time are the number of the link, as MAVProxy writes and pymavlink's `mavlogfile` reads it.
"""

from __future__ import annotations

import contextlib
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

from uavfollow.errors import InputError
from uavfollow.mavlink.packer import MAGIC_V1, MAGIC_V2, Message, Parser, frame_size_bytes

STAMP = struct.Struct(">Q")
LINK_MASK = 0x3  # low bits of the time stamp
MAX_STAMP_US = 2**63 - 1  # readers of other programs take it as signed
MAX_PARTIAL_FILES = 100  # that many recordings cut short in one folder call for a clean-up
_HEADER_BYTES = 3  # magic, payload length, incompatibility flags: what tells the length of a frame


class TlogError(InputError):
    """A tlog that can't be written or read; one line: what, where, what to do."""


class TlogTruncatedError(TlogError):
    """A tlog whose last record is cut short; everything before it is whole."""


@dataclass(frozen=True, slots=True)
class TlogRecord:
    """One frame and when it passed: unix microseconds (multiples of 4) and the number of its link, 0..3."""

    t_us: int
    link: int
    frame: bytes


class TlogWriter:
    """Writes `path` by way of `path.partial`, renamed at `close`, so that a file of the final name is whole.

    A context that ends in an exception still keeps the recording: a flight that went wrong is the one wanted; `abort`
    deletes it. Refuses to overwrite. Raises `TlogError`.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        if self.path.exists():
            raise TlogError(f"{self.path} exists already; choose another name, a recording is never overwritten")
        self._partial, self._file = _open_partial(self.path)

    def write(self, t_us: int, frame: bytes, link: int = 0) -> None:
        """Append one whole MAVLink frame at unix microseconds `t_us` (its low two bits give way to `link`, 0..3)."""
        if self._file.closed:
            raise TlogError(f"{self.path} is closed; open a new recording")
        if not 0 <= t_us <= MAX_STAMP_US or not 0 <= link <= LINK_MASK:
            raise TlogError(f"{self.path}: time {t_us} us or link {link} is out of range (0..2**63-1, 0..3)")
        if frame_size_bytes(frame) != len(frame):
            raise TlogError(f"{self.path}: {len(frame)} bytes are not one whole MAVLink frame; write frame by frame")
        try:
            self._file.write(STAMP.pack((t_us & ~LINK_MASK) | link) + frame)
        except OSError as error:
            raise TlogError(f"{self._partial}: {error.strerror}; free some space or choose another disk") from error

    def close(self) -> None:
        """Bring the recording to the disk under its final name; a second call does nothing."""
        if self._file.closed:
            return
        try:
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()
            self._partial.replace(self.path)
        except OSError as error:
            raise TlogError(f"{self.path}: {error.strerror}; the recording so far is in {self._partial}") from error

    def abort(self) -> None:
        """Delete the recording instead of keeping it; does nothing after `close`."""
        if not self._file.closed:
            with contextlib.suppress(OSError):  # a full disk refuses the rest, which is not wanted
                self._file.close()
            self._partial.unlink(missing_ok=True)

    def __enter__(self) -> TlogWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: object, trace: TracebackType | None) -> None:
        self.close()


def _open_partial(path: Path) -> tuple[Path, BinaryIO]:
    # The partial file of a run that was killed is evidence: it is left alone and another name taken.
    for number in range(MAX_PARTIAL_FILES):
        partial = path.with_name(f"{path.name}.partial{number or ''}")
        try:
            return partial, partial.open("xb")
        except FileExistsError:
            continue
        except OSError as error:
            raise TlogError(f"can't write {partial}: {error.strerror}; check the folder and its rights") from error
    raise TlogError(f"{path} has {MAX_PARTIAL_FILES} .partial files beside it; look at them and delete them")


class TlogReader:
    """Iterates over the records of a tlog.

    A last record cut short raises `TlogTruncatedError` after all whole records were given; with `allow_truncated` the
    iteration just ends and `problem` says so. Anything else that is no tlog raises `TlogError` with the place.
    """

    def __init__(self, path: Path | str, allow_truncated: bool = False) -> None:
        self.path = Path(path)
        self.problem = ""
        self.undecoded = 0
        self._allow_truncated = allow_truncated
        if not self.path.is_file():
            raise TlogError(f"{self.path} is not a file; check the name")

    def __iter__(self) -> Iterator[TlogRecord]:
        try:
            with self.path.open("rb") as file:
                yield from self._records(file)
        except OSError as error:
            raise TlogError(f"can't read {self.path}: {error.strerror}") from error

    def messages(self) -> Iterator[tuple[int, Message]]:
        """Unix microseconds and decoded message of each record; frames that can't be decoded count in `undecoded`."""
        parser = Parser()
        for record in self:
            message = parser.decode(record.frame)
            if message is None:
                self.undecoded += 1
            else:
                yield record.t_us, message

    def _records(self, file: BinaryIO) -> Iterator[TlogRecord]:
        offset = count = 0
        while True:
            head = file.read(STAMP.size + _HEADER_BYTES)
            if not head:
                return
            size = frame_size_bytes(head[STAMP.size :])
            if len(head) > STAMP.size and head[STAMP.size] not in (MAGIC_V1, MAGIC_V2):
                raise TlogError(
                    f"{self.path}: record {count} at byte {offset} holds no MAVLink frame (byte "
                    f"0x{head[STAMP.size]:02x} instead of 0xfd or 0xfe); this is not a tlog, or it is damaged there"
                )
            rest = file.read(size - _HEADER_BYTES) if size else b""
            frame = head[STAMP.size :] + rest
            if not size or len(frame) < size:
                self._truncated(count, offset)
                return
            (stamp,) = STAMP.unpack_from(head)
            yield TlogRecord(stamp & ~LINK_MASK, stamp & LINK_MASK, frame)
            offset += STAMP.size + size
            count += 1

    def _truncated(self, count: int, offset: int) -> None:
        self.problem = f"{self.path} ends inside record {count} at byte {offset}; the {count} before it are whole"
        if not self._allow_truncated:
            raise TlogTruncatedError(self.problem)
