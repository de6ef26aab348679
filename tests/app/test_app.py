"""The whole step: candidates or frames in, commands out, with real laws and a simulated clock."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from control.gimbal import GimbalLaw, GimbalLawConfig
from control.guidance.trail import TrailConfig, TrailGuidance
from control.limits import VelocityLimiter, VelocityLimits
from control.messages import CommandReason
from tests.control.builders import CAMERA, CENTRE, gimbal, vehicle
from tracker.box import Box
from tracker.messages import Candidate, Frame, TargetReason, TargetStatus
from tracker.raw import RawTarget
from tracker.target import TargetTracker
from uavfollow.app import App, Telemetry

HZ = 20
RANGE_M = 20.0
PICTURE = np.zeros((360, 640, 3), np.uint8)
CENTRED = Box(*CENTRE, 40.0, 40.0)


class ScriptedTracker:
    """Answers from a function of the frame's number; remembers what it was asked."""

    def __init__(self, answer):
        self.answer = answer
        self.hints = []

    def init(self, frame, box):
        self.exemplar = box

    def update(self, frame, hint=None):
        self.hints.append(hint)
        return self.answer(frame.seq)


def app(tracker=None, target=None, **parts):
    values = {
        "gimbal_law": GimbalLaw(GimbalLawConfig()),
        "guidance": TrailGuidance(TrailConfig(standoff_m=15.0)),
        "limiter": VelocityLimiter(VelocityLimits()),
    } | parts
    return App(
        tracker=tracker,
        target=target or TargetTracker(),
        intrinsics=CAMERA,
        reference_range_m=RANGE_M,
        **values,
    )


def telemetry(t_s):
    return Telemetry(vehicle(t_s=t_s), gimbal(t_s=t_s))


def frame(seq):
    return Frame(PICTURE, seq, seq / HZ, seq / HZ)


def found(x_px, y_px, size_px=40.0, score=0.9):
    return (Candidate(Box(x_px, y_px, size_px, size_px), score, score, score),)


def watch(candidates_at, steps, loop=None, box=None):
    """Start on `box` and step candidates found elsewhere; the records."""
    loop = loop or app()
    records = [loop.start(None, box or candidates_at(0)[0].box, telemetry(0.0), 0.0)]
    return records + [loop.step(candidates_at(k), telemetry(k / HZ), k / HZ) for k in range(1, steps + 1)]


@pytest.mark.parametrize(
    ("dx_px", "dy_px", "yaw_sign", "pitch_sign"),
    [(80, 0, 1, 0), (-80, 0, -1, 0), (0, 80, 0, -1), (0, -80, 0, 1), (60, 60, 1, -1)],
)
def test_target_right_turns_right_and_target_below_looks_down(dx_px, dy_px, yaw_sign, pitch_sign):
    last = watch(lambda k: found(CENTRE[0] + dx_px, CENTRE[1] + dy_px), 20)[-1]
    assert last.target.status is TargetStatus.LOCKED
    yaw, pitch = last.gimbal_command.yaw_rate_rad_s, last.gimbal_command.pitch_rate_rad_s
    assert (np.sign(round(yaw, 6)), np.sign(round(pitch, 6))) == (yaw_sign, pitch_sign)
    assert np.sign(round(last.velocity_command.yaw_rate_rad_s, 6)) == yaw_sign


@pytest.mark.parametrize(("scale", "sign"), [(0.6, 1), (1.0, 1), (1.8, -1)])
def test_too_far_approaches_and_too_near_retreats(scale, sign):
    # 20 m at 40 px, standoff 15 m
    last = watch(lambda k: found(*CENTRE, 40.0 * (1 + (scale - 1) * min(k, 30) / 30)), 60)[-1]
    assert last.range_estimate.range_m == pytest.approx(RANGE_M / scale, rel=0.05)
    assert np.sign(last.velocity_command.v_ned_m_s[0]) == sign


