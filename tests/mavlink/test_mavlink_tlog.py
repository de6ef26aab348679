"""Recordings: round trip, other programs' reader, damage, and the two real flights."""

from __future__ import annotations

import struct
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect

from uavfollow.mavlink.heartbeat import controller_heartbeat
from uavfollow.mavlink.packer import Packer, Parser
from uavfollow.mavlink.tlog import TlogError, TlogReader, TlogTruncatedError, TlogWriter

START_US = 1_700_000_000_000_000
DATA = Path(__file__).parents[1] / "data"
FLIGHTS = Path(__file__).parents[2] / ".." / "shared" / "flights"


def _frames(count: int) -> list[bytes]:
    packer = Packer(1, 191)
    return [packer.pack(dialect.MAVLink_attitude_message(i, 0.1, 0.2, 0.3, 0.0, 0.0, 0.5)) for i in range(count)]


def _write(path: Path, count: int) -> list[bytes]:
    frames = _frames(count)
    with TlogWriter(path) as writer:
        for index, frame in enumerate(frames):
            writer.write(START_US + 1000 * index, frame)
    return frames


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.tlog"
    frames = _write(path, 5)
    reader = TlogReader(path)
    assert [record.frame for record in reader] == frames
    assert [record.t_us for record in reader] == [START_US + 1000 * index for index in range(5)]
    assert [(t_us, m.time_boot_ms) for t_us, m in reader.messages()] == [(START_US + 1000 * i, i) for i in range(5)]
    assert reader.undecoded == 0
    assert reader.problem == ""
    assert path.read_bytes()[:8] == struct.pack(">Q", START_US)


def test_pymavlink_reads_what_is_written(tmp_path: Path) -> None:
    path = tmp_path / "a.tlog"
    with TlogWriter(path) as writer:
        for index, frame in enumerate(_frames(20)):
            writer.write(START_US + 50_001 * index, frame, link=index % 4)
    log = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    read = []
    while (message := log.recv_match()) is not None:
        read.append(message)
    log.close()
    assert [message.get_type() for message in read] == ["ATTITUDE"] * 20
    assert [message.time_boot_ms for message in read] == list(range(20))
    assert [message._link for message in read] == [index % 4 for index in range(20)]
    expected_s = [(START_US + 50_001 * index) * 1e-6 for index in range(20)]
    assert [message._timestamp for message in read] == pytest.approx(expected_s, abs=4e-6)


@settings(derandomize=True, max_examples=50)
@given(st.integers(0, 2**63 - 1), st.integers(0, 3))
def test_time_and_link_share_the_stamp(tmp_path_factory: pytest.TempPathFactory, t_us: int, link: int) -> None:
    path = tmp_path_factory.mktemp("stamp") / "a.tlog"
    with TlogWriter(path) as writer:
        writer.write(t_us, _frames(1)[0], link)
    (record,) = TlogReader(path)
    assert record.link == link
    assert 0 <= t_us - record.t_us < 4


def test_the_final_name_appears_only_at_close(tmp_path: Path) -> None:
    path = tmp_path / "a.tlog"
    writer = TlogWriter(path)
    writer.write(START_US, _frames(1)[0])
    assert not path.exists()
    assert [p.name for p in tmp_path.iterdir()] == ["a.tlog.partial"]
    writer.close()
    writer.close()
    writer.abort()
    assert [p.name for p in tmp_path.iterdir()] == ["a.tlog"]
    with pytest.raises(TlogError, match="is closed"):
        writer.write(START_US, _frames(1)[0])


def test_abort_leaves_nothing_and_an_exception_keeps_the_recording(tmp_path: Path) -> None:
    aborted = TlogWriter(tmp_path / "a.tlog")
    aborted.write(START_US, _frames(1)[0])
    aborted.abort()
    assert list(tmp_path.iterdir()) == []

    def fly() -> None:
        with TlogWriter(tmp_path / "b.tlog") as writer:
            writer.write(START_US, _frames(1)[0])
            raise RuntimeError("in flight")

    with pytest.raises(RuntimeError, match="in flight"):
        fly()
    assert len(list(TlogReader(tmp_path / "b.tlog"))) == 1


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "a.tlog"
    _write(path, 2)
    with pytest.raises(TlogError, match="exists already"):
        TlogWriter(path)
    left_behind = tmp_path / "b.tlog.partial"
    left_behind.write_bytes(b"evidence")
    _write(tmp_path / "b.tlog", 3)
    assert left_behind.read_bytes() == b"evidence"
    assert len(list(TlogReader(tmp_path / "b.tlog"))) == 3
    with pytest.raises(TlogError, match="check the folder"):
        TlogWriter(tmp_path / "no" / "folder.tlog")


@pytest.mark.parametrize("bad", ["short", "long", "two", "empty", "foreign"])
def test_only_whole_single_frames_are_recorded(tmp_path: Path, bad: str) -> None:
    frame = _frames(1)[0]
    data = {"short": frame[:-1], "long": frame + b"\x00", "two": frame * 2, "empty": b"", "foreign": b"hello"}[bad]
    with TlogWriter(tmp_path / "a.tlog") as writer, pytest.raises(TlogError, match="not one whole MAVLink frame"):
        writer.write(START_US, data)
    assert list(TlogReader(tmp_path / "a.tlog")) == []


