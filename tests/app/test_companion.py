"""The companion's loop beside the simulated autopilot, over MAVLink bytes: three authorisations, and who wins."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from control.camera import Intrinsics
from control.frames import GIMBAL_FROM_CAMERA, rotation_from_rpy, rpy_from_quaternion
from control.gimbal import GimbalLaw, GimbalLawConfig
from control.guidance.trail import TrailConfig, TrailGuidance
from control.limits import VelocityLimiter, VelocityLimits
from control.messages import CommandReason
from control.supervisor import FlightReason
from sitl.autopilot.arducopter import ArduCopter
from sitl.autopilot.config import ArduCopterConfig
from sitl.autopilot.link import pipe
from sitl.operator import Operator
from sitl.plant.gimbal import GimbalPlant
from sitl.plant.gimbal_params import GimbalParams
from sitl.plant.pose import camera_pose
from sitl.plant.quadrotor import Quadrotor
from sitl.plant.quadrotor_params import QuadrotorParams
from sitl.plant.wind import Wind
from sitl.wire import WireTap
from tracker.box import Box
from tracker.messages import Candidate, TargetStatus
from tracker.target import TargetTracker
from uavfollow.app import App
from uavfollow.companion import Companion, CompanionConfig
from uavfollow.mavlink.connection import Connection
from uavfollow.mavlink.gimbal_grant import GrantState
from uavfollow.mavlink.pipe import PipeLink

CAMERA = Intrinsics.from_hfov(640, 480, math.radians(66))
TICK_S = 0.005
FRAME_TICKS = 10  # 20 pictures a second
TARGET_M = (22.0, 3.0, -0.7)
SIZE_M = 2.0


class Rig:
    """Autopilot, operator and companion on one simulated clock; the target is a ball that is seen without error."""

    def __init__(self, config: CompanionConfig | None = None, height_m: float = 10.0, mount: float = 6.0) -> None:
        self.vehicle = Quadrotor(QuadrotorParams(), Wind((0.0, 0.0, 0.0), 0.0, 2.0, 0))
        self.gimbal = GimbalPlant(GimbalParams())
        self.autopilot = ArduCopter(self.vehicle, self.gimbal, ArduCopterConfig(parameters={"MNT1_TYPE": mount}))
        ours, theirs = PipeLink.pair()
        self.wire = WireTap(theirs)
        self.autopilot.attach(self.wire, "companion")
        ground, ground_end = pipe()
        self.autopilot.attach(ground_end, "ground")
        self.operator = Operator(ground, height_m, math.radians(-25.0))
        self.companion = Companion(app(), Connection(ours, 1, [191]), config)
        self.tick = 0
        self.target_m = TARGET_M
        self.sees = True
        self.following_pictures = False
        self.record = None

    @property
    def now_s(self) -> float:
        return self.tick * TICK_S

    def run(self, seconds: float, polls: bool = True) -> None:
        for _ in range(round(seconds / TICK_S)):
            self.tick += 1
            self.wire.now_s = self.now_s
            self.autopilot.step(self.now_s)
            self.operator.step(self.now_s)
            if not polls:
                continue
            self.companion.poll(self.now_s)
            if self.following_pictures and self.tick % FRAME_TICKS == 0:
                self.record = self.companion.see(self.candidates(), self.now_s)

    def take_off(self) -> Rig:
        while not self.operator.is_ready:
            assert self.now_s < 60.0, self.operator.stage
            self.run(0.1)
        self.run(0.5)
        return self

    def box(self) -> Box:
        pose = camera_pose(self.vehicle, self.gimbal)
        to_ned = rotation_from_rpy(pose.roll_rad, pose.pitch_rad, pose.yaw_rad) @ GIMBAL_FROM_CAMERA
        offset = np.array(self.target_m) - np.array(pose.pos_ned_m)
        pixel = CAMERA.pixel(to_ned.T @ offset)
        assert pixel is not None
        size_px = CAMERA.fx_px * SIZE_M / float(np.linalg.norm(offset))
        return Box(*pixel, size_px, size_px)

    def candidates(self) -> tuple[Candidate, ...]:
        return (Candidate(self.box(), 0.9, 0.9, 0.9),) if self.sees else ()

    def select(self) -> Rig:
        self.companion.select(None, self.box(), self.now_s)
        self.following_pictures = True
        self.run(1.0)
        return self

    def follow(self) -> Rig:
        assert self.companion.start_following(self.now_s).allowed
        self.run(1.0)
        return self

    def sent_since(self, t_s: float) -> list:
        return [s for s in self.wire.setpoints if s.t_s > t_s]


def app() -> App:
    return App(
        tracker=None,
        target=TargetTracker(),
        gimbal_law=GimbalLaw(GimbalLawConfig()),
        guidance=TrailGuidance(TrailConfig(standoff_m=15.0)),
        limiter=VelocityLimiter(VelocityLimits()),
        intrinsics=CAMERA,
        reference_range_m=None,
    )


def locked() -> Rig:
    rig = Rig().take_off().select()
    assert rig.record.step.target.status is TargetStatus.LOCKED
    return rig


def test_telemetry_comes_at_the_rates_that_were_asked_for():
    rig = Rig().take_off()
    vehicle = rig.companion.autopilot.vehicle_at(rig.now_s, rig.now_s)
    assert vehicle.attitude_valid
    assert vehicle.position_valid
    assert rig.now_s - vehicle.t_s < 0.05
    assert -vehicle.pos_ned_m[2] == pytest.approx(10.0, abs=0.5)
    assert rig.companion.autopilot.status(rig.now_s).mode == "GUIDED"
    assert rig.companion.autopilot.clock.offset_s == pytest.approx(0.0, abs=0.01)


def test_selecting_moves_the_camera_and_not_the_vehicle():
    rig = locked()
    rig.run(2.0)
    assert rig.box().cx_px == pytest.approx(320.0, abs=6.0)
    assert rig.box().cy_px == pytest.approx(240.0, abs=6.0)
    assert rig.wire.setpoints == []
    assert rig.companion.grant.state is GrantState.HELD
    assert rig.wire.gimbal
    assert all(g.flags == 92 for g in rig.wire.gimbal)
    assert max(abs(v) for v in rig.vehicle.pos_ned_m[:2]) < 0.3


def test_without_the_authorisation_the_gimbal_is_left_alone():
    rig = Rig(CompanionConfig(gimbal=False)).take_off().select()
    rig.run(1.0)
    assert rig.record.step.target.status is TargetStatus.LOCKED
    assert rig.wire.gimbal == []
    assert rig.autopilot.state.gimbal_primary != (1, 191)


def test_the_range_at_selection_is_that_of_the_ground():
    rig = locked()
    away = math.dist(camera_pose(rig.vehicle, rig.gimbal).pos_ned_m, rig.target_m)
    estimate = rig.record.step.range_estimate
    assert estimate.valid
    assert estimate.range_m == pytest.approx(away, rel=0.06)


def test_following_brings_the_vehicle_to_its_standoff_and_holds_it():
    rig = locked().follow()
    rig.run(12.0)
    north, east, _ = rig.vehicle.pos_ned_m
    assert math.hypot(rig.target_m[0] - north, rig.target_m[1] - east) == pytest.approx(15.0, abs=2.0)
    assert math.hypot(*rig.vehicle.vel_ned_m_s[:2]) < 0.3
    steps = np.diff([s.t_s for s in rig.sent_since(rig.now_s - 10.0)])
    assert steps.max() <= 0.055, "a gap in the stream"
    assert steps.min() >= 0.045, "each decision once"
    assert {(s.frame, s.type_mask) for s in rig.wire.setpoints} == {(1, 1479)}
    assert rig.record.flight.reason is FlightReason.ENGAGED


def test_following_is_refused_on_the_ground_and_in_another_mode():
    rig = Rig()
    rig.run(1.0)
    rig.companion.select(None, Box(320, 300, 60, 60), rig.now_s)
    assert not rig.companion.start_following(rig.now_s).allowed
    rig = locked()
    rig.operator.change_mode("LOITER")
    rig.run(0.5)
    assert rig.companion.start_following(rig.now_s).reason is FlightReason.OTHER_MODE
    rig.run(1.0)
    assert rig.wire.setpoints == []


def test_a_start_begins_from_standstill():
    """The law has asked for speed since the lock; the first setpoints must not be that speed."""
    rig = locked()
    rig.target_m = (45.0, 3.0, -0.7)
    rig.run(3.0)
    begun_s = rig.now_s
    rig.follow()
    first = rig.sent_since(begun_s)
    assert math.hypot(*first[0].v_ned_m_s[:2]) <= 2.0 * 0.1 + 1e-6
    speeds = [math.hypot(*s.v_ned_m_s[:2]) for s in first]
    assert max(speeds) > 1.0
    assert max(np.diff(speeds)) <= 2.0 * 0.06 + 1e-6


@pytest.mark.parametrize("mode", ["BRAKE", "LOITER", "RTL", "LAND"])
def test_another_mode_silences_it_for_good(mode):
    rig = locked().follow()
    rig.operator.change_mode(mode)
    rig.run(0.1)
    taken_s = rig.now_s
    rig.run(2.0)
    assert rig.sent_since(taken_s) == []
    assert rig.companion.supervisor.permission.reason is FlightReason.OTHER_MODE
    rig.operator.change_mode("GUIDED")
    rig.run(2.0)
    assert rig.companion.autopilot.status(rig.now_s).mode == "GUIDED"
    assert rig.sent_since(taken_s) == [], "a mode that comes back is not a start"
    assert rig.wire.gimbal[-1].t_s > rig.now_s - 0.2, "the camera may go on looking"
    assert rig.companion.start_following(rig.now_s).allowed
    rig.run(0.5)
    assert rig.sent_since(taken_s)


def test_stopping_sends_one_stop_and_then_nothing():
    rig = locked().follow()
    rig.companion.stop_following(rig.now_s)
    stopped_s = rig.now_s
    rig.run(1.0)
    assert rig.wire.setpoints[-1].v_ned_m_s == (0.0, 0.0, 0.0)
    assert rig.wire.setpoints[-1].t_s == pytest.approx(stopped_s + TICK_S), "read by the autopilot a tick later"
    assert rig.companion.supervisor.permission.reason is FlightReason.STOPPED


def test_a_new_selection_ends_following():
    rig = locked().follow()
    rig.companion.select(None, rig.box(), rig.now_s)
    selected_s = rig.now_s
    rig.run(1.0)
    assert rig.wire.setpoints[-1].v_ned_m_s == (0.0, 0.0, 0.0)
    assert rig.sent_since(selected_s + TICK_S) == []


def test_a_refused_selection_changes_nothing():
    rig = locked().follow()
    with pytest.raises(ValueError, match="cannot be selected"):
        rig.companion.select(None, Box(math.nan, 0, 10, 10), rig.now_s)
    asked_s = rig.now_s
    rig.run(0.5)
    assert rig.companion.supervisor.permission.allowed
    assert rig.sent_since(asked_s)


def test_without_pictures_zeros_are_streamed():
    rig = locked().follow()
    rig.following_pictures = False
    rig.run(0.6)
    frozen_s = rig.now_s
    rig.run(1.0)
    sent = rig.sent_since(frozen_s)
    assert len(sent) >= 12, "at 13 Hz"
    assert all(s.v_ned_m_s == (0.0, 0.0, 0.0) and s.yaw_rate_rad_s == 0.0 for s in sent)


def test_a_lost_target_ends_in_a_hover_that_is_still_streamed():
    rig = locked().follow()
    rig.sees = False
    rig.run(2.0)
    lost_s = rig.now_s
    rig.run(2.0)
    assert rig.record.step.target.status is TargetStatus.SEARCHING
    assert rig.record.step.velocity_command.reason is CommandReason.HOLD_NO_TARGET
    sent = rig.sent_since(lost_s)
    assert len(sent) >= 38
    assert all(s.v_ned_m_s == (0.0, 0.0, 0.0) for s in sent)
    assert math.hypot(*rig.vehicle.vel_ned_m_s[:2]) < 0.3


def test_somebody_else_takes_the_gimbal_and_keeps_it():
    rig = locked()
    command = dialect.MAVLink_command_long_message(1, 1, 1001, 0, 255, 190, -1, -1, 0, 0, 0)
    rig.operator._send(command)
    rig.run(1.2)
    assert rig.companion.grant.state is GrantState.TAKEN
    taken_s = rig.now_s
    rig.run(1.0)
    assert [g for g in rig.wire.gimbal if g.t_s > taken_s] == []
    rig.companion.select(None, rig.box(), rig.now_s)
    rig.run(1.0)
    assert rig.companion.grant.state is GrantState.HELD, "asked for again by the operator"


def test_the_end_gives_everything_back():
    rig = locked().follow()
    rig.companion.close(rig.now_s)
    closed_s = rig.now_s
    rig.following_pictures = False
    rig.run(1.0)
    assert rig.wire.setpoints[-1].v_ned_m_s == (0.0, 0.0, 0.0)
    assert rig.sent_since(closed_s + TICK_S) == []
    assert rig.autopilot.state.gimbal_primary != (1, 191)
    assert [g for g in rig.wire.gimbal if g.t_s > closed_s + TICK_S] == []


def test_a_reboot_of_the_autopilot_ends_it_and_the_streams_are_asked_for_again():
    rig = locked().follow()
    rig.following_pictures = False
    rig.operator._send(dialect.MAVLink_command_long_message(1, 1, 400, 0, 0, 21196, 0, 0, 0, 0, 0))  # disarm, forced
    rig.run(4.0)
    assert rig.companion.supervisor.permission.reason is FlightReason.NOT_ARMED
    rig.operator._send(dialect.MAVLink_command_long_message(1, 1, 246, 0, 1, 0, 0, 0, 0, 0, 0))
    rig.run(8.0)
    assert rig.companion.autopilot.reboots == 1
    assert not rig.companion.supervisor.permission.allowed
    assert rig.now_s - rig.companion.autopilot.vehicle_at(rig.now_s, rig.now_s).t_s < 0.1


def test_nothing_on_the_link_breaks_the_loop():
    rig = locked().follow()
    rng = np.random.default_rng(0)
    for _ in range(30):
        rig.wire.write(rng.integers(0, 256, rng.integers(1, 200)).astype(np.uint8).tobytes())
        rig.run(0.1)
    assert rig.companion.faults == 0
    assert rig.record.step.fault is None


def test_an_error_while_sending_ends_the_flight_and_not_the_loop(monkeypatch):
    rig = locked().follow()

    def broken(*_):
        raise RuntimeError("no memory")

    monkeypatch.setattr("uavfollow.companion.velocity_setpoint", broken)
    rig.run(0.2)
    monkeypatch.undo()
    assert rig.companion.supervisor.permission.reason is FlightReason.FAULT
    failed_s = rig.now_s
    rig.run(1.0)
    assert rig.sent_since(failed_s) == []
    assert rig.record.step.target.status is TargetStatus.LOCKED


def test_gimbal_angles_on_the_wire_point_at_the_target():
    rig = locked()
    rig.run(2.0)
    _, pitch, yaw = rpy_from_quaternion(np.array(rig.wire.gimbal[-1].q_wxyz))
    offset = np.array(rig.target_m) - np.array(camera_pose(rig.vehicle, rig.gimbal).pos_ned_m)
    assert yaw == pytest.approx(math.atan2(offset[1], offset[0]), abs=0.02)
    assert pitch == pytest.approx(-math.atan2(offset[2], math.hypot(*offset[:2])), abs=0.02)


# --- what a second reader found


def test_a_mode_that_went_and_came_back_between_two_polls_ends_it():
    rig = locked().follow()
    rig.operator.change_mode("LOITER")
    rig.run(0.1, polls=False)
    rig.operator.change_mode("GUIDED")
    rig.run(0.15, polls=False)
    woken_s = rig.now_s
    rig.run(1.0)
    assert rig.companion.supervisor.permission.reason is FlightReason.OTHER_MODE
    assert rig.sent_since(woken_s + TICK_S) == []


def test_a_program_that_stood_still_does_not_go_on():
    """What waits in the link then is of unknown age, the newest heartbeat in it too."""
    rig = locked().follow()
    rig.run(1.5, polls=False)
    woken_s = rig.now_s
    rig.companion.poll(rig.now_s)
    assert rig.companion.supervisor.permission.reason is FlightReason.STALLED
    assert rig.companion.start_following(rig.now_s).reason is FlightReason.STALLED, "nor on what was waiting"
    rig.run(1.0)
    assert rig.sent_since(woken_s + TICK_S) == []
    assert rig.companion.start_following(rig.now_s).allowed


def test_a_decision_that_took_long_is_not_sent_past_a_new_mode():
    """`see` itself sends nothing: the network may have taken seconds, and the pilot with them."""
    rig = locked().follow()
    rig.operator.change_mode("LOITER")
    rig.run(0.5, polls=False)
    sent = len(rig.wire.setpoints)
    rig.companion.see(rig.candidates(), rig.now_s - 0.5)
    rig.run(0.5)
    assert [s for s in rig.wire.setpoints[sent:] if any(s.v_ned_m_s)] == []
    assert rig.companion.supervisor.permission.reason is FlightReason.OTHER_MODE


def test_the_last_word_before_silence_is_a_stop():
    """Only the landed state stops to come: zeros first, then silence; the vehicle does not fly on for 3 s."""
    rig = locked()
    rig.target_m = (60.0, 3.0, -0.7)
    rig.run(6.0)  # three times as far at once: it must be found again
    rig.follow()
    rig.run(3.0)
    assert math.hypot(*rig.vehicle.vel_ned_m_s[:2]) > 2.0
    rig.companion.autopilot._handlers.pop("EXTENDED_SYS_STATE")
    rig.run(4.0)
    assert rig.companion.supervisor.permission.reason is FlightReason.NOT_AIRBORNE
    assert rig.wire.setpoints[-1].v_ned_m_s == (0.0, 0.0, 0.0)
    assert math.hypot(*rig.vehicle.vel_ned_m_s[:2]) < 0.5


def test_an_error_while_sending_ends_in_a_stop(monkeypatch):
    rig = locked()
    rig.target_m = (60.0, 3.0, -0.7)
    rig.run(6.0)  # three times as far at once: it must be found again
    rig.follow()
    rig.run(2.0)

    def broken(*_):
        raise RuntimeError("no memory")

    monkeypatch.setattr("uavfollow.companion.gimbal_angle", broken)
    rig.run(0.2)
    assert rig.companion.supervisor.permission.reason is FlightReason.FAULT
    assert rig.wire.setpoints[-1].v_ned_m_s == (0.0, 0.0, 0.0)


def test_after_zeros_the_limits_begin_from_standstill():
    rig = locked()
    rig.target_m = (60.0, 3.0, -0.7)
    rig.run(6.0)  # three times as far at once: it must be found again
    rig.follow()
    rig.run(3.0)
    rig.following_pictures = False
    rig.run(0.85)
    assert rig.wire.setpoints[-1].v_ned_m_s == (0.0, 0.0, 0.0)
    paused_s = rig.now_s
    rig.following_pictures = True
    rig.run(0.5)
    speeds = [math.hypot(*s.v_ned_m_s[:2]) for s in rig.sent_since(paused_s)]
    assert max(np.diff([0.0, *speeds])) <= 2.0 * 0.06 + 1e-6


@pytest.mark.parametrize("sees", [True, False])
def test_a_start_needs_a_target_that_is_locked(sees):
    rig = Rig().take_off()
    assert rig.companion.start_following(rig.now_s).reason is FlightReason.NO_TARGET
    rig.select()
    rig.sees = sees
    rig.run(3.0)
    permission = rig.companion.start_following(rig.now_s)
    assert permission.reason is (FlightReason.ENGAGED if sees else FlightReason.NO_TARGET)


def test_a_start_needs_a_range_and_none_is_made_up():
    rig = Rig().take_off()
    rig.companion.autopilot._handlers.pop("LOCAL_POSITION_NED")
    rig.run(1.0)
    rig.select()
    assert not rig.record.step.range_estimate.valid
    assert rig.companion.start_following(rig.now_s).reason is FlightReason.NO_RANGE


def test_a_target_given_up_ends_following():
    rig = locked().follow()
    rig.sees = False
    rig.run(13.0)
    assert rig.record.step.target.status is TargetStatus.LOST
    assert rig.companion.supervisor.permission.reason is FlightReason.HELD_LONG
    ended_s = rig.now_s
    rig.run(1.0)
    assert rig.sent_since(ended_s) == []


def test_a_link_that_answers_late_is_not_flown_on():
    rig = locked().follow()
    rig.companion.autopilot.timesync = lambda *_: None
    rig.run(4.0)
    assert rig.companion.supervisor.permission.allowed
    assert rig.wire.setpoints[-1].v_ned_m_s == (0.0, 0.0, 0.0)
    rig.run(2.0)
    assert rig.companion.supervisor.permission.reason is FlightReason.LINK_LATE
    assert rig.companion.start_following(rig.now_s).reason is FlightReason.LINK_LATE


def test_old_gimbal_angles_are_not_repeated_for_ever():
    rig = locked()
    rig.following_pictures = False
    rig.run(1.0)
    stopped_s = rig.now_s
    rig.run(2.0)
    assert [g for g in rig.wire.gimbal if g.t_s > stopped_s] == []


def test_the_gimbal_is_given_back_though_other_commands_were_not_answered():
    rig = locked()
    rig.companion._commands.add(dialect.MAVLink_command_long_message(1, 77, 512, 0, 259, 0, 0, 0, 0, 0, 0))
    rig.run(0.2)
    rig.companion.close(rig.now_s)
    rig.run(0.5)
    assert rig.autopilot.state.gimbal_primary != (1, 191)


def test_an_unknown_error_while_selecting_ends_following():
    rig = locked().follow()

    def broken(*_):
        raise RuntimeError("no memory")

    rig.companion._app._target.start = broken
    with pytest.raises(RuntimeError):
        rig.companion.select(None, rig.box(), rig.now_s)
    assert rig.companion.supervisor.permission.reason is FlightReason.STOPPED


@pytest.mark.parametrize("mount", [1.0, 6.0])
def test_a_car_that_drives_off_is_kept_with_either_mount(mount):
    """A servo mount reports body angles: taken for levelled ones they would throw the estimate off in each turn."""
    rig = Rig(mount=mount).take_off().select().follow()
    start_s, worst_px = rig.now_s, 0.0
    while rig.now_s < start_s + 14.0:
        t_s = rig.now_s - start_s
        rig.target_m = (22.0 + 0.5 * min(t_s, 4.0) ** 2 / 2 + 2.0 * max(0.0, t_s - 4.0), 3.0 + 0.8 * t_s, -0.7)
        rig.run(0.05)
        if rig.record.step.target.status is TargetStatus.LOCKED:
            worst_px = max(worst_px, abs(rig.record.step.target.box.cx_px - rig.box().cx_px))
    assert rig.record.step.target.status is TargetStatus.LOCKED
    assert rig.companion.autopilot._body_angles.are_body is (mount == 1.0)
    assert worst_px < 25.0
