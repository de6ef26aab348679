"""The state machine of the target on scripted candidates and a simulated clock."""

import math
from collections.abc import Callable
from dataclasses import astuple
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from tracker.box import Box
from tracker.filter import FilterConfig
from tracker.messages import Candidate, TargetReason, TargetState, TargetStatus
from tracker.target import MAX_HINT_SCALE, TargetConfig, TargetTracker

IDLE, ACQUIRING, LOCKED = TargetStatus.IDLE, TargetStatus.ACQUIRING, TargetStatus.LOCKED
COASTING, SEARCHING, LOST = TargetStatus.COASTING, TargetStatus.SEARCHING, TargetStatus.LOST
BOX = Box(300.0, 200.0, 30.0, 60.0)
SIZE_PX = math.sqrt(30.0 * 60.0)
IMAGE = (640.0, 360.0)
RATES = (10.0, 20.0, 30.0)
BAD = (math.nan, math.inf, -math.inf)
EPS = 1e-5

Script = Callable[[float], list[Candidate]]


def seen(score: float = 0.8, dx: float = 0.0, dy: float = 0.0) -> Candidate:
    return Candidate(Box(BOX.cx_px + dx, BOX.cy_px + dy, BOX.w_px, BOX.h_px), score, score, score)


def play(script: Script, until_s: float, fps: float = 30.0, tracker: TargetTracker | None = None) -> list[TargetState]:
    """Start at 0 and step a script of time to candidates; the first state is that of the start."""
    tracker = tracker or TargetTracker()
    states = [tracker.start(BOX, 0.0)]
    for k in range(1, round(until_s * fps) + 1):
        states.append(tracker.step(script(k / fps), k / fps, IMAGE))
    return states


def locked(fps: float = 30.0, config: TargetConfig | None = None) -> TargetTracker:
    """A tracker that has been locked on a still target until 1 s."""
    tracker = TargetTracker(config)
    assert play(lambda t: [seen()], 1.0, fps, tracker)[-1].status is LOCKED
    return tracker


def changes(states: list[TargetState]) -> list[tuple[float, TargetStatus]]:
    """Time and status at every change of the status."""
    return [(b.t_s, b.status) for a, b in pairwise(states) if a.status is not b.status]


def until(t_s: float, before: list[Candidate], after: list[Candidate]) -> Script:
    return lambda t: before if t <= t_s + EPS else after


STEADY = [seen()]
FAR = seen(0.8, 6 * SIZE_PX)

# --- the table: script, time to look at, status, reason


def leaving(t: float) -> list[Candidate]:
    """Moves right at 200 px/s, out of the picture of 640 px at 1.7 s, unseen from 1.6 s."""
    return [seen(0.8, 200 * t)] if t <= 1.6 + EPS else []