@pytest.mark.parametrize(("t_us", "link"), [(-1, 0), (2**63, 0), (0, 4), (0, -1)])
def test_stamps_out_of_range_are_refused(tmp_path: Path, t_us: int, link: int) -> None:
    with TlogWriter(tmp_path / "a.tlog") as writer, pytest.raises(TlogError, match="out of range"):
        writer.write(t_us, _frames(1)[0], link)


def test_every_cut_gives_the_whole_records_and_then_says_so(tmp_path: Path) -> None:
    path = tmp_path / "a.tlog"
    frames = _write(path, 2)
    data = path.read_bytes()
    first_size = 8 + len(frames[0])
    for size in range(first_size + 1, len(data)):
        path.write_bytes(data[:size])
        records = iter(TlogReader(path))
        assert next(records).frame == frames[0]
        with pytest.raises(TlogTruncatedError, match=f"inside record 1 at byte {first_size}"):
            next(records)
        lenient = TlogReader(path, allow_truncated=True)
        assert [record.frame for record in lenient] == frames[:1]
        assert "ends inside record 1" in lenient.problem


def test_a_foreign_or_damaged_file_is_named_with_the_place(tmp_path: Path) -> None:
    foreign = tmp_path / "foreign.tlog"
    foreign.write_bytes(b"this is a text file, not a recording of a flight")
    with pytest.raises(TlogError, match=r"record 0 at byte 0 holds no MAVLink frame.*not a tlog") as caught:
        list(TlogReader(foreign, allow_truncated=True))
    assert not isinstance(caught.value, TlogTruncatedError)
    damaged = tmp_path / "damaged.tlog"
    frames = _write(damaged, 2)
    data = bytearray(damaged.read_bytes())
    data[8 + len(frames[0]) + 8] = 0x00
    damaged.write_bytes(data)
    with pytest.raises(TlogError, match=f"record 1 at byte {8 + len(frames[0])} "):
        list(TlogReader(damaged))
    with pytest.raises(TlogError, match="is not a file"):
        TlogReader(tmp_path / "absent.tlog")


def test_a_frame_with_a_bad_checksum_is_counted_not_given(tmp_path: Path) -> None:
    path = tmp_path / "a.tlog"
    good = Packer(1, 191).pack(controller_heartbeat())
    with TlogWriter(path) as writer:
        writer.write(START_US, good[:-1] + bytes([good[-1] ^ 1]))
        writer.write(START_US, good)
    reader = TlogReader(path)
    assert len(list(reader.messages())) == 1
    assert reader.undecoded == 1


@settings(derandomize=True, max_examples=100)
@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused_with_the_one_error(
    tmp_path_factory: pytest.TempPathFactory, data: bytes
) -> None:
    path = tmp_path_factory.mktemp("fuzz") / "a.tlog"
    path.write_bytes(data)
    try:
        records = list(TlogReader(path))
    except TlogError:
        return
    assert sum(8 + len(record.frame) for record in records) == len(data)


def _flight(name: str) -> Path:
    path = next((p for p in (DATA / name, FLIGHTS / name) if p.is_file()), FLIGHTS / name)
    if not path.is_file():
        pytest.skip(f"the recorded flight {name} is not in {FLIGHTS.resolve()}")
    return path


# Counts by pymavlink's own reader, with unknown ids apart.
FLIGHT_COUNTS = {
    "arducopter-guided.tlog": {
        "ATTITUDE": 8330,
        "SET_POSITION_TARGET_LOCAL_NED": 1232,
        "GIMBAL_MANAGER_SET_ATTITUDE": 200,
        "HEARTBEAT": 339,
        "COMMAND_ACK": 21,
        "STATUSTEXT": 23,
    },
    "px4-offboard.tlog": {
        "ATTITUDE": 7056,
        "SET_POSITION_TARGET_LOCAL_NED": 1694,
        "GIMBAL_MANAGER_SET_ATTITUDE": 212,
        "HEARTBEAT": 281,
        "COMMAND_ACK": 23,
        "ODOMETRY": 4217,
    },
}


@pytest.mark.parametrize(
    ("name", "total", "unknown"), [("arducopter-guided.tlog", 29602, 0), ("px4-offboard.tlog", 50400, 380)]
)
def test_a_recorded_flight_is_read_whole(name: str, total: int, unknown: int) -> None:
    reader = TlogReader(_flight(name))
    counts: Counter[str] = Counter()
    setpoints, last_us = Counter(), 0
    for t_us, message in reader.messages():
        counts[message.get_type()] += 1
        if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
            setpoints[(message.type_mask, message.coordinate_frame, message.get_srcComponent())] += 1
        last_us = max(last_us, t_us)
    assert reader.undecoded == unknown
    assert counts.total() + unknown == total
    assert {kind: counts[kind] for kind in FLIGHT_COUNTS[name]} == FLIGHT_COUNTS[name]
    # Documented: frame 1 throughout, a stretch in frame 8; always mask 1479, always from the companion.
    assert set(setpoints) == {(1479, 1, 191), (1479, 8, 191)}


def test_a_recorded_flight_as_a_byte_stream_loses_nothing() -> None:
    frames = [record.frame for record in TlogReader(_flight("arducopter-guided.tlog"))]
    stream, parser, count = b"".join(frames), Parser(), 0
    for at in range(0, len(stream), 1000):
        count += len(parser.parse(stream[at : at + 1000]))
    assert count == len(frames)
    assert parser.stats.bad_data == 0
