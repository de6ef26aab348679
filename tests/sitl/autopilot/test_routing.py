from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.link import pipe
from tests.sitl.autopilot.rig import ACCEPTED, GUIDED, STABILIZE, UNSUPPORTED, Rig, Station


@pytest.fixture
def rig() -> Rig:
    return Rig()


def beat(who: Station, kind: int = 18) -> None:
    who.mav.heartbeat_send(kind, 8, 0, 0, 4)


def from_(who: Station, source: tuple[int, int], kind: str) -> list:
    return [m for m in who.of(kind) if (m.get_srcSystem(), m.get_srcComponent()) == source]


def test_heartbeats_go_to_every_other_link(rig):
    camera = rig.attach("camera", 1, 100)
    beat(rig.companion)
    beat(camera, 30)
    rig.run(0.1)
    assert len(from_(rig.station, (1, 191), "HEARTBEAT")) == 1
    assert len(from_(rig.station, (1, 100), "HEARTBEAT")) == 1
    assert len(from_(rig.companion, (1, 100), "HEARTBEAT")) == 1
    assert from_(rig.companion, (1, 191), "HEARTBEAT") == []


def test_forwarded_frames_are_unchanged(rig):
    beat(rig.station, 6)
    rig.run(0.04)
    message = mavlink.MAVLink_statustext_message(6, b"hello from 191")
    frame = message.pack(rig.companion.mav)
    rig.companion.mav.send(message)
    rig.run(0.1)
    forwarded = from_(rig.station, (1, 191), "STATUSTEXT")
    assert [bytes(m.get_msgbuf()) for m in forwarded] == [frame]


def test_a_command_reaches_the_component_that_it_is_addressed_to(rig):
    camera = rig.attach("camera", 1, 100)
    # Before the camera was heard the autopilot answers itself.
    assert rig.command(2004, 0.5, 0.5, who=rig.station, to=(1, 100)) == UNSUPPORTED
    assert camera.of("COMMAND_LONG") == []
    beat(camera, 30)
    rig.run(0.1)
    assert rig.command(2004, 0.5, 0.5, who=rig.station, to=(1, 100)) is None
    assert camera.last("COMMAND_LONG").command == 2004
    camera.mav.command_ack_send(2004, 0, 0, 0, 255, 190)
    rig.run(0.1)
    assert [(m.get_srcComponent(), m.result) for m in rig.station.of("COMMAND_ACK")] == [(1, 3), (100, 0)]
    assert rig.companion.of("COMMAND_ACK") == []


def test_a_command_to_everybody_is_answered_by_both(rig):
    camera = rig.attach("camera", 1, 100)
    beat(camera, 30)
    rig.run(0.1)
    assert rig.command(2004, 0.5, 0.5, who=rig.station, to=(1, 0)) == UNSUPPORTED
    assert camera.last("COMMAND_LONG").command == 2004


def test_an_unknown_component_is_answered_by_the_autopilot(rig):
    assert rig.command(2004, 0.5, 0.5, who=rig.station, to=(1, 155)) == UNSUPPORTED
    assert rig.station.last("COMMAND_ACK").get_srcComponent() == 1


def test_another_system_is_not_ours(rig):
    assert rig.command(176, 1, GUIDED, to=(2, 1)) is None
    assert rig.autopilot.state.mode == STABILIZE
    beat(rig.station, 6)
    rig.run(0.04)
    rig.command(42000, 1, 2, to=(255, 190))
    assert rig.station.last("COMMAND_LONG").command == 42000
    assert rig.companion.of("COMMAND_ACK") == []


def test_broadcast_messages_go_everywhere_but_back(rig):
    beat(rig.station, 6)
    rig.run(0.04)
    rig.companion.mav.camera_tracking_image_status_send(1, 2, 4, 0, 0, 0, 0.1, 0.1, 0.2, 0.2)
    rig.run(0.1)
    assert len(rig.station.of("CAMERA_TRACKING_IMAGE_STATUS")) == 1
    assert rig.companion.of("CAMERA_TRACKING_IMAGE_STATUS") == []


def test_links_count_their_own_messages(rig):
    rig.command(511, 30, 20_000)
    rig.run(2.0)
    for station, most in ((rig.companion, 200), (rig.station, 10)):
        own = [m.get_seq() for _, m in station.heard if m.get_srcComponent() == 1]
        assert 2 <= len(own) <= most
        assert own == [i % 256 for i in range(len(own))]


def test_two_components_on_one_link(rig):
    theirs, ours = pipe()
    rig.autopilot.attach(theirs, "both")
    first, second = Station(ours, 1, 192), Station(ours, 1, 101)
    rig.stations.append(first)
    beat(first)
    beat(second, 30)
    rig.run(0.1)
    assert len(from_(rig.station, (1, 192), "HEARTBEAT")) == 1
    assert rig.command(176, 1, GUIDED, who=first) == ACCEPTED
    assert rig.command(2004, 0.5, 0.5, who=rig.station, to=(1, 101)) is None
    assert first.last("COMMAND_LONG").command == 2004


def test_a_loop_of_links_carries_no_heartbeat_for_ever(rig):
    """The same component on two links: its heartbeat goes to neither of them."""
    copy = rig.attach("copy", 1, 191)
    beat(rig.companion)
    beat(copy)
    rig.run(0.1)
    rig.companion.heard.clear()
    copy.heard.clear()
    beat(rig.companion)
    rig.run(0.1)
    assert from_(copy, (1, 191), "HEARTBEAT") == []
    assert len(from_(rig.station, (1, 191), "HEARTBEAT")) == 3


def test_a_flood_of_senders_does_not_grow_the_table(rig):
    for compid in range(2, 250):
        rig.companion.mav.srcComponent = compid
        beat(rig.companion)
    rig.run(0.1)
    rig.companion.mav.srcComponent = 191
    assert rig.mode(GUIDED) == ACCEPTED
    assert len(rig.autopilot._hardware.routes._routes) <= 20


def test_a_link_name_is_used_once(rig):
    with pytest.raises(ValueError, match="companion"):
        rig.attach("companion", 1, 192)