TABLE = [
    ("selected", lambda t: STEADY, 0.0, ACQUIRING, TargetReason.SELECTED),
    ("few sightings", lambda t: STEADY, 0.1, ACQUIRING, TargetReason.CONFIRMING),
    ("weak sightings", lambda t: [seen(0.4)], 0.5, ACQUIRING, TargetReason.LOW_SCORE),
    ("not seen at first", lambda t: [], 0.5, ACQUIRING, TargetReason.NO_CANDIDATE),
    ("never confirmed", lambda t: [seen(0.4)], 1.5, SEARCHING, TargetReason.NOT_CONFIRMED),
    ("confirmed", lambda t: STEADY, 0.4, LOCKED, TargetReason.SEEN),
    ("seen", lambda t: STEADY, 1.0, LOCKED, TargetReason.SEEN),
    ("sustained by the lower threshold", until(1, STEADY, [seen(0.45)]), 3.0, LOCKED, TargetReason.SEEN),
    ("below it", until(1, STEADY, [seen(0.35)]), 1.2, COASTING, TargetReason.LOW_SCORE),
    ("nothing found", until(1, STEADY, []), 1.2, COASTING, TargetReason.NO_CANDIDATE),
    ("not finite", until(1, STEADY, [seen(math.nan)]), 1.2, COASTING, TargetReason.NOT_FINITE),
    ("outside the gate", until(1, STEADY, [FAR]), 1.2, COASTING, TargetReason.INNOVATION_GATE),
    ("weak outside the gate", until(1, STEADY, [seen(0.45, 6 * SIZE_PX)]), 1.02, COASTING, TargetReason.INNOVATION_GATE),
    ("weak and far for long", until(1, STEADY, [seen(0.5, 3 * SIZE_PX)]), 2.0, COASTING, TargetReason.LOW_SCORE),
    ("a jump that persists", until(1, STEADY, [seen(0.8, 0, 2.5 * SIZE_PX)]), 2.0, LOCKED, TargetReason.SEEN),
    ("the inlier wins", until(1, STEADY, [seen(0.99, 6 * SIZE_PX), seen(0.5)]), 1.2, LOCKED, TargetReason.SEEN),
    ("left the picture", leaving, 1.9, COASTING, TargetReason.OUT_OF_FRAME),
    ("out of sight for good", until(2, STEADY, []), 3.5, SEARCHING, TargetReason.COAST_EXPIRED),
    ("searching, nothing", until(1, STEADY, []), 3.0, SEARCHING, TargetReason.NO_CANDIDATE),
    (
        "searching, weak",
        lambda t: STEADY if t <= 1 + EPS else [] if t < 2.6 else [seen(0.5)],
        3.0,
        SEARCHING,
        TargetReason.LOW_SCORE,
    ),
    ("gave up", until(1, STEADY, []), 11.0, LOST, TargetReason.GAVE_UP),
    ("stays given up", lambda t: STEADY if t <= 1 + EPS or t > 11.5 else [], 14.0, LOST, TargetReason.GAVE_UP),
]


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize(("name", "script", "at_s", "status", "reason"), TABLE, ids=[row[0] for row in TABLE])
def test_status_and_reason(name, script, at_s, status, reason, fps):
    state = play(script, math.ceil(at_s * fps - EPS) / fps, fps)[-1]
    assert (state.status, state.reason) == (status, reason)


def test_every_status_and_reason_is_reached():
    reached: set[object] = set()
    tracker = TargetTracker()
    states = [tracker.step([], 0.0, IMAGE)]
    for _, script, at_s, _, _ in TABLE:
        states += play(script, at_s)
    states += play(lambda t: [] if 1 < t < 3 else STEADY, 4.0, 30.0, tracker)
    states += [tracker.step(STEADY, 3.0, IMAGE), tracker.stop(5.0)]
    states += play(until(1, STEADY, []), 6.0, 30.0, TargetTracker(TargetConfig(coast_s=5.0)))  # COAST_UNSURE
    for state in states:
        reached |= {state.status, state.reason}
    # FAULT is the application's; SHAPE_COLLAPSE is reached in test_collapse.py
    assert reached == set(TargetStatus) | set(TargetReason) - {TargetReason.FAULT, TargetReason.SHAPE_COLLAPSE}


# --- times, the same at every rate


@pytest.mark.parametrize("fps", RATES)
def test_a_loss_is_declared_in_time(fps):
    states = play(until(2, STEADY, []), 13.0, fps)
    times = {status: t for t, status in changes(states)}
    period = 1 / fps
    assert times[LOCKED] == pytest.approx(0.2, abs=2 * period + EPS)
    assert times[COASTING] == pytest.approx(2.0 + period)
    assert times[SEARCHING] == pytest.approx(3.5)  # 1.5 s after it was last seen, before 1.5 s of absence
    assert times[LOST] == pytest.approx(12.0)
    assert [s for _, s in changes(states)] == [LOCKED, COASTING, SEARCHING, LOST]


