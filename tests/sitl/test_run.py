"""The lockstep runner with an application that only watches: when it is called, with what, and what it is told."""

from __future__ import annotations

import dataclasses
import itertools
import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from sitl.autopilot.arducopter import ArduCopter
from sitl.autopilot.config import ArduCopterConfig
from sitl.autopilot.link import pipe
from sitl.drive import Decision
from sitl.eyes import GeometryEyes
from sitl.flight import Flight, build_world
from sitl.measure import PERFECT, MeasurementModel
from sitl.operator import OperatorError
from sitl.render.geometry import GeometryCamera
from sitl.run import Run
from sitl.scenario import load_scenario
from sitl.scenario.build import camera_model
from sitl.scenario.events import ClickEvent, FollowEvent, ModeEvent, PictureEvent, StopEvent
from sitl.wire import WireTap

WORLD = build_world(load_scenario("default"), 0)


class Watcher:
    """Says LOCKED on whatever it is given and notes every call; flies north when told to follow, as long as GUIDED."""

    def __init__(self) -> None:
        self.link, self.theirs = pipe()
        self.mav = dialect.MAVLink(None, srcSystem=1, srcComponent=191)
        self.calls: list[tuple[str, float]] = []
        self.seen = []
        self.selected = []
        self.follows = False

    def poll(self, now_s):
        self.calls.append(("poll", now_s))
        self.link.read_available()
        if self.follows:
            message = dialect.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, 1479, 0, 0, 0, 0.5, 0, 0, 0, 0, 0, 0, 0
            )
            self.link.write(bytes(message.pack(self.mav)))

    def decide(self, seen):
        box = seen.candidates[0].box if seen.candidates else None
        return Decision("LOCKED" if box else "SEARCHING", "seen", box, 1.0, (0.5, 0.0, 0.0), 0.0, "tracking",
                        (0.0, 0.0), "tracking", self.follows, "engaged", None)  # fmt: skip

    def select(self, seen, box, now_s):
        self.selected.append((now_s, box))
        return self.decide(seen)

    def searches(self, t_capture_s):
        return 1

    def searched_px(self, t_capture_s):
        return ()

    def see(self, seen, now_s):
        self.seen.append((seen, now_s))
        return self.decide(seen)

    def start_following(self, now_s):
        self.follows = True
        return "engaged"

    def stop_following(self, now_s):
        self.follows = False

    def close(self, now_s):
        self.follows = False
        self.calls.append(("close", now_s))


def run(*events, duration_s=4.0, **changes):
    camera = changes.pop("camera", {})
    scenario = load_scenario("default")
    scenario = scenario.model_copy(
        update={
            "events": tuple(events), "duration_s": duration_s, "tracker_compute_delay_s": 0.06,
            "camera": scenario.camera.model_copy(update={"jitter_ms": 0.0, "drop_share": 0.0} | camera), **changes,
        }
    )  # fmt: skip
    model = camera_model(scenario)
    eyes = GeometryEyes(GeometryCamera(WORLD, model), MeasurementModel(PERFECT), "target", model)
    watcher = Watcher()
    log = Run(scenario, 0, Flight(scenario, 0, WORLD), eyes, watcher, watcher.theirs).run()
    return watcher, log


CLICK = ClickEvent(kind="click", at_s=0.5, error_sigma_share=0.0, size_sigma_share=0.0)
FOLLOW = FollowEvent(kind="follow", at_s=1.0)


def test_times_of_a_picture():
    """Exposed on the grid, there after the latency, decided upon after the compute delay; the rest is dropped."""
    watcher, log = run(CLICK)
    assert len(watcher.seen) > 30
    for seen, now_s in watcher.seen:
        assert (seen.t_capture_s - log.begin_s) * 30 == pytest.approx(seen.seq, abs=0.16), "on a grid of 5 ms"
        assert seen.t_receive_s >= seen.t_capture_s + 0.06 - 1e-9
        assert now_s - seen.t_receive_s == pytest.approx(0.06, abs=1e-6)
        assert now_s - seen.t_capture_s < 0.06 + 0.06 + 0.04 + 0.01
    numbers = [seen.seq for seen, _ in watcher.seen]
    assert sorted(set(numbers)) == numbers
    assert max(b - a for a, b in itertools.pairwise(numbers)) <= 3


def test_polls_come_at_100_hz_from_power_on_to_after_the_end():
    watcher, log = run()
    polls = [t for kind, t in watcher.calls if kind == "poll"]
    assert polls[0] == 0.0
    assert all(b - a == pytest.approx(0.01) for a, b in itertools.pairwise(polls))
    assert polls[-1] > log.begin_s + 4.4
    assert watcher.calls.count(("close", pytest.approx(log.begin_s + 4.0))) == 1


def test_nothing_is_shown_before_the_click_and_the_click_is_what_is_visible():
    watcher, log = run(CLICK)
    ((clicked_s, box),) = watcher.selected
    assert clicked_s == pytest.approx(log.begin_s + 0.5)
    assert watcher.seen[0][1] > clicked_s
    assert box == log.steps[0].sample.truth.visible


