from __future__ import annotations

import ast
import math
import random
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

import sitl.autopilot
from sitl.autopilot.arducopter import ArduCopter
from sitl.autopilot.config import ArduCopterConfig
from sitl.autopilot.link import pipe
from sitl.plant.gimbal import GimbalPlant
from sitl.plant.quadrotor import Quadrotor
from tests.sitl.autopilot.rig import ACCEPTED, GUIDED, NAN, Rig

FLOATS = st.floats(width=32, allow_nan=True, allow_infinity=True)
UINT8, UINT16 = st.integers(0, 255), st.integers(0, 65535)
# Every command and message that has a handler, and some that have none.
COMMANDS = [20, 21, 22, 176, 178, 195, 197, 205, 246, 400, 510, 511, 512, 1000, 1001, 2004, 40000]


def alive(rig: Rig) -> bool:
    """It still answers. Noise may have left half a frame: the first tries may fall into it."""
    return any(rig.command(42000, who=rig.station) is not None for _ in range(30))


@settings(max_examples=40, deadline=None)
@given(st.lists(st.binary(max_size=300), max_size=6))
def test_noise_on_a_link(chunks):
    rig = Rig()
    for chunk in chunks:
        rig.companion._end.write(chunk)
        rig.run(0.02)
    assert alive(rig)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 40))
def test_frames_with_errors(seed, flips):
    """Real frames with wrong bits, cut and put together again."""
    rig, rng = Rig(), random.Random(seed)
    end = bytearray()
    for number in COMMANDS:
        message = mavlink.MAVLink_command_long_message(1, 1, number, 0, *(rng.uniform(-5, 5) for _ in range(7)))
        end += message.pack(rig.companion.mav)
    for _ in range(flips):
        end[rng.randrange(len(end))] ^= 1 << rng.randrange(8)
    while end:
        cut = rng.randrange(1, 90)
        rig.companion._end.write(bytes(end[:cut]))
        del end[:cut]
        rig.run(0.02)
    assert alive(rig)


def test_a_parser_that_fails_is_replaced(monkeypatch):
    rig = Rig()

    def fail(self, chunk):
        raise IndexError("stumbled")

    with monkeypatch.context() as patch:
        patch.setattr(mavlink.MAVLink, "parse_char", fail)
        rig.companion._end.write(b"anything")
        rig.autopilot.step(0.02)
    rig.t_s = 0.02
    assert rig.mode(GUIDED) == ACCEPTED


@settings(max_examples=100, deadline=None)
@given(
    st.lists(st.tuples(st.sampled_from(COMMANDS), st.tuples(*[FLOATS] * 7), st.booleans()), max_size=6),
    st.integers(-(2**31), 2**31 - 1),
    UINT8,
)
def test_any_command(commands, place, frame):
    rig = Rig()
    for number, p, as_int in commands:
        before = len(rig.companion.of("COMMAND_ACK"))
        if as_int:
            rig.companion.mav.command_int_send(1, 1, frame, number, 0, 0, *p[:4], place, -1 - place, p[6])
        else:
            rig.companion.mav.command_long_send(1, 1, number, 0, *p)
        rig.run(0.02)
        rebooted = rig.autopilot.state.booting
        assert len(rig.companion.of("COMMAND_ACK")) == before + 1 or rebooted
        if rebooted:
            rig.run(1.3)
    state = rig.autopilot.state
    assert all(math.isfinite(v) for v in (state.gimbal_pitch_rad, state.gimbal_yaw_rad))
    assert all(math.isfinite(v) for v in rig.vehicle.pos_ned_m)


@settings(max_examples=50, deadline=None)
@given(
    st.tuples(*[FLOATS] * 11), UINT8, UINT16, st.tuples(*[FLOATS] * 7), st.integers(0, 2**32 - 1), UINT8,
    st.tuples(*[UINT16] * 8),
)  # fmt: skip
def test_any_message_in_flight(setpoint, frame, mask, gimbal, flags, device, pwm):
    rig = Rig()
    rig.mode(GUIDED)
    rig.arm()
    rig.autopilot._core.flight.land_complete = False  # as after a take-off, without the wait
    mav = rig.companion.mav
    mav.set_position_target_local_ned_send(0, 1, 1, frame, mask, *setpoint)
    mav.gimbal_manager_set_attitude_send(1, 1, flags, device, list(gimbal[:4]), *gimbal[4:])
    mav.gimbal_manager_set_pitchyaw_send(1, 1, flags, 0, *gimbal[:4])
    mav.param_set_send(1, 1, b"WPNAV_SPEED", setpoint[0], 9)
    mav.set_mode_send(1, frame, flags)
    rig.station.mav.rc_channels_override_send(1, 1, *pwm)
    rig.command(511, 33, 20_000)
    rig.command(511, 285, 20_000)
    rig.run(0.4)
    assert all(math.isfinite(v) for v in (*rig.vehicle.pos_ned_m, *rig.vehicle.vel_ned_m_s, rig.vehicle.yaw_rad))
    status = rig.companion.last("GIMBAL_DEVICE_ATTITUDE_STATUS")
    assert all(math.isfinite(v) for v in status.q)
    assert alive(rig)