@pytest.mark.parametrize("fps", RATES)
def test_reacquired_within_its_time_and_at_the_candidate(fps):
    def script(t: float) -> list[Candidate]:
        return STEADY if t <= 1 + EPS else [] if t < 4 - EPS else [seen(0.7, 150.0)]

    states = play(script, 5.0, fps)
    first = next(s for s in states if s.reason is TargetReason.REACQUIRED)
    assert first.status is LOCKED
    assert first.t_s == pytest.approx(4.2, abs=EPS)
    assert astuple(first.box) == pytest.approx(astuple(seen(0.7, 150.0).box))
    assert all(s.reason is TargetReason.CONFIRMING for s in states if 4 - EPS < s.t_s < first.t_s - EPS)
    assert all(s.status is LOCKED for s in states if s.t_s > first.t_s)


@pytest.mark.parametrize("score", [0.41, 0.54])
def test_reacquiring_needs_the_upper_threshold(score):
    states = play(lambda t: STEADY if t <= 1 + EPS else [] if t < 4 else [seen(score)], 6.0)
    assert all(s.status is SEARCHING and s.reason is TargetReason.LOW_SCORE for s in states if s.t_s > 4.01)


def test_reacquiring_needs_candidates_that_agree_in_a_row():
    def scattered(t: float) -> list[Candidate]:
        return [seen(0.9, 150.0 * math.cos(20 * t), 100.0 * math.sin(33 * t))]

    def every_other(t: float) -> list[Candidate]:
        return STEADY if round(t * 30) % 4 else []

    for late in (scattered, every_other):
        states = play(lambda t, late=late: STEADY if t <= 1 + EPS else [] if t < 4 else late(t), 7.0)
        assert all(s.status is SEARCHING for s in states if s.t_s > 4)


def test_a_coasting_target_needs_the_upper_threshold():
    states = play(lambda t: STEADY if t <= 1 + EPS else [] if t < 1.1 else [seen(0.5 if t < 1.5 else 0.6)], 2.0)
    assert all(s.status is COASTING for s in states if 1.01 < s.t_s < 1.5)
    assert all(s.status is LOCKED for s in states if s.t_s > 1.51)


def test_a_coast_ends_by_time_at_most_5_s_with_a_wide_search():
    config = TargetConfig(coast_s=5.0, search_half_sizes=50.0)
    times = {s: t for t, s in changes(play(until(1, STEADY, []), 8.0, 30.0, TargetTracker(config)))}
    assert times[SEARCHING] == pytest.approx(6.0)


def test_a_coast_ends_when_the_ellipse_leaves_the_search_region():
    config = TargetConfig(coast_s=5.0)
    states = play(until(1, STEADY, []), 8.0, 30.0, TargetTracker(config))
    end = {s: t for t, s in changes(states)}[SEARCHING]
    assert 1.0 < end - 1.0 < 4.0
    assert TargetReason.COAST_UNSURE in {s.reason for s in states}
    assert TargetReason.COAST_EXPIRED not in {s.reason for s in states}
    for s in states:
        sigma_px = math.sqrt(np.linalg.eigvalsh(s.cov[:2, :2])[-1])
        inside = 2 * sigma_px <= config.search_half_sizes * math.sqrt(s.box.w_px * s.box.h_px)
        if s.status is COASTING:
            assert inside
    narrow = TargetConfig(coast_s=5.0, search_half_sizes=1.0)
    sooner = {s: t for t, s in changes(play(until(1, STEADY, []), 8.0, 30.0, TargetTracker(narrow)))}
    assert sooner[SEARCHING] < end


def test_a_default_coast_lasts_its_full_time():
    """The default noises must let a well-tracked target coast for coast_s: the ellipse must not cut it short."""
    for score in (0.6, 0.75, 0.9):
        times = {s: t for t, s in changes(play(until(2, [seen(score)], []), 5.0))}
        assert times[SEARCHING] == pytest.approx(3.5)