def test_before_the_lock_and_without_a_target_nothing_moves():
    first, *rest = watch(lambda k: found(500, 100) if k < 3 else (), 60, box=Box(500, 100, 40, 40))
    for record in (first, *rest):
        assert record.target.status is not TargetStatus.LOCKED
        assert record.gimbal_command.yaw_rate_rad_s == record.gimbal_command.pitch_rate_rad_s == 0.0
        assert record.velocity_command.v_ned_m_s == (0.0, 0.0, 0.0)
        assert record.velocity_command.reason is CommandReason.HOLD_NO_TARGET


def test_a_lost_target_stops_everything_at_once_when_the_coast_is_over():
    records = watch(lambda k: found(450, 180) if k <= 60 else (), 120)
    assert records[60].velocity_command.v_ned_m_s[0] > 0.5
    by_status = {s: [r for r in records if r.target.status is s] for s in TargetStatus}
    assert by_status[TargetStatus.COASTING]
    assert by_status[TargetStatus.SEARCHING]
    speeds = [math.hypot(*r.velocity_command.v_ned_m_s[:2]) for r in by_status[TargetStatus.COASTING]]
    assert all(later <= before + 1e-9 for before, later in pairwise(speeds))
    for record in by_status[TargetStatus.SEARCHING]:
        assert record.velocity_command.v_ned_m_s == (0.0, 0.0, 0.0)
        assert record.velocity_command.yaw_rate_rad_s == record.gimbal_command.yaw_rate_rad_s == 0.0


@settings(max_examples=15)
@given(st.floats(60, 580), st.floats(60, 300), st.floats(20, 80), st.floats(-2, 2))
def test_mirrored_input_gives_mirrored_commands(x_px, y_px, size_px, drift_px):
    def side(mirrored):
        def at(k):
            x = x_px + drift_px * k
            return found(640 - x if mirrored else x, y_px, size_px)

        return watch(at, 14)

    for a, b in zip(side(False), side(True), strict=True):
        assert a.target.status is b.target.status
        assert b.gimbal_command.yaw_rate_rad_s == pytest.approx(-a.gimbal_command.yaw_rate_rad_s, abs=1e-7)
        assert b.gimbal_command.pitch_rate_rad_s == pytest.approx(a.gimbal_command.pitch_rate_rad_s, abs=1e-7)
        assert b.velocity_command.yaw_rate_rad_s == pytest.approx(-a.velocity_command.yaw_rate_rad_s, abs=1e-7)
        north, east, down = a.velocity_command.v_ned_m_s
        assert b.velocity_command.v_ned_m_s == pytest.approx((north, -east, down), abs=1e-6)


def test_frames_go_to_the_tracker_with_the_hint_of_the_filter():
    tracker = ScriptedTracker(lambda seq: found(320 + 2 * seq, 180))
    loop = app(tracker)
    loop.start(frame(0), CENTRED, telemetry(0.0), 0.0)
    for seq in range(1, 40):
        record = loop.step(frame(seq), telemetry(seq / HZ), seq / HZ)
    assert tracker.exemplar == CENTRED
    assert record.target.status is TargetStatus.LOCKED
    assert tracker.hints[-1].center_px[0] == pytest.approx(320 + 2 * 39, abs=1.0)  # where it will be, not where it was


def test_a_tracker_that_fails_costs_its_frames_and_not_the_flight(caplog):
    def answer(seq):
        if 20 <= seq < 23:
            raise RuntimeError("bad picture")
        return found(400, 180)

    loop = app(ScriptedTracker(answer))
    records = [loop.start(frame(0), Box(400, 180, 40, 40), telemetry(0.0), 0.0)]
    records += [loop.step(frame(k), telemetry(k / HZ), k / HZ) for k in range(1, 40)]
    assert [r.seq for r in records] == list(range(40))
    assert [k for k, r in enumerate(records) if r.fault] == [20, 21, 22]
    assert "bad picture" in records[20].fault
    assert "bad picture" in caplog.text
    assert records[20].target.status is TargetStatus.COASTING
    assert records[-1].target.status is TargetStatus.LOCKED