# --- the same again ----------------------------------------------------------------------------------------------


def flight_bytes(seed: int, step_s: float = 0.02, physics_hz: int = 400, noise: float = 0.2) -> tuple[bytes, Quadrotor]:
    """A short flight with everything in it, as the bytes that came back."""
    config = ArduCopterConfig(position_noise_m=noise, velocity_noise_m_s=noise, physics_hz=physics_hz)
    vehicle = Quadrotor()
    autopilot = ArduCopter(vehicle, GimbalPlant(), config, seed)
    theirs, ours = pipe()
    autopilot.attach(theirs, "companion")
    mav = mavlink.MAVLink(ours, 1, 191)
    out = bytearray()
    steps = round(16.0 / step_s)
    for i in range(steps):
        t_s = i * step_s
        if i == 0:
            for message_id in (30, 32, 285):
                mav.command_long_send(1, 1, 511, 0, message_id, 50_000, 0, 0, 0, 0, 0)
            mav.command_long_send(1, 1, 176, 0, 1, GUIDED, 0, 0, 0, 0, 0)
            mav.command_long_send(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
            mav.command_long_send(1, 1, 22, 0, 0, 0, 0, 0, 0, 0, 5.0)
            mav.gimbal_manager_set_pitchyaw_send(1, 1, 16, 0, -0.5, 0.7, NAN, NAN)
        if t_s > 11.0 and i % round(0.1 / step_s) == 0:
            mav.set_position_target_local_ned_send(0, 1, 1, 8, 1479, 0, 0, 0, 2.0, 0.5, 0, 0, 0, 0, 0, 0.3)
        autopilot.step((i + 1) * step_s)
        out += ours.read_available()
    return bytes(out), vehicle


def test_the_same_input_gives_the_same_bytes():
    first, second = flight_bytes(3)[0], flight_bytes(3)[0]
    assert first == second
    assert len(first) > 20_000
    assert flight_bytes(4)[0] != first  # the noise comes from the seed


def test_noise_and_the_rate_of_the_physics():
    """Noise is in the report only; 200 Hz fly as 400 Hz do."""
    fine, coarse = flight_bytes(0, noise=0.0)[1], flight_bytes(0, physics_hz=200)[1]
    assert flight_bytes(3)[1].pos_ned_m == fine.pos_ned_m
    assert fine.pos_ned_m == pytest.approx(coarse.pos_ned_m, abs=0.05)
    assert fine.vel_ned_m_s == pytest.approx(coarse.vel_ned_m_s, abs=0.03)
    assert fine.yaw_rad == pytest.approx(coarse.yaw_rad, abs=0.02)


def test_a_step_may_be_long_or_short():
    """Bytes that arrive together with a step are acted on at its begin, however long it is."""
    rig = Rig()
    rig.autopilot.step(0.0)
    rig.autopilot.step(0.001)
    rig.autopilot.step(0.001)
    rig.autopilot.step(3.0)
    rig.t_s = 3.0
    assert rig.autopilot.state.t_s == 3.0
    assert rig.mode(GUIDED) == ACCEPTED
    assert len(rig.companion.of("HEARTBEAT")) >= 3


@pytest.mark.parametrize("now_s", [-1.0, NAN, float("inf"), 0.5])
def test_time_that_makes_no_sense(now_s):
    rig = Rig()
    rig.autopilot.step(1.0)
    with pytest.raises(ValueError, match="now_s"):
        rig.autopilot.step(now_s)


def test_no_code_is_shared_with_the_application():
    for path in Path(sitl.autopilot.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                assert name.split(".")[0] not in {"uavfollow", "control", "tracker", "socket", "threading", "time"}