def test_a_gap_longer_than_a_coast_is_no_lock():
    state = locked().step(STEADY, 3.0, IMAGE)
    assert (state.status, state.reason) == (SEARCHING, TargetReason.COAST_EXPIRED)


def test_a_jump_is_reported_as_reacquired_once():
    # 6 sizes are outside the gate until the run of agreeing outliers opens it after 0.4 s.
    states = play(until(1, STEADY, [seen(0.8, 6 * SIZE_PX)]), 2.0)
    after = [s for s in states if s.t_s > 1 + EPS]
    assert [s.reason for s in after].count(TargetReason.REACQUIRED) == 1
    assert after[-1].status is LOCKED
    assert next(s.t_s for s in after if s.status is LOCKED) <= 1.5


def test_the_same_way_at_10_20_and_30_hz():
    """A moving target with an occlusion: box, status and confidence agree at the common times."""

    def script(t: float) -> list[Candidate]:
        hidden = 2.0 + EPS < t < 2.8 - EPS
        return [] if hidden else [seen(0.8, 60 * t)]

    runs = [{round(s.t_s, 3): s for s in play(script, 5.0, fps)} for fps in RATES]
    for k in range(5, 51):
        a, b, c = (run[round(k / 10, 3)] for run in runs)
        assert a.status is b.status is c.status
        assert np.ptp([s.box.cx_px for s in (a, b, c)]) < 0.1 * SIZE_PX
        assert np.ptp([s.confidence for s in (a, b, c)]) < 1e-6
        assert np.ptp([s.vel_px_s[0] for s in (a, b, c)]) < 8.0


# --- what is reported


def test_confidence_is_the_last_score_and_fades():
    tracker = locked()
    state = tracker.step([seen(0.6)], 1.1, IMAGE)
    assert state.confidence == pytest.approx(0.6)
    faded = [tracker.step([], 1.1 + dt, IMAGE).confidence for dt in (0.5, 1.0, 3.0)]
    assert faded == pytest.approx([0.6 * math.exp(-dt / 0.5) for dt in (0.5, 1.0, 3.0)])
    assert tracker.step([], 20.0, IMAGE).confidence == 0.0
    assert locked().step([seen(7.0)], 1.1, IMAGE).confidence == 1.0


def test_idle_and_lost_report_no_box():
    tracker = locked()
    lost = tracker.step([], 20.0, IMAGE)
    for state in (TargetTracker().step(STEADY, 0.0, IMAGE), lost, tracker.stop(21.0)):
        assert (state.box, state.cov, state.vel_px_s, state.confidence) == (None, None, (0.0, 0.0), 0.0)
    assert tracker.step(STEADY, 22.0, IMAGE).reason is TargetReason.STOPPED


def test_a_coast_reports_the_moving_prediction_and_growing_covariance():
    states = play(lambda t: [seen(0.8, 60 * t)] if t <= 2 + EPS else [], 6.0)
    unseen = [s for s in states if s.t_s > 2 + EPS]
    assert all(b.box.cx_px >= a.box.cx_px for a, b in pairwise(unseen))
    assert all(b.cov[0, 0] > a.cov[0, 0] for a, b in pairwise(unseen))
    assert unseen[0].box.cx_px == pytest.approx(BOX.cx_px + 60 * unseen[0].t_s, abs=2.0)


def test_start_again_takes_a_new_target_and_its_clock():
    tracker = locked()
    state = tracker.start(Box(100.0, 100.0, 20.0, 20.0), 0.5)
    assert (state.t_s, state.status) == (0.5, ACQUIRING)
    assert astuple(state.box) == pytest.approx((100.0, 100.0, 20.0, 20.0))
    assert state.confidence == 0.0