def test_a_picture_that_cannot_be_read_is_a_step_of_its_own():
    loop = app(ScriptedTracker(lambda seq: found(400, 180)))
    loop.start(frame(0), Box(400, 180, 40, 40), telemetry(0.0), 0.0)
    for seq in range(1, 20):
        loop.step(frame(seq), telemetry(seq / HZ), seq / HZ)
    record = loop.step(None, telemetry(1.0), 1.0)
    assert (record.target.status, record.target.reason) == (TargetStatus.COASTING, TargetReason.NO_CANDIDATE)
    assert record.fault


class Failing:
    """Stands for any part; its `step` raises from the third call on."""

    def __init__(self, part):
        self._part, self.calls = part, 0

    def __getattr__(self, name):
        return getattr(self._part, name)

    def step(self, *args):
        self.calls += 1
        if 30 <= self.calls < 33:
            raise ZeroDivisionError("broken on purpose")
        return self._part.step(*args)


@pytest.mark.parametrize("which", ["target", "gimbal_law", "guidance", "limiter"])
def test_an_error_in_any_part_holds_for_that_step_says_why_and_goes_on(which):
    parts = {
        "target": TargetTracker(),
        "gimbal_law": GimbalLaw(GimbalLawConfig()),
        "guidance": TrailGuidance(TrailConfig(standoff_m=15.0)),
        "limiter": VelocityLimiter(VelocityLimits()),
    }
    parts[which] = Failing(parts[which])
    records = watch(lambda k: found(420, 200), 80, app(**parts))
    failed = [r for r in records if r.fault]
    assert 2 <= len(failed) <= 3
    assert records[failed[0].seq - 1].velocity_command.v_ned_m_s[0] > 0.1  # it was flying
    for record in failed:
        assert "broken on purpose" in record.fault
        assert record.velocity_command.v_ned_m_s == (0.0, 0.0, 0.0)
        assert record.velocity_command.yaw_rate_rad_s == record.gimbal_command.yaw_rate_rad_s == 0.0
        assert record.velocity_command.reason is CommandReason.HOLD_FAULT
    after = records[failed[-1].seq + 1]
    assert math.hypot(*after.velocity_command.v_ned_m_s[:2]) <= 2.0 / HZ + 1e-9  # from standstill, not where it was
    assert records[-1].fault is None
    assert records[-1].velocity_command.v_ned_m_s[0] > 0.1


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_never_reaches_a_command(bad):
    spoil_telemetry = [
        lambda t: replace(t, vehicle=replace(t.vehicle, yaw_rad=bad)),
        lambda t: replace(t, vehicle=replace(t.vehicle, pos_ned_m=(bad, 0.0, 0.0))),
        lambda t: replace(t, gimbal=replace(t.gimbal, pitch_rad=bad)),
        lambda t: replace(t, gimbal=replace(t.gimbal, t_s=bad)),
    ]
    spoil_candidate = [found(bad, 180), found(400, bad), found(400, 180, bad), found(400, 180, score=bad)]
    loop = app()
    records = watch(lambda k: found(400, 180), 30, loop)
    for k in range(31, 31 + 8):
        told, seen = telemetry(k / HZ), found(400, 180)
        if k - 31 < 4:
            told = spoil_telemetry[k - 31](told)
        else:
            seen = spoil_candidate[k - 35]
        records.append(loop.step(seen, told, k / HZ))
    records.append(loop.step(found(400, 180), telemetry(2.0), bad))
    for record in records:
        numbers = (*record.velocity_command.v_ned_m_s, record.velocity_command.yaw_rate_rad_s)
        rates = (record.gimbal_command.pitch_rate_rad_s, record.gimbal_command.yaw_rate_rad_s)
        assert all(math.isfinite(v) for v in (*numbers, *rates))
    assert records[-1].velocity_command.v_ned_m_s == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("age_s", [0.31, 5.0])
