"""Packing and parsing, judged by an independent pymavlink instance; garbage never raises and costs no good frame."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from uavfollow.mavlink.connection import Connection
from uavfollow.mavlink.heartbeat import camera_heartbeat, controller_heartbeat
from uavfollow.mavlink.packer import MAGIC_V2, Packer, PackError, Parser, frame_size_bytes
from uavfollow.mavlink.pipe import PipeLink


def _attitude(yaw: float = 0.3) -> object:
    return dialect.MAVLink_attitude_message(1000, 0.1, -0.2, yaw, 0.0, 0.0, 0.5)


def _frames(count: int) -> list[bytes]:
    packer = Packer(1, 191)
    return [packer.pack(_attitude(0.01 * index)) for index in range(count)]


def test_frames_are_mavlink_2_with_the_ids_of_the_component() -> None:
    frame = Packer(7, 100).pack(camera_heartbeat(True))
    assert frame[0] == MAGIC_V2 == 0xFD
    assert (frame[5], frame[6]) == (7, 100)
    assert frame_size_bytes(frame) == len(frame)


def test_each_component_counts_for_itself_and_wraps() -> None:
    controller, camera = Packer(1, 191), Packer(1, 100)
    assert [controller.pack(controller_heartbeat())[4] for _ in range(3)] == [0, 1, 2]
    assert camera.pack(camera_heartbeat(True))[4] == 0
    sequences = [controller.pack(controller_heartbeat())[4] for _ in range(256)]
    assert sequences[252:] == [255, 0, 1, 2]


@pytest.mark.parametrize("bad", [0, 256, -1])
def test_ids_out_of_range_are_refused(bad: int) -> None:
    with pytest.raises(ValueError, match="system_id"):
        Packer(bad, 191)
    with pytest.raises(ValueError, match="component_id"):
        Packer(1, bad)


@pytest.mark.parametrize(
    "message",
    [
        dialect.MAVLink_heartbeat_message(300, 8, 0, 0, 4, 3),
        dialect.MAVLink_attitude_message(0, 1e39, 0, 0, 0, 0, 0),
        dialect.MAVLink_attitude_message(0, None, 0, 0, 0, 0, 0),
        dialect.MAVLink_attitude_message(1.5, 0, 0, 0, 0, 0, 0),
    ],
)
def test_a_field_that_does_not_fit_is_a_pack_error_and_takes_no_sequence_number(message: object) -> None:
    packer = Packer(1, 191)
    with pytest.raises(PackError, match=r"HEARTBEAT|ATTITUDE"):
        packer.pack(message)
    assert packer.pack(controller_heartbeat())[4] == 0


def test_an_object_that_is_no_message_is_a_pack_error() -> None:
    with pytest.raises(PackError, match="str"):
        Packer(1, 191).pack("HEARTBEAT")


@settings(derandomize=True, max_examples=60)
@given(st.lists(st.integers(1, 200), min_size=1, max_size=20), st.integers(1, 12))
def test_any_chunking_gives_the_same_messages(cuts: list[int], count: int) -> None:
    data = b"".join(_frames(count))
    parser, messages, at = Parser(), [], 0
    for cut in [*cuts, len(data)]:
        messages += parser.parse(data[at : at + cut])
        at += cut
    assert [message.yaw for message in messages] == pytest.approx([0.01 * index for index in range(count)])
    assert parser.stats.bad_data == 0


@settings(derandomize=True, max_examples=300)
@given(st.lists(st.binary(max_size=400) | st.sampled_from([b"\xfd" * 30, b"\xfe" * 30, b"\xfd\xff\x00" * 9])))
def test_garbage_never_raises(chunks: list[bytes]) -> None:
    parser = Parser()
    for chunk in chunks:
        parser.parse(chunk)
    assert parser.stats.bad_bytes <= sum(map(len, chunks))


@settings(derandomize=True, max_examples=200)
@given(st.binary(max_size=120), st.integers(0, 39))
def test_a_good_frame_after_garbage_and_a_cut_frame_is_found(garbage: bytes, cut: int) -> None:
    cut_frame, *good = _frames(30)
    # A whole frame of an unknown id in the garbage could by chance end at a magic: no checksum can refute that.
    garbage = garbage.replace(b"\xfd", b"\x00").replace(b"\xfe", b"\x00")
    messages = Parser().parse(garbage + cut_frame[:cut] + b"".join(good))
    assert [message.yaw for message in messages] == pytest.approx([0.01 * index for index in range(1, 30)])


def test_a_stray_magic_swallows_no_good_frame() -> None:
    # pymavlink alone loses the frames that the claimed length of 255 covers.
    data = b"\xfd\xff\x00" + b"".join(_frames(10))
    alone = dialect.MAVLink(None)
    alone.robust_parsing = True
    assert sum(item.get_type() == "ATTITUDE" for item in alone.parse_buffer(data)) < 10
    parser = Parser()
    assert len(parser.parse(data)) == 10
    assert parser.stats.messages == 10
    assert parser.stats.bad_bytes == 3


def test_a_false_frame_that_ends_where_the_bytes_end_gives_back_what_it_covered() -> None:
    frame = _frames(1)[0]
    heartbeat_id = 0
    false_header = bytes([0xFE, 6 + len(frame) - 8, 0, 0, 0, heartbeat_id])
    assert [m.get_type() for m in Parser().parse(false_header + frame)] == ["ATTITUDE"]


def test_a_flipped_bit_costs_one_frame_and_is_counted() -> None:
    frames = _frames(3)
    frames[1] = frames[1][:15] + bytes([frames[1][15] ^ 1]) + frames[1][16:]
    parser = Parser()
    assert [message.yaw for message in parser.parse(b"".join(frames))] == pytest.approx([0.0, 0.02])
    assert parser.stats.bad_data >= 1
    assert parser.stats.bad_bytes == len(frames[1])


def test_the_buffer_of_a_stream_that_never_ends_at_a_frame_stays_small() -> None:
    frame = _frames(1)[0]
    parser = Parser()
    parser.parse(frame[:10])
    for _ in range(500):
        parser.parse(frame[10:] + frame[:10])
    assert parser.stats.messages == 500
    assert len(parser._mav.buf) <= len(frame)


def test_nan_fields_arrive_as_they_were_sent() -> None:
    (message,) = Parser().parse(Packer(1, 1).pack(_attitude(math.nan)))
    assert math.isnan(message.yaw)


def test_unknown_ids_are_counted_and_left_out() -> None:
    payload = bytes(4)
    frame = struct.pack("<BBBBBBBHB", 0xFD, len(payload), 0, 0, 0, 1, 1, 60000, 0) + payload + b"\x00\x00"
    parser = Parser()
    assert [m.get_type() for m in parser.parse(frame + _frames(1)[0])] == ["ATTITUDE"]
    assert parser.stats.unknown == 1


def test_decode_takes_exactly_one_frame() -> None:
    frame = _frames(1)[0]
    parser = Parser()
    decoded = parser.decode(frame)
    assert decoded is not None
    assert decoded.get_type() == "ATTITUDE"
    assert parser.decode(frame + b"\x00") is None
    assert parser.decode(frame[:-1]) is None
    assert parser.decode(frame[:-1] + bytes([frame[-1] ^ 1])) is None
    assert parser.decode(b"") is None
    assert parser.stats.bad_data == 4


@settings(derandomize=True, max_examples=200)
@given(st.binary(max_size=300))
def test_decoding_garbage_never_raises(data: bytes) -> None:
    parser = Parser()
    parser.decode(data)
    if len(data) >= 3:
        parser.decode(b"\xfd" + data)


def test_a_connection_sends_each_component_by_its_own_packer_and_taps_both_ways() -> None:
    here, there = PipeLink.pair()
    tapped: list[bytes] = []
    connection = Connection(here, 1, (191, 100), tap=tapped.append)
    autopilot = Connection(there, 1, (1,))
    for component in (191, 100, 191):
        connection.send(component, controller_heartbeat())
    heard = autopilot.receive()
    assert [(m.get_srcSystem(), m.get_srcComponent(), m.get_seq()) for m in heard] == [
        (1, 191, 0),
        (1, 100, 0),
        (1, 191, 1),
    ]
    autopilot.send(1, _attitude())
    assert [m.get_type() for m in connection.receive()] == ["ATTITUDE"]
    assert connection.receive() == []
    assert connection.parser_stats.messages == 1
    assert [frame[6] for frame in tapped] == [191, 100, 191, 1]
    with pytest.raises(ValueError, match=r"component 42 .* 191, 100"):
        connection.send(42, controller_heartbeat())
    connection.close()
    assert not here.is_open


def test_a_recording_that_fails_stops_nothing() -> None:
    def full_disk(frame: bytes) -> None:
        raise OSError(28, "no space left")

    here, there = PipeLink.pair()
    connection = Connection(here, 1, (191,), tap=full_disk)
    connection.send(191, controller_heartbeat())
    assert there.read_available(), "it was sent"
    there.write(Packer(1, 1).pack(controller_heartbeat()) * 2)
    assert len(connection.receive()) == 2, "and both were received"
    assert connection.tap_failures == 3