def test_a_new_target_owes_nothing_to_the_sightings_of_the_old():
    tracker = TargetTracker()
    tracker.start(BOX, 0.0)
    for k in range(1, 6):  # almost confirmed
        tracker.step(STEADY, k / 30, IMAGE)
    tracker.start(BOX, 6 / 30)
    assert tracker.step(STEADY, 7 / 30, IMAGE).reason is TargetReason.CONFIRMING


# --- hint and shift


def test_hint_is_where_the_target_will_be():
    tracker = TargetTracker()
    assert tracker.hint() is None
    state = play(lambda t: [seen(0.8, 60 * t)], 2.0, 30.0, tracker)[-1]
    now, soon = tracker.hint(), tracker.hint(2.1)
    assert now.center_px == (state.box.cx_px, state.box.cy_px)
    assert now.cov_px2 == (state.cov[0, 0], state.cov[0, 1], state.cov[1, 1])
    assert soon.center_px[0] == pytest.approx(now.center_px[0] + 0.1 * state.vel_px_s[0])
    assert now.scale == 1.0
    assert tracker.hint(math.nan) == now
    tracker.stop(3.0)
    assert tracker.hint() is None


def test_hint_widens_with_the_ellipse_and_stays_in_the_picture():
    tracker = TargetTracker()
    scales = []
    play(leaving, 2.0, 30.0, tracker)
    for k in range(1, 70):
        tracker.step([], 2.0 + k / 10, IMAGE)
        hint = tracker.hint()
        assert 0 <= hint.center_px[0] <= IMAGE[0]
        scales.append(hint.scale)
    wide = [s for s in scales if s > 1.0]
    assert wide == sorted(wide)
    assert scales[0] == 1.0
    assert 1.5 < wide[-1] < MAX_HINT_SCALE


def test_hint_is_never_wider_than_the_tracker_can_search():
    tracker = TargetTracker(filter_config=FilterConfig(accel_sizes_s1_5=5.0))
    play(until(1, STEADY, []), 9.0, 30.0, tracker)
    scales = {tracker.hint().scale, (tracker.step([], 9.1, IMAGE), tracker.hint().scale)[1]}
    assert scales == {1.0, MAX_HINT_SCALE}


def test_shift_moves_box_and_run():
    tracker = locked()
    before = tracker.step(STEADY, 1.1, IMAGE).box
    assert tracker.shift(50.0, 0.0)
    after = tracker.step([seen(0.8, 50.0)], 1.2, IMAGE)
    assert after.reason is TargetReason.SEEN
    assert after.box.cx_px == pytest.approx(before.cx_px + 50.0, abs=1.0)
    assert not tracker.shift(math.nan, 0.0)
    assert not TargetTracker().shift(1.0, 0.0)
    # A search in progress moves along: the picture moves 3 sizes in each step and the run goes on.
    for k in range(4):
        tracker.shift(3 * SIZE_PX, 0.0)
        state = tracker.step([seen(0.8, 50.0 + 3 * SIZE_PX * (k + 1))], 5.0 + k / 10, IMAGE)
    assert state.status is LOCKED


# --- trouble


def fingerprint(tracker: TargetTracker) -> tuple[object, ...]:
    f = tracker._filter
    timers = (tracker._status, tracker._t_s, tracker._seen_s, tracker._start_s, tracker._score, tracker._image_size_px)
    run = tuple(sorted(vars(tracker._run).items(), key=str))
    return (*timers, run, f.t_s, f._kf.x.tobytes(), f._kf.P.tobytes())


@pytest.mark.parametrize("bad", BAD)
def test_a_time_or_image_that_is_not_finite_holds_everything(bad):
    tracker = locked()
    before = fingerprint(tracker)
    for t_s, image in ((bad, IMAGE), (1.1, (bad, 360.0)), (1.1, (640.0, bad)), (1.1, (0.0, 360.0))):
        state = tracker.step(STEADY, t_s, image)
        assert (state.status, state.reason, state.t_s) == (COASTING, TargetReason.NOT_FINITE, 1.0)
        assert fingerprint(tracker) == before
    assert tracker.step([seen(0.45)], 1.1, IMAGE).status is LOCKED