def test_an_old_picture_moves_nothing(age_s):
    loop = app(ScriptedTracker(lambda seq: found(450, 180)))
    first = replace(frame(0), t_capture_s=10.0 - age_s)
    loop.start(first, Box(450, 180, 40, 40), telemetry(10.0), 10.0)
    for k in range(1, 40):
        now_s = 10.0 + k / HZ
        record = loop.step(replace(frame(k), t_capture_s=now_s - age_s), telemetry(now_s), now_s)
        assert record.velocity_command.reason in (CommandReason.HOLD_STALE_TARGET, CommandReason.HOLD_NO_TARGET)
        assert record.velocity_command.v_ned_m_s == (0.0, 0.0, 0.0)
        assert record.gimbal_command.yaw_rate_rad_s == 0.0
    assert record.target.status is TargetStatus.LOCKED
    assert record.target.t_s == pytest.approx(now_s - age_s)


def test_a_frozen_picture_stops_the_motion():
    loop = app(ScriptedTracker(lambda seq: found(450, 180)))
    loop.start(frame(0), Box(450, 180, 40, 40), telemetry(0.0), 0.0)
    for k in range(1, 60):
        record = loop.step(frame(min(k, 40)), telemetry(k / HZ), k / HZ)
        if k == 40:
            assert record.velocity_command.v_ned_m_s[0] > 0.1
    assert record.velocity_command.reason is CommandReason.HOLD_STALE_TARGET
    assert record.velocity_command.v_ned_m_s == (0.0, 0.0, 0.0)


def test_an_unreadable_picture_is_as_late_as_the_one_before():
    loop = app(ScriptedTracker(lambda seq: found(400, 180)))
    loop.start(replace(frame(0), t_capture_s=-0.1), CENTRED, telemetry(0.0), 0.0)
    for k in range(1, 30):
        now_s = k / HZ
        late = replace(frame(k), t_capture_s=now_s - 0.1)
        record = loop.step(None if k % 7 == 6 else late, telemetry(now_s), now_s)
        assert record.target.reason is not TargetReason.TIME_WENT_BACK
        assert record.target.t_s == pytest.approx(now_s - 0.1)


def test_a_picture_of_another_size_is_a_fault_and_no_measurement():
    tracker = ScriptedTracker(lambda seq: found(640, 360))
    loop = app(tracker)
    loop.start(frame(0), CENTRED, telemetry(0.0), 0.0)
    record = loop.step(Frame(np.zeros((720, 1280, 3), np.uint8), 1, 0.05, 0.05), telemetry(0.05), 0.05)
    assert "1280x720" in record.fault
    assert "640x360" in record.fault
    assert record.candidates == ()
    assert tracker.hints == []


@pytest.mark.parametrize("answer", [None, 5])
def test_a_tracker_that_answers_nonsense_is_named(answer):
    loop = app(ScriptedTracker(lambda seq: answer))
    loop.start(frame(0), CENTRED, telemetry(0.0), 0.0)
    assert "the tracker failed" in loop.step(frame(1), telemetry(0.05), 0.05).fault
    assert "failed" in loop.step(iter([1, 2]), telemetry(0.1), 0.1).fault


def test_two_faults_of_one_step_are_both_told():
    parts = {"tracker": ScriptedTracker(lambda seq: 1 / 0), "target": Failing(TargetTracker())}
    loop = app(**parts)
    loop.start(frame(0), CENTRED, telemetry(0.0), 0.0)
    faults = [loop.step(frame(k), telemetry(k / HZ), k / HZ).fault for k in range(1, 32)]
    assert "the tracker failed" in faults[29]
    assert "the target estimate failed" in faults[29]


