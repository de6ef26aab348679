"""Reads the recorded flight and plays its companion's side into the simulated autopilot."""

from __future__ import annotations

import functools
import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.arducopter import ArduCopter
from sitl.autopilot.config import ArduCopterConfig
from sitl.autopilot.link import pipe
from sitl.plant.gimbal import GimbalPlant
from sitl.plant.quadrotor import Quadrotor

LOG = Path(__file__).parents[2] / "data" / "arducopter-guided.tlog"
COMPANION = 191
# time_boot_ms of the recording counts from this long before its first message.
BOOT_BEFORE_S = 1.222
# "EKF3 IMU0 is using GPS" came 40.39 s after the first message.
READY_AFTER_S = 40.39 + BOOT_BEFORE_S
# The recorded heading just before the first velocity step; the simulated compass does not drift.
YAW_RAD = -0.0035


@dataclass(frozen=True, slots=True)
class Record:
    t_s: float
    frame: bytes
    message: Any

    @property
    def kind(self) -> str:
        return str(self.message.get_type())


class Log(list[Record]):
    """Records in the order of time, found by kind without a search."""

    def of(self, kind: str) -> list[Record]:
        if not hasattr(self, "_by_kind"):
            self._by_kind: dict[str, list[Record]] = {}
            for record in self:
                self._by_kind.setdefault(record.kind, []).append(record)
        return self._by_kind.get(kind, [])


@functools.cache
def recording() -> tuple[Record, ...]:
    """The whole log; time zero is its first message."""
    data, at, out = LOG.read_bytes(), 0, []
    decoder = mavlink.MAVLink(None)
    start_us = struct.unpack_from(">Q", data)[0]
    while at < len(data):
        (t_us,) = struct.unpack_from(">Q", data, at)
        length = data[at + 9] + 12
        frame = data[at + 8 : at + 8 + length]
        out.append(Record((t_us - start_us) * 1e-6, frame, decoder.decode(bytearray(frame))))
        at += 8 + length
    return tuple(out)


def companion_side() -> Log:
    return Log(r for r in recording() if r.message.get_srcComponent() == COMPANION)


def autopilot_side() -> Log:
    return Log(r for r in recording() if r.message.get_srcComponent() == 1)


def new_autopilot(**parameters: float) -> ArduCopter:
    config = ArduCopterConfig(booted_at_s=-BOOT_BEFORE_S, ready_after_s=READY_AFTER_S, parameters=parameters)
    return ArduCopter(Quadrotor(yaw_rad=YAW_RAD), GimbalPlant(), config)


def play(
    autopilot: ArduCopter,
    records: Iterable[Record],
    end_s: float,
    at: Callable[[float], None] = lambda t_s: None,
) -> Log:
    """Feed `records` at their times and return what the autopilot says, each with the time at which it was read."""
    theirs, ours = pipe()
    autopilot.attach(theirs, "companion")
    decoder = mavlink.MAVLink(None)
    out = Log()

    def advance(t_s: float) -> None:
        autopilot.step(t_s)
        for message in decoder.parse_buffer(ours.read_available()) or []:
            out.append(Record(t_s, bytes(message.get_msgbuf()), message))
        at(t_s)

    step_s, t_s = 0.01, 0.0
    for record in records:
        while t_s + step_s < record.t_s:
            t_s += step_s
            advance(t_s)
        t_s = record.t_s
        advance(t_s)
        ours.write(record.frame)
    while t_s < end_s:
        t_s += step_s
        advance(t_s)
    return out