def test_a_time_that_went_back_holds_everything():
    tracker = locked()
    before = fingerprint(tracker)
    state = tracker.step(STEADY, 0.9, IMAGE)
    assert (state.status, state.reason, state.t_s) == (COASTING, TargetReason.TIME_WENT_BACK, 1.0)
    assert fingerprint(tracker) == before
    assert tracker.step(STEADY, 1.1, IMAGE).reason is TargetReason.SEEN


@pytest.mark.parametrize("bad", BAD)
def test_a_candidate_that_is_not_finite_is_no_candidate(bad):
    def spoiled(i: int) -> Candidate:
        values = [300.0, 200.0, 30.0, 60.0, 0.9, 0.9, 0.9]
        values[i] = bad
        return Candidate(Box(*values[:4]), *values[4:])

    twin = locked()
    twin.step([], 1.1, IMAGE)
    for i in range(7):
        tracker = locked()
        state = tracker.step([spoiled(i)], 1.1, IMAGE)
        assert (state.status, state.reason) == (COASTING, TargetReason.NOT_FINITE)
        assert fingerprint(tracker) == fingerprint(twin)
        assert tracker.step([spoiled(i), seen()], 1.2, IMAGE).reason is TargetReason.SEEN
    for i in range(7):
        tracker = TargetTracker()
        play(until(1, STEADY, []), 3.0, 30.0, tracker)
        assert tracker.step([spoiled(i)], 3.1, IMAGE).reason is TargetReason.NOT_FINITE


@pytest.mark.parametrize("bad", BAD)
def test_start_raises_and_stop_never_does(bad):
    tracker = locked()
    before = fingerprint(tracker)
    with pytest.raises(ValueError, match="start"):
        tracker.start(Box(bad, 0, 10, 10), 0.0)
    with pytest.raises(ValueError, match="time"):
        tracker.start(BOX, bad)
    assert fingerprint(tracker) == before
    state = tracker.stop(bad)
    assert (state.status, state.reason, state.t_s) == (IDLE, TargetReason.STOPPED, 1.0)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("lock_score", 1.5),
        ("drop_score", 0.9),  # above lock_score
        ("confirm_s", 2.0),  # above acquire_s
        ("acquire_s", math.nan),
        ("coast_s", 6.0),
        ("reacquire_s", -1.0),
        ("give_up_s", 1.0),  # below coast_s
        ("search_half_sizes", 0.0),
    ],
)
def test_config_names_field_and_value(field, value):
    with pytest.raises(ValueError, match=rf"target {field} is {value}, must lie in"):
        TargetConfig(**{field: value})


# --- whatever happens

numbers = st.one_of(st.sampled_from(BAD), st.floats(-2e3, 2e3))
boxes = st.builds(Box, st.floats(200, 400), st.floats(100, 300), st.floats(20, 40), st.floats(40, 80))
any_boxes = st.builds(Box, numbers, numbers, numbers, numbers)
candidates = st.one_of(
    st.builds(seen, st.floats(0.2, 1.0), st.floats(-8, 8), st.floats(-8, 8)),
    st.builds(Candidate, boxes, st.floats(0, 1), st.floats(0, 1), st.floats(0, 1)),
    st.builds(Candidate, any_boxes, numbers, numbers, numbers),
)