@pytest.mark.parametrize(
    ("box", "now_s"), [(Box(300, 150, 40, 40), math.nan), (Box(math.nan, 1, 1, 1), 3.0), (Box(300, 150, 0, 40), 3.0)]
)
def test_a_start_that_fails_changes_nothing(box, now_s):
    tracker = ScriptedTracker(lambda seq: found(450, 180))
    loop = app(tracker)
    loop.start(frame(0), Box(450, 180, 40, 40), telemetry(0.0), 0.0)
    for k in range(1, 40):
        before = loop.step(frame(k), telemetry(k / HZ), k / HZ)
    with pytest.raises(ValueError, match="cannot be selected"):
        loop.start(replace(frame(40), t_capture_s=now_s), box, telemetry(2.0), now_s)
    after = loop.step(frame(40), telemetry(2.0), 2.0)
    assert tracker.exemplar == Box(450, 180, 40, 40)
    assert (after.target.status, after.fault) == (TargetStatus.LOCKED, None)
    assert after.velocity_command.v_ned_m_s[0] == pytest.approx(before.velocity_command.v_ned_m_s[0], abs=0.2)


@pytest.mark.parametrize("range_m", [math.nan, 0.0, -1.0, math.inf])
def test_a_reference_range_that_cannot_be_is_refused_at_once(range_m):
    with pytest.raises(ValueError, match="reference_range_m"):
        App(None, TargetTracker(), GimbalLaw(GimbalLawConfig()), TrailGuidance(TrailConfig()),
            VelocityLimiter(VelocityLimits()), CAMERA, range_m)  # fmt: skip


def test_a_coast_gains_no_speed_even_when_the_target_seems_to_come_near():
    records = watch(lambda k: found(*CENTRE, 40.0 * 1.045**k) if k <= 36 else (), 60)
    coast = [r for r in records if r.target.status is TargetStatus.COASTING]
    speeds = [math.hypot(*r.velocity_command.v_ned_m_s[:2]) for r in (records[coast[0].seq - 1], *coast)]
    assert len(coast) > 10
    assert all(later <= before + 1e-9 for before, later in pairwise(speeds))
    assert {r.velocity_command.reason for r in coast} == {CommandReason.COASTING}


def test_a_raw_target_that_is_started_again_starts_from_standstill():
    loop = app(target=RawTarget())
    before = watch(lambda k: found(600, 180), 40, loop)[-1]
    assert before.gimbal_command.yaw_rate_rad_s > 0.8
    again = loop.start(None, Box(600, 180, 40, 40), telemetry(2.05), 2.05)
    first_step_rad_s = GimbalLawConfig().max_accel_rad_s2 * 0.05
    assert again.gimbal_command.yaw_rate_rad_s <= first_step_rad_s + 1e-9
    assert again.velocity_command.yaw_rate_rad_s <= VelocityLimits().max_yaw_accel_rad_s2 * 0.05 + 1e-9


def test_a_new_start_forgets_the_motion_before():
    loop = app()
    watch(lambda k: found(450, 180), 60, loop)
    again = loop.start(None, CENTRED, telemetry(3.05), 3.05)
    assert again.velocity_command.v_ned_m_s == (0.0, 0.0, 0.0)
    assert again.gimbal_command.yaw_rate_rad_s == 0.0
    assert again.target.status is TargetStatus.ACQUIRING


@pytest.mark.parametrize("box", [Box(math.nan, 10, 10, 10), Box(10, 10, -1, 10)])
def test_a_box_that_cannot_be_is_refused_at_the_start(box):
    with pytest.raises(ValueError, match="box"):
        app().start(None, box, telemetry(0.0), 0.0)


def test_a_raw_target_without_a_candidate_moves_nothing():
    records = watch(lambda k: found(500, 180) if k < 10 else (), 12, app(target=RawTarget()))
    assert records[9].gimbal_command.yaw_rate_rad_s > 0
    assert records[-1].target.status is TargetStatus.SEARCHING
    assert records[-1].target.box == Box(500, 180, 40.0, 40.0)
    assert records[-1].gimbal_command.yaw_rate_rad_s == 0.0
