"""One run in lockstep: a simulated clock, one thread, no sleep. Everything that happens is a function of the seed.

    tick (200 Hz):  autopilot and plant -> ground station -> application's poll -> exposure -> events -> tracker

A picture is exposed at its time, arrives after the camera's latency, is taken up when the tracker is free (the newest
one, others are dropped), and decided upon after `tracker_compute_delay_s`: simulated inference is not free.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from sitl.autopilot.link import ByteLink, pipe
from sitl.drive import Application, Decision, Seen
from sitl.eyes import Eyes, Truths
from sitl.feed import CameraFeed, Exposure
from sitl.flight import Flight
from sitl.metrics.sample import Sample
from sitl.operator import MODES, Operator, OperatorError
from sitl.scenario.build import clicked_box, start_pose
from sitl.scenario.events import ClickEvent, FollowEvent, ModeEvent, PictureEvent, StopEvent
from sitl.scenario.schema import Scenario, Vary
from sitl.scenario.seeds import seed_for
from sitl.wire import SentGimbal, SentSetpoint, WireTap

TICK_HZ = 200  # of the run; the plant below has its own, finer one
POLL_EVERY_TICKS = 2  # the application's loop runs at 100 Hz
MAX_TAKE_OFF_S = 90.0  # of simulated time; 120 m at 2.5 m/s and all waits take less
AFTER_S = 0.5  # the run goes on so long after its end, for the last messages to arrive
# A change of mode is in a heartbeat at once and read by the next poll; what was sent before is read a tick later.
KNOWN_AFTER_S = (POLL_EVERY_TICKS + 1) / TICK_HZ
ENGAGED = "engaged"  # the application's answer to a start that was granted
MIN_CLICK_PX = 3.0  # nobody clicks what is smaller


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """One exposure that was taken up: what was seen, decided, and true."""

    seen: Seen
    decision: Decision
    truths: Truths
    sample: Sample


@dataclass(frozen=True, slots=True)
class Happening:
    """Something that was done to the run, and how it was answered."""

    t_s: float
    kind: str
    answer: str


@dataclass(slots=True)
class RunLog:
    """Everything of a run. `begin_s` is the run's time at the scenario's time 0.

    `override_s`: when the application could know that the autopilot had left GUIDED after following had begun; None
    when it never did. `resumed_s`: when the operator started following again after that.
    """

    begin_s: float = math.nan
    steps: list[Step] = field(default_factory=list)
    happenings: list[Happening] = field(default_factory=list)
    setpoints: list[SentSetpoint] = field(default_factory=list)
    gimbal: list[SentGimbal] = field(default_factory=list)
    override_s: float | None = None
    resumed_s: float | None = None
    texts: list[str] = field(default_factory=list)
    interrupted: bool = False


class Run:
    """One scenario with one seed. `application_link` is the simulator's end of the application's link."""

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        flight: Flight,
        eyes: Eyes,
        application: Application,
        application_link: ByteLink,
        on_step: Callable[[Step], None] | None = None,
        pace: Callable[[float], None] | None = None,
    ) -> None:
        self._scenario = scenario
        self._seed = seed
        self._flight = flight
        self._eyes = eyes
        self._application = application
        self._on_step = on_step
        self._pace = pace
        self._tap = WireTap(application_link)
        ours, theirs = pipe()
        flight.autopilot.attach(self._tap, "companion")
        flight.autopilot.attach(theirs, "ground station")
        pitch = start_pose(scenario).pitch_rad
        self._operator = Operator(ours, scenario.vehicle.takeoff_height_m, pitch)
        c = scenario.camera
        self._feed = CameraFeed(
            c.latency_ms * 1e-3, c.jitter_ms * 1e-3, c.drop_share, seed_for(scenario, seed, Vary.NOISE)
        )
        self._events = sorted(scenario.events, key=lambda e: e.at_s)
        self._covers = [e for e in self._events if isinstance(e, PictureEvent)]
        self._busy: tuple[float, Seen, Exposure, Truths] | None = None
        self._selected = self._engaged = False
        self._frozen: tuple[Seen, Truths] | None = None
        self.log = RunLog()

    def run(self) -> RunLog:
        """From power-on to the end. Raises OperatorError when the vehicle does not get into the air."""
        tick = self._take_off()
        begin = tick
        self.log.begin_s = begin / TICK_HZ
        end = begin + round(self._scenario.duration_s * TICK_HZ)
        try:
            while tick < end:
                self._tick(tick)
                self._scene(tick / TICK_HZ)
                tick += 1
        except KeyboardInterrupt:
            self.log.interrupted = True
        self._application.close(tick / TICK_HZ)
        for last in range(tick, tick + round(AFTER_S * TICK_HZ)):
            self._tick(last)
        self.log.setpoints, self.log.gimbal = self._tap.setpoints, self._tap.gimbal
        self.log.texts = self._operator.texts
        return self.log

    def _take_off(self) -> int:
        for tick in range(round(MAX_TAKE_OFF_S * TICK_HZ)):
            self._tick(tick)
            if self._operator.is_ready:
                return tick + 1
        said = "; ".join(self._operator.texts[-3:]) or "nothing"
        raise OperatorError(
            f"take-off: still {self._operator.stage.value} after {MAX_TAKE_OFF_S:g} s; the autopilot said: {said}"
        )

    def _tick(self, tick: int) -> None:
        now_s = tick / TICK_HZ
        if self._pace is not None:
            self._pace(now_s)
        self._tap.now_s = now_s
        self._flight.autopilot.step(now_s)
        self._operator.step(now_s)
        if self.log.override_s is None and self._engaged and self._flight.autopilot.state.mode != MODES["GUIDED"]:
            self.log.override_s = now_s + KNOWN_AFTER_S
        if tick % POLL_EVERY_TICKS == 0:
            self._application.poll(now_s)

    def _scene(self, now_s: float) -> None:
        scene_s = now_s - self.log.begin_s
        if scene_s * self._scenario.fps >= self._feed.exposed - 1e-6:
            self._expose(now_s, scene_s)
        while self._events and self._events[0].at_s <= scene_s + 1e-9:
            self._happen(self._events.pop(0), now_s)
        if self._busy is not None and now_s >= self._busy[0] - 1e-9:
            self._decide(now_s)
        if self._busy is None and self._selected:
            self._take_up(now_s)

    def _expose(self, now_s: float, scene_s: float) -> None:
        seq, available_s = self._feed.next_exposure(now_s)
        if available_s is not None:
            self._feed.put(self._flight.exposure(seq, now_s, scene_s, available_s))

    def _take_up(self, now_s: float) -> None:
        exposure = self._feed.newest(now_s)
        if exposure is None:
            return
        calls = self._application.searches(exposure.t_s)
        seen, truths = self._look(exposure, now_s)
        self._busy = (now_s + calls * self._scenario.tracker_compute_delay_s, seen, exposure, truths)

    def _look(self, exposure: Exposure, now_s: float) -> tuple[Seen, Truths]:
        """What reaches the application, and what is true: for a picture that shows nothing new, nothing is visible."""
        cover = next((c for c in self._covers if c.at_s <= exposure.scene_s < c.at_s + c.duration_s), None)
        if cover is None:
            searched_px = self._application.searched_px(exposure.t_s)
            self._frozen = self._eyes.look(exposure, now_s, searched_px)
            return self._frozen
        if cover.kind == "black" or self._frozen is None:
            return self._eyes.black(exposure, now_s)[0], {}
        old = self._frozen[0]
        return Seen(exposure.seq, exposure.t_s, now_s, old.image_bgr_u8, old.candidates), {}

    def _decide(self, now_s: float) -> None:
        assert self._busy is not None
        _, seen, exposure, truths = self._busy
        self._busy = None
        self._keep(seen, self._application.see(seen, now_s), exposure, truths, now_s)

    def _happen(self, event: object, now_s: float) -> None:
        if isinstance(event, ClickEvent):
            self._note(now_s, "click", self._click(event, now_s))
        elif isinstance(event, FollowEvent):
            self._follow(now_s)
        elif isinstance(event, StopEvent):
            self._application.stop_following(now_s)
            self._note(now_s, "stop", "asked")
        elif isinstance(event, ModeEvent):
            self._operator.change_mode(event.mode)
            self._note(now_s, f"mode {event.mode}", "asked")
        elif isinstance(event, PictureEvent):
            self._note(now_s, event.kind, f"for {event.duration_s:g} s")

    def _follow(self, now_s: float) -> None:
        answer = self._application.start_following(now_s)
        self._note(now_s, "follow", answer)
        if answer == ENGAGED:
            self._engaged = True
            if self.log.override_s is not None and self.log.resumed_s is None:
                self.log.resumed_s = now_s

    def _click(self, event: ClickEvent, now_s: float) -> str:
        """The operator marks the target in the newest picture, if he sees it there."""
        exposure = self._feed.on_screen(now_s)
        if exposure is None:
            return "no picture to click into"
        seen, truths = self._look(exposure, now_s)
        truth = truths.get(self._scenario.target.name)
        if truth is None or truth.visible is None or min(truth.visible.w_px, truth.visible.h_px) < MIN_CLICK_PX:
            return "the target is not to be seen in the picture"
        box = clicked_box(self._scenario, self._seed, event, truth.visible)
        try:
            decision = self._application.select(seen, box, now_s)
        except ValueError as error:
            return f"refused: {error}"
        self._selected, self._busy = True, None
        self._keep(seen, decision, exposure, truths, now_s)
        return "selected"

    def _note(self, now_s: float, kind: str, answer: str) -> None:
        self.log.happenings.append(Happening(now_s, kind, answer))

    def _keep(self, seen: Seen, decision: Decision, exposure: Exposure, truths: Truths, now_s: float) -> None:
        sample = self._sample(decision, exposure, truths, now_s)
        step = Step(seen, decision, truths, sample)
        # The log of a long run keeps no pictures and not the application's own records.
        self.log.steps.append(Step(_without_picture(seen), replace(decision, record=None), truths, sample))
        if self._on_step is not None:
            self._on_step(step)

    def _sample(self, decision: Decision, exposure: Exposure, truths: Truths, now_s: float) -> Sample:
        camera = self._scenario.camera
        target_pos, target_vel = self._flight.target_at(self._scenario.target.name, exposure.scene_s)
        return Sample(
            t_s=exposure.t_s,
            now_s=now_s,
            status=decision.status,
            reason=decision.reason,
            box=decision.box,
            truth=truths.get(self._scenario.target.name),
            aim_px=(camera.width_px / 2.0, camera.height_px / 2.0),
            following=decision.may_fly,
            command_v_ned_m_s=decision.v_ned_m_s,
            command_yaw_rate_rad_s=decision.yaw_rate_rad_s,
            command_reason=decision.command_reason,
            command_sent=decision.may_fly,
            gimbal_pitch_rate_rad_s=decision.gimbal_rate_rad_s[0],
            gimbal_yaw_rate_rad_s=decision.gimbal_rate_rad_s[1],
            gimbal_reason=decision.gimbal_reason,
            vehicle_pos_ned_m=exposure.vehicle_pos_ned_m,
            vehicle_vel_ned_m_s=exposure.vehicle_vel_ned_m_s,
            vehicle_yaw_rad=exposure.vehicle_yaw_rad,
            target_pos_ned_m=target_pos,
            target_vel_ned_m_s=target_vel,
        )


def _without_picture(seen: Seen) -> Seen:
    return Seen(seen.seq, seen.t_capture_s, seen.t_receive_s, None, seen.candidates)