class AnyLoop(RuleBasedStateMachine):
    """Random candidates, clocks and starts; the invariants are what control relies on."""

    def __init__(self) -> None:
        super().__init__()
        self.config = TargetConfig()
        self.tracker = TargetTracker(self.config)
        self.now = 0.0
        self.last_fit = -math.inf
        self.state = self.tracker.step([], 0.0, IMAGE)

    @rule()
    def start(self) -> None:
        self.last_fit = self.now
        self.state = self.tracker.start(BOX, self.now)

    @precondition(lambda self: self.state.status is not IDLE)
    @rule()
    def stop(self) -> None:
        self.state = self.tracker.stop(self.now)

    @rule(found=st.lists(candidates, max_size=3), dt=st.sampled_from((0.0, 0.01, 1 / 30, 0.1, 0.3, 1.0)))
    def step(self, found: list[Candidate], dt: float) -> None:
        self.advance(found, dt)

    @rule(found=st.builds(seen, st.floats(0.5, 1.0)), n=st.integers(1, 10))
    def steps_that_see(self, found: Candidate, n: int) -> None:
        for _ in range(n):
            self.advance([found], 0.05)

    @rule(n=st.integers(1, 40))
    def steps_that_do_not(self, n: int) -> None:
        for _ in range(n):
            self.advance([], 0.1)

    @rule(t_s=st.sampled_from((*BAD, -5.0)), found=st.lists(candidates, max_size=2))
    def bad_clock(self, t_s: float, found: list[Candidate]) -> None:
        before = self.tracker._status
        self.state = self.tracker.step(found, t_s, IMAGE)
        assert self.tracker._status is before
        assert self.state.status is not LOCKED

    def advance(self, found: list[Candidate], dt: float) -> None:
        self.now += dt
        finite = [c for c in found if c.box.is_valid and math.isfinite(c.score + c.peak + c.similarity)]
        if any(c.score >= self.config.drop_score for c in finite):
            self.last_fit = self.now
        self.state = self.tracker.step(found, self.now, IMAGE)
        self.check_times()

    def check_times(self) -> None:
        absent_s = self.now - self.last_fit
        status = self.state.status
        assert not (status is LOCKED and absent_s > 0)  # the design allows 0.7 s
        assert not (status in (ACQUIRING, COASTING) and absent_s > 1.5)
        assert not (status is SEARCHING and absent_s > 10.0)

    @invariant()
    def the_report_is_sound(self) -> None:
        s = self.state
        assert (s.box is None) == (s.cov is None) == (s.status in (IDLE, LOST))
        assert math.isfinite(s.t_s)
        assert 0.0 <= s.confidence <= 1.0
        assert all(math.isfinite(v) for v in (*s.vel_px_s, s.growth_per_s))
        if s.box is not None:
            assert s.box.is_valid
            assert np.array_equal(s.cov, s.cov.T)
            assert np.linalg.eigvalsh(s.cov)[0] > 0
        hint = self.tracker.hint(self.now + 0.05)
        assert (hint is None) == (s.status in (IDLE, LOST))
        if hint is not None:
            assert all(math.isfinite(v) for v in (*hint.center_px, *hint.cov_px2))
            assert 1.0 <= hint.scale <= MAX_HINT_SCALE


AnyLoop.TestCase.settings = settings(derandomize=True, max_examples=50, stateful_step_count=25, deadline=None)
TestAnyLoop = AnyLoop.TestCase


def test_searches_alternate_between_the_targets_scale_and_the_ellipse():
    tracker = locked()
    scales = []
    for k in range(31, 31 + 120):
        state = tracker.step([], k / 30, IMAGE)
        if state.status is SEARCHING:
            scales.append(tracker.hint().scale)
    narrow, wide = scales[0::2], scales[1::2]
    if narrow[0] != 1.0:
        narrow, wide = wide, narrow
    assert set(narrow) == {1.0}
    assert min(wide) > 1.0
    assert wide == sorted(wide)


def test_a_search_that_found_something_is_not_changed():
    tracker = locked()
    k = 31
    while tracker.step([], k / 30, IMAGE).status is not SEARCHING or tracker.hint().scale != 1.0:
        k += 1
    for _ in range(3):
        k += 1
        assert tracker.step(STEADY, k / 30, IMAGE).reason is TargetReason.CONFIRMING
        assert tracker.hint().scale == 1.0