def test_a_click_on_what_is_not_there_is_refused_and_said():
    watcher, log = run(CLICK, PictureEvent(kind="black", at_s=0.0, duration_s=3.0))
    assert watcher.selected == []
    assert log.happenings[-1].answer == "the target is not to be seen in the picture"
    assert log.steps == []


def test_setpoints_are_counted_on_the_wire_and_move_the_vehicle():
    _watcher, log = run(CLICK, FOLLOW, StopEvent(kind="stop", at_s=3.0))
    times = [s.t_s - log.begin_s for s in log.setpoints]
    assert min(times) == pytest.approx(1.0, abs=0.02)
    assert max(times) == pytest.approx(3.0, abs=0.02)
    assert log.setpoints[0].v_ned_m_s == (0.5, 0.0, 0.0)
    moved = log.steps[-1].sample.vehicle_pos_ned_m[0] - log.steps[0].sample.vehicle_pos_ned_m[0]
    assert moved > 0.3
    assert log.override_s is None


def test_an_override_is_noted_when_the_application_can_know_of_it():
    _, log = run(CLICK, FOLLOW, ModeEvent(kind="mode", at_s=2.0, mode="BRAKE"))
    assert log.override_s - log.begin_s == pytest.approx(2.02, abs=0.011)


def test_a_frozen_camera_shows_the_old_picture_with_new_stamps_and_no_truth():
    watcher, log = run(CLICK, PictureEvent(kind="freeze", at_s=2.0, duration_s=1.0))
    frozen = [s for s, _ in watcher.seen if 2.0 <= s.t_capture_s - log.begin_s < 2.99]
    assert len(frozen) > 5
    assert all(s.candidates is frozen[0].candidates for s in frozen)
    assert len({s.t_capture_s for s in frozen}) == len(frozen)
    hidden = [s.sample.truth for s in log.steps if 2.0 <= s.sample.t_s - log.begin_s < 2.99]
    assert set(hidden) == {None}


def test_truth_of_movers_is_at_the_exposure():
    _, log = run(CLICK, duration_s=6.0)
    for step in log.steps[-10:]:
        place = WORLD.placements(step.sample.t_s - log.begin_s)["target"]
        assert step.sample.target_pos_ned_m[:2] == pytest.approx((place.north_m, place.east_m), abs=1e-6)
        assert math.hypot(*step.sample.target_vel_ned_m_s[:2]) == pytest.approx(place.speed_m_s)


def test_a_vehicle_that_never_gets_ready_says_at_which_stage():
    scenario = load_scenario("default")
    flight = Flight(scenario, 0, WORLD)
    flight.autopilot = ArduCopter(flight.vehicle, flight.gimbal, ArduCopterConfig(ready_after_s=1e6))
    watcher = Watcher()
    model = camera_model(scenario)
    eyes = GeometryEyes(GeometryCamera(WORLD, model), MeasurementModel(PERFECT), "target", model)
    with pytest.raises(OperatorError, match=r"asking for GUIDED.*requires position"):
        Run(scenario, 0, flight, eyes, watcher, watcher.theirs).run()


def test_the_tap_passes_every_byte_on_and_survives_garbage():
    ours, theirs = pipe()
    tap = WireTap(theirs)
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=191)
    message = dialect.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 1479, 0, 0, 0, 1, 2, 3, 0, 0, 0, 0, 0.4)
    sent = b"\xfd\x01garbage" * 3 + bytes(message.pack(mav)) + b"\x00" * 40 + bytes(message.pack(mav))
    ours.write(sent)
    tap.now_s = 5.0
    assert tap.read_available() == sent
    assert tap.setpoints
    assert tap.setpoints[-1].v_ned_m_s == (1.0, 2.0, 3.0)
    assert tap.setpoints[-1].t_s == 5.0
    tap.write(b"down")
    assert ours.read_available() == b"down"


def test_samples_are_complete():
    _, log = run(CLICK)
    for value in dataclasses.asdict(log.steps[-1].sample).items():
        assert value is not None


def test_a_second_click_goes_into_the_picture_on_the_screen():
    """The tracker has taken up every picture as it came; the operator still sees the last one."""
    again = [ClickEvent(kind="click", at_s=2.0 + k / 100) for k in range(4)]
    _, log = run(CLICK, *again, tracker_compute_delay_s=0.0)
    assert [h.answer for h in log.happenings] == ["selected"] * 5


def test_a_new_start_after_an_override_is_noted():
    _, log = run(
        CLICK, FOLLOW, ModeEvent(kind="mode", at_s=2.0, mode="BRAKE"), ModeEvent(kind="mode", at_s=2.5, mode="GUIDED"),
        FollowEvent(kind="follow", at_s=3.0),
    )  # fmt: skip
    assert log.override_s - log.begin_s == pytest.approx(2.02, abs=0.011)
    assert log.resumed_s - log.begin_s == pytest.approx(3.0)


def test_without_following_there_is_nothing_to_override():
    _, log = run(CLICK, ModeEvent(kind="mode", at_s=2.0, mode="BRAKE"))
    assert log.override_s is None


def test_the_log_keeps_no_pictures_and_no_records():
    _, log = run(CLICK)
    assert all(s.seen.image_bgr_u8 is None and s.decision.record is None for s in log.steps)
