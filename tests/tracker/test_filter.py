"""The box filter: consistent with its own noise model, blind to what is not finite, bounded without measurements."""

import math
from dataclasses import astuple, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tracker.agreement import AgreeingRun
from tracker.box import Box
from tracker.filter import (
    CAP_GROWTH_S,
    CAP_LN_SIZE,
    CAP_POS_SIZES,
    CAP_VEL_SIZES_S,
    COAST_GRACE_S,
    GATE_NIS,
    MAX_DT_S,
    MIN_SIZE_PX,
    START_GROWTH_S,
    START_LN_SIZE,
    START_POS_SIZES,
    START_VEL_SIZES_S,
    BoxFilter,
    FilterConfig,
    PredictReason,
    UpdateReason,
)
from tracker.messages import Array

BOX = Box(300.0, 200.0, 30.0, 60.0)
SIZE_PX = math.sqrt(30.0 * 60.0)
CHI2_4_95 = 9.487729
BAD = (math.nan, math.inf, -math.inf)


def started(config: FilterConfig | None = None, box: Box = BOX, t_s: float = 0.0) -> BoxFilter:
    f = BoxFilter(config)
    f.start(box, t_s)
    return f


def moved(box: Box, dx: float, dy: float = 0.0) -> Box:
    return Box(box.cx_px + dx, box.cy_px + dy, box.w_px, box.h_px)


def follow(f: BoxFilter, vel_px_s: float, until_s: float, fps: float, score: float = 0.9) -> None:
    """Noiseless measurements of a target that moves right, from the filter's own time and the box of the start."""
    for k in range(1, round(until_s * fps) + 1):
        f.predict(k / fps)
        assert f.update(moved(BOX, vel_px_s * k / fps), score).accepted


def fingerprint(f: BoxFilter) -> tuple[object, ...]:
    return (
        f.t_s,
        f._updated_s,
        f._kf.x.tobytes(),
        f._kf.P.tobytes(),
        tuple(sorted(vars(f._outliers).items(), key=str)),
    )


# --- consistency


def simulate(config: FilterConfig, seed: int, fps: float, steps: int, score: float) -> tuple[list[float], list[float]]:
    """NIS and NEES of one run on a truth made by fine integration of acceleration and both shakes, not by F and Q.

    All noises scale with the true size, as those of the filter do with the size that it estimates.
    """
    rng = np.random.default_rng(seed)

    def scaled(pos_sizes: float, ln_size: float, x: Array) -> Array:
        size_px = math.exp((x[2] + x[3]) / 2)
        return np.array([pos_sizes * size_px, pos_sizes * size_px, ln_size, ln_size])

    pos_sigma = config.pos_sigma_best**score * config.pos_sigma_worst ** (1 - score)
    ln_sigma = config.ln_size_sigma_best**score * config.ln_size_sigma_worst ** (1 - score)
    x = np.array([BOX.cx_px, BOX.cy_px, math.log(BOX.w_px), math.log(BOX.h_px)])
    rate = rng.normal(size=4) * scaled(START_VEL_SIZES_S, START_GROWTH_S, x)
    x = x + rng.normal(size=4) * scaled(START_POS_SIZES, START_LN_SIZE, x)
    f, substeps = started(config), 10
    nis, nees = [], []
    for k in range(1, steps + 1):
        dt = 1 / fps / substeps
        for shake, accel in rng.normal(size=(substeps, 2, 4)) * math.sqrt(dt):
            x = x + rate * dt + shake * scaled(config.shake_sizes_s0_5, config.size_shake_s0_5, x)
            rate = rate + accel * scaled(config.accel_sizes_s1_5, config.growth_accel_s1_5, x)
        f.predict(k / fps)
        z = x + rng.normal(size=4) * scaled(pos_sigma, ln_sigma, x)
        found = f.update(Box(z[0], z[1], math.exp(z[2]), math.exp(z[3])), score)
        b = f.box
        error = x - np.array([b.cx_px, b.cy_px, math.log(b.w_px), math.log(b.h_px)])
        nis.append(found.nis)
        nees.append(float(error @ np.linalg.solve(f.cov, error)))
    return nis, nees


# The noises as configured, and a size that is known well: what scales with it is then known as well.
NOISES = {
    "default": FilterConfig(gate_nis=1000.0),
    "well known size": FilterConfig(
        growth_accel_s1_5=0.05, size_shake_s0_5=0.05, ln_size_sigma_best=0.01, ln_size_sigma_worst=0.1, gate_nis=1000.0
    ),
}


# A second and a little: over longer the shakes as configured make a size that no picture holds.
@pytest.mark.parametrize(("fps", "score", "steps", "seeds"), [(30.0, 0.9, 36, 30), (10.0, 0.6, 12, 80)])
@pytest.mark.parametrize("noise", NOISES)
def test_nis_and_nees_are_chi_square(noise, fps, score, steps, seeds):
    runs = [simulate(NOISES[noise], seed, fps, steps, score) for seed in range(seeds)]
    nis, nees = np.array([r[0] for r in runs]), np.array([r[1] for r in runs])
    bound = 4 * math.sqrt(2 * 4 / nis.size)  # innovations are white: 4 sigma of the mean of independent chi-squares
    assert abs(nis.mean() - 4.0) < bound + 0.1  # 0.1: the size is estimated
    assert 0.90 <= (nis < CHI2_4_95).mean() <= 0.99
    per_run = nees.mean(axis=1)  # errors of one run are correlated, runs are not
    assert abs(per_run.mean() - 4.0) < 4 * per_run.std(ddof=1) / math.sqrt(len(per_run)) + 0.1


def test_nis_is_the_quadratic_form_of_the_stated_innovation():
    f = started()
    f.predict(0.1)
    found = f.innovation(moved(BOX, 5.0, -3.0), 1.0)
    c = FilterConfig()
    sigma2 = np.repeat([(c.pos_sigma_best * SIZE_PX) ** 2, c.ln_size_sigma_best**2], 2)
    y = np.array([5.0, -3.0, 0.0, 0.0])
    assert found.y == pytest.approx(tuple(y), abs=1e-9)
    assert found.nis == pytest.approx(y @ np.linalg.inv(f.cov + np.diag(sigma2)) @ y, rel=1e-9)


def test_lower_scores_weigh_less():
    def pull(score: float) -> float:
        f = started()
        f.predict(0.03)
        f.update(moved(BOX, 4.0), score)
        return f.box.cx_px - BOX.cx_px

    pulls = [pull(s) for s in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)]
    assert pulls == sorted(pulls)
    assert pulls[0] < 0.5 * pulls[-1]
    assert pull(7.0) == pulls[-1]
    assert pull(-7.0) == pulls[0]


@pytest.mark.parametrize("factor", [0.25, 4.0])
def test_a_setting_means_the_same_at_every_resolution(factor):
    small, large = started(), started(box=Box(*(factor * v for v in (300.0, 200.0, 30.0, 60.0))))
    for k in range(1, 60):
        for f, scale in ((small, 1.0), (large, factor)):
            f.predict(k / 30)
            b = moved(BOX, 20.0 * math.sin(k / 10))
            f.update(Box(scale * b.cx_px, scale * b.cy_px, scale * b.w_px, scale * b.h_px), 0.7)
    assert large.box.cx_px == pytest.approx(factor * small.box.cx_px, rel=1e-9)
    assert large.cov[0, 0] == pytest.approx(factor**2 * small.cov[0, 0], rel=1e-9)
    assert large.cov[2, 2] == pytest.approx(small.cov[2, 2], rel=1e-9)


# --- time


@given(st.lists(st.floats(1e-7, 0.3), min_size=1, max_size=12))
@settings(derandomize=True, max_examples=50, deadline=None)
def test_many_steps_equal_one(steps):
    """Exact discretisation: across the grace and the decay, irregular steps end where a single one does."""
    total = min(sum(steps), MAX_DT_S)
    a, b = started(), started()
    for f in (a, b):
        follow(f, 60.0, 1.0, 5.0)
    t = 1.0
    for dt in steps:
        t = min(t + dt, 1.0 + total)
        a.predict(t)
    b.predict(t)
    assert a.box.cx_px == pytest.approx(b.box.cx_px, rel=1e-9)
    assert a.vel_px_s == pytest.approx(b.vel_px_s, rel=1e-6, abs=1e-9)
    assert np.allclose(a.cov, b.cov, rtol=2e-3, atol=1e-9)


def test_irregular_frames_follow_like_regular_ones():
    rng = np.random.default_rng(3)
    regular, irregular = started(), started()
    follow(regular, 80.0, 3.0, 30.0)
    times = np.sort(np.append(rng.uniform(0.01, 3.0, 89), 3.0))
    for t in times:
        irregular.predict(float(t))
        irregular.update(moved(BOX, 80.0 * float(t)), 0.9)
    assert irregular.box.cx_px == pytest.approx(regular.box.cx_px, abs=0.5)
    assert irregular.vel_px_s[0] == pytest.approx(regular.vel_px_s[0], rel=0.02)


def test_10_20_and_30_hz_agree():
    ends = []
    for fps in (10.0, 20.0, 30.0):
        f = started()
        follow(f, 80.0, 3.0, fps)
        ends.append((f.box.cx_px, f.vel_px_s[0]))
        assert f.box.cx_px == pytest.approx(BOX.cx_px + 240.0, abs=0.5)
        assert f.vel_px_s[0] == pytest.approx(80.0, rel=0.06)
        f.predict(4.0)
        ends[-1] += (f.box.cx_px,)
    assert np.ptp(np.array(ends), axis=0) == pytest.approx(0.0, abs=2.0)


def test_predict_says_what_it_did():
    f = started(t_s=5.0)
    assert f.predict(5.0) is PredictReason.NO_TIME
    assert f.predict(5.1) is PredictReason.MOVED
    assert f.t_s == 5.1
    before = fingerprint(f)
    assert f.predict(5.0) is PredictReason.TIME_WENT_BACK
    assert fingerprint(f) == before


def test_a_long_gap_is_capped():
    f, g = started(), started()
    follow(f, 60.0, 1.0, 30.0)
    follow(g, 60.0, 1.0, 30.0)
    assert f.predict(1000.0) is PredictReason.DT_CAPPED
    assert g.predict(1.0 + MAX_DT_S) is PredictReason.MOVED
    assert f.t_s == 1000.0
    assert f.box == g.box
    assert f.predict(1e308) is PredictReason.DT_CAPPED
    assert f.box.is_valid


# --- coasting


def test_velocity_is_full_within_the_grace_then_decays_and_the_way_is_bounded():
    f = started()
    follow(f, 60.0, 2.0, 30.0)
    v0, x0 = f.vel_px_s[0], f.box.cx_px
    f.predict(2.0 + COAST_GRACE_S)
    assert f.vel_px_s[0] == v0
    assert f.box.cx_px == pytest.approx(x0 + v0 * COAST_GRACE_S)
    f.predict(3.0 + COAST_GRACE_S)
    assert f.vel_px_s[0] == pytest.approx(v0 * math.exp(-1.0))  # coast_tau_s is 1 s
    for k in range(1, 200):
        f.predict(3.0 + COAST_GRACE_S + k)
    assert f.box.cx_px <= x0 + v0 * (COAST_GRACE_S + 1.0) + 1e-6
    assert f.vel_px_s[0] == pytest.approx(0.0, abs=1e-6)


def test_growth_stops_sooner_than_motion():
    f = started()
    for k in range(1, 61):
        f.predict(k / 10)
        grown = math.exp(0.3 * k / 10)
        f.update(Box(300.0 + 6 * k, 200.0, 30.0 * grown, 60.0 * grown), 0.9)
    growth, velocity = f.growth_per_s, f.vel_px_s[0]
    assert growth == pytest.approx(0.3, rel=0.1)
    f.predict(7.0)
    assert f.growth_per_s / growth < 0.5 * f.vel_px_s[0] / velocity


def test_covariance_grows_while_coasting_up_to_its_cap():
    f = started()
    follow(f, 60.0, 1.0, 30.0)
    last = 0.0
    for k in range(1, 40):
        f.predict(1.0 + k / 10)
        assert f.cov[0, 0] > last
        last = f.cov[0, 0]
    for k in range(2000):
        f.predict(10.0 + k)
    size_px = math.sqrt(f.box.w_px * f.box.h_px)
    caps = np.repeat([CAP_POS_SIZES * size_px, CAP_LN_SIZE, CAP_VEL_SIZES_S * size_px, CAP_GROWTH_S], 2)
    assert np.all(np.sqrt(np.diag(f._kf.P)) <= caps * (1 + 1e-9))
    assert f.cov[0, 0] == pytest.approx(caps[0] ** 2, rel=1e-6)


# --- gate


def test_the_gate_refuses_a_jump_and_keeps_the_state():
    f = started()
    follow(f, 0.0, 1.0, 30.0)
    f.predict(1.03)
    x, p = f._kf.x.copy(), f._kf.P.copy()
    found = f.update(moved(BOX, 3 * SIZE_PX), 0.9)
    assert (found.reason, found.gated, found.accepted) == (UpdateReason.OUTSIDE_GATE, True, False)
    assert found.nis > GATE_NIS
    assert np.array_equal(f._kf.x, x)
    assert np.array_equal(f._kf.P, p)


@pytest.mark.parametrize("fps", [10.0, 20.0, 30.0])
@pytest.mark.parametrize("jump_sizes", [3.0, 12.0, 1000.0])
def test_a_real_jump_is_followed_after_the_same_time_at_every_rate(fps, jump_sizes):
    f = started()
    follow(f, 0.0, 1.0, fps)
    there, reasons = moved(BOX, jump_sizes * SIZE_PX), []
    for k in range(1, round(1.0 * fps) + 1):
        f.predict(1.0 + k / fps)
        reasons.append(f.update(there, 0.9).reason)
    first = next(i for i, r in enumerate(reasons) if r is not UpdateReason.OUTSIDE_GATE)
    assert first / fps <= 0.4 + 1e-6
    if jump_sizes > 10:
        assert reasons[first] is UpdateReason.RELOCATED
        assert first / fps >= 0.4 - 1 / fps
    assert all(r is UpdateReason.INSIDE_GATE for r in reasons[first + 1 :])
    assert abs(f.box.cx_px - there.cx_px) < 0.2 * SIZE_PX


def test_outliers_that_do_not_agree_never_open_the_gate():
    f = started()
    follow(f, 0.0, 1.0, 30.0)
    rng = np.random.default_rng(1)
    for k in range(1, 31):
        f.predict(1.0 + k / 30)
        far = rng.choice([-1, 1], size=2) * rng.uniform(12, 40, size=2) * SIZE_PX
        assert f.update(moved(BOX, *far), 0.9).reason is UpdateReason.OUTSIDE_GATE
    assert f.box.cx_px == pytest.approx(BOX.cx_px, abs=1.0)


def test_an_outlier_run_ends_with_an_accepted_measurement():
    f = started()
    follow(f, 0.0, 1.0, 30.0)
    for k in range(1, 61):
        f.predict(1.0 + k / 30)
        outlier = k % 5 != 0
        found = f.update(moved(BOX, 15 * SIZE_PX) if outlier else BOX, 0.9)
        assert found.accepted is not outlier


def test_a_new_start_forgets_the_outliers():
    f = started()
    for k in range(1, 12):  # agreeing outliers for 0.37 s: the next would open the gate
        f.predict(k / 30)
        f.update(moved(BOX, 400.0), 0.9)
    f.start(BOX, 12 / 30)
    f.predict(13 / 30)
    assert f.update(moved(BOX, 400.0), 0.9).reason is UpdateReason.OUTSIDE_GATE


def test_the_size_stays_one_that_a_picture_can_hold():
    f = started()
    for k in range(1, 40):  # shrinks fast, then is not seen while the growth goes on
        f.predict(k / 30)
        side = max(0.6, 30.0 * math.exp(-0.15 * k))
        f.update(Box(BOX.cx_px, BOX.cy_px, side, side), 1.0)
    for k in range(40, 80):
        f.predict(k / 30)
        assert min(f.box.w_px, f.box.h_px) >= MIN_SIZE_PX - 1e-9


def test_runs_need_number_time_place_size_and_no_gap():
    def lasts(boxes: list[Box], dt: float, span: float) -> bool:
        run = AgreeingRun()
        for k, box in enumerate(boxes):
            run.add(box, k * dt)
        return run.lasted(span)

    assert lasts([BOX] * 3, 0.1, 0.2)
    assert not lasts([BOX] * 2, 0.4, 0.2)
    assert not lasts([BOX] * 3, 0.05, 0.2)
    assert not lasts([BOX] * 3, 0.6, 0.2)
    assert not lasts([BOX, BOX, moved(BOX, 0.8 * SIZE_PX)], 0.1, 0.2)
    assert lasts([BOX, BOX, moved(BOX, 0.6 * SIZE_PX)], 0.1, 0.2)
    assert not lasts([BOX, BOX, Box(300, 200, 30, 120)], 0.1, 0.2)


# --- the shakes of centre and size


@pytest.mark.parametrize(("setting", "axis"), [("shake_sizes_s0_5", 0), ("size_shake_s0_5", 2)])
def test_a_shake_adds_its_square_per_second_until_the_coast_begins_and_no_more(setting, axis):
    quiet = FilterConfig(shake_sizes_s0_5=0.0, size_shake_s0_5=0.0)
    shaken = replace(quiet, **{setting: 0.8})
    scale = SIZE_PX if axis == 0 else 1.0

    def added(t_s: float) -> np.ndarray:
        covs = [(f := started(c), f.predict(t_s), f.cov)[-1] for c in (quiet, shaken)]
        return np.diag(covs[1] - covs[0])

    for t_s in (0.05, COAST_GRACE_S):
        assert added(t_s)[axis] == pytest.approx(0.64 * scale**2 * t_s, rel=1e-6)
        assert added(t_s)[[i for i in range(4) if i // 2 != axis // 2]] == pytest.approx(0.0, abs=1e-9)
    assert added(2.0)[axis] == pytest.approx(0.64 * scale**2 * COAST_GRACE_S, rel=1e-3)


def test_a_shaking_size_follows_the_box_and_has_no_growth():
    """What shakes to and fro is in the size at once and hardly in its rate."""
    steady, shaken = (started(FilterConfig(size_shake_s0_5=v)) for v in (0.0, 1.0))
    for k in range(1, 41):
        zoom = 1.15 if k % 2 else 1 / 1.15
        for f in (steady, shaken):
            f.predict(k / 20)
            f.update(Box(300.0, 200.0, 30.0 * zoom, 60.0 * zoom), 1.0)
    assert abs(math.log(shaken.box.w_px / 30.0)) > 3 * abs(math.log(steady.box.w_px / 30.0))
    assert abs(shaken.growth_per_s) < 0.3


# --- what the target's estimate asks for beside measurements


def test_a_halted_target_rests_where_it_is():
    f = started()
    follow(f, 60.0, 1.0, 30.0)
    before = f.box
    f.halt()
    assert (f.vel_px_s, f.growth_per_s) == ((0.0, 0.0), 0.0)
    f.predict(2.5)
    assert f.box == before


def test_nudge_takes_place_and_size_and_keeps_the_motion():
    f = started()
    follow(f, 60.0, 1.0, 30.0)
    velocity, growth, t_s = f.vel_px_s, f.growth_per_s, f.t_s
    f.nudge(Box(100.0, 120.0, 20.0, 20.0))
    assert astuple(f.box) == pytest.approx((100.0, 120.0, 20.0, 20.0))
    assert (f.vel_px_s, f.growth_per_s, f.t_s) == (velocity, growth, t_s)
    assert np.diag(f.cov) == pytest.approx(np.repeat([(START_POS_SIZES * 20.0) ** 2, START_LN_SIZE**2], 2))
    p = f.state().p
    assert np.array_equal(p, p.T)
    assert np.linalg.eigvalsh(p)[0] > 0
    f.predict(1.1)
    assert f.box.cx_px == pytest.approx(100.0 + 0.1 * velocity[0])


def test_a_nudge_forgets_the_outliers():
    f = started()
    for k in range(1, 12):  # agreeing outliers for 0.37 s: the next would open the gate
        f.predict(k / 30)
        f.update(moved(BOX, 800.0), 0.9)
    f.nudge(BOX)
    f.predict(12 / 30)
    assert f.update(moved(BOX, 800.0), 0.9).reason is UpdateReason.OUTSIDE_GATE


@pytest.mark.parametrize("box", [Box(math.nan, 0, 9, 9), Box(0, math.inf, 9, 9), Box(1e9, 0, 9, 9), Box(0, 0, 0.1, 9)])
def test_a_nudge_that_cannot_be_changes_nothing(box):
    f = started()
    follow(f, 60.0, 1.0, 30.0)
    f.predict(1.1)
    f.update(moved(BOX, 20 * SIZE_PX), 0.9)  # an outlier run is under way
    before = fingerprint(f)
    with pytest.raises(ValueError, match="cannot be taken"):
        f.nudge(box)
    assert fingerprint(f) == before


def test_rewind_takes_back_what_was_measured_since_and_resize_only_the_size():
    f, untouched = started(), started()
    for g in (f, untouched):
        follow(g, 60.0, 1.0, 30.0)
    kept = f.state()
    for k in range(1, 10):
        f.predict(1.0 + k / 30)
        f.update(Box(360.0, 200.0, 30.0 - 2 * k, 60.0), 0.9)
    shrunk = f.box
    untouched.predict(1.3)
    g = started()
    g.rewind(f.state())
    g.resize(kept)
    assert (g.box.w_px, g.box.h_px) == pytest.approx((30.0, 60.0), rel=0.02)
    assert (g.box.cx_px, g.growth_per_s) == (shrunk.cx_px, 0.0)
    f.rewind(kept)
    assert f.t_s == 1.3
    assert astuple(f.box) == pytest.approx(astuple(untouched.box))
    assert f.vel_px_s == pytest.approx(untouched.vel_px_s)
    assert np.allclose(f.cov, untouched.cov)


def test_the_likelihood_is_that_of_a_gaussian_and_means_the_same_at_every_size():
    f = started()
    f.predict(0.1)
    box = Box(306.0, 197.0, 33.0, 60.0)
    sigma2 = np.repeat([(FilterConfig().pos_sigma_best * SIZE_PX) ** 2, FilterConfig().ln_size_sigma_best ** 2], 2)
    s = f.cov + np.diag(sigma2)
    expected = -0.5 * (f.innovation(box, 1.0).nis + np.linalg.slogdet(s)[1]) + 2 * math.log(SIZE_PX)
    assert f.log_likelihood(box, 1.0) == pytest.approx(expected)
    large = started(box=Box(*(4 * v for v in astuple(BOX))))
    large.predict(0.1)
    assert large.log_likelihood(Box(*(4 * v for v in astuple(box))), 1.0) == pytest.approx(expected)
    assert f.log_likelihood(Box(math.nan, 197.0, 33.0, 60.0), 1.0) == -math.inf
    assert f.log_likelihood(box, math.nan) == -math.inf


# --- what is not finite


@pytest.mark.parametrize("bad", BAD)
def test_nothing_that_is_not_finite_changes_a_bit(bad):
    f = started()
    follow(f, 40.0, 1.0, 30.0)
    f.predict(1.1)
    f.update(moved(BOX, 20 * SIZE_PX), 0.9)  # an outlier run is under way
    before = fingerprint(f)
    for i in range(4):
        values = [300.0, 200.0, 30.0, 60.0]
        values[i] = bad
        refused = f.update(Box(*values), 0.9)
        assert (refused.reason, refused.accepted, refused.gated) == (UpdateReason.NOT_FINITE, False, False)
        assert (refused.nis, refused.y) == (None, None)
    assert f.update(BOX, bad).reason is UpdateReason.NOT_FINITE
    assert f.predict(bad) in (PredictReason.NOT_FINITE, PredictReason.TIME_WENT_BACK)
    assert not f.shift(bad, 0.0)
    assert not f.shift(0.0, bad)
    assert f.ahead(bad)[0] == f.box
    assert fingerprint(f) == before


@pytest.mark.parametrize("box", [Box(1e9, 0, 10, 10), Box(0, 0, 1e200, 10), Box(0, 0, 10, 0.0), Box(0, 0, -1, 10)])
def test_finite_but_impossible_boxes_are_refused(box):
    f = started()
    before = fingerprint(f)
    assert f.update(box, 0.9).reason is UpdateReason.NOT_FINITE
    assert fingerprint(f) == before
    with pytest.raises(ValueError, match="cannot start"):
        f.start(box, 0.0)


@pytest.mark.parametrize("bad", BAD)
def test_start_refuses_what_is_not_finite_and_keeps_the_old_target(bad):
    f = started()
    before = fingerprint(f)
    with pytest.raises(ValueError, match="start"):
        f.start(Box(bad, 0, 10, 10), 0.0)
    with pytest.raises(ValueError, match="time"):
        f.start(BOX, bad)
    assert fingerprint(f) == before


def test_everything_before_start_is_a_programmers_error():
    f = BoxFilter()
    for call in (
        lambda: f.predict(0.0),
        lambda: f.update(BOX, 1.0),
        lambda: f.box,
        lambda: f.cov,
        lambda: f.ahead(1.0),
        lambda: f.nudge(BOX),
        lambda: f.halt(),
    ):
        with pytest.raises(RuntimeError, match="not started"):
            call()


# --- long runs and small hooks


def test_covariance_stays_positive_over_1500_steps_with_random_misses():
    rng = np.random.default_rng(7)
    f, t = started(), 0.0
    for k in range(1_500):
        t += float(rng.choice([1e-6, 0.01, 0.033, 0.1, 0.5]))
        f.predict(t)
        if rng.random() < 0.6:
            noise = rng.normal(size=4) * np.array([3.0, 3.0, 0.1, 0.1])
            box = Box(300 + noise[0], 200 + noise[1], 30 * math.exp(noise[2]), 60 * math.exp(noise[3]))
            f.update(box, float(rng.random()))
        if k % 20 == 0:
            assert np.array_equal(f._kf.P, f._kf.P.T)
            scale = 1 / np.sqrt(np.diag(f._kf.P))
            assert np.linalg.eigvalsh(f._kf.P * np.outer(scale, scale))[0] > -1e-10
            assert f.box.is_valid
    assert abs(f.box.cx_px - 300) < 300


def test_shift_moves_the_mean_only():
    f = started()
    follow(f, 40.0, 1.0, 30.0)
    x, p, v = f.box, f.cov, f.vel_px_s
    assert f.shift(7.0, -3.0)
    assert f.box == Box(x.cx_px + 7.0, x.cy_px - 3.0, x.w_px, x.h_px)
    assert np.array_equal(f.cov, p)
    assert f.vel_px_s == v


def test_ahead_is_what_predict_would_give_and_changes_nothing():
    f = started()
    follow(f, 40.0, 1.0, 30.0)
    before = fingerprint(f)
    box, cov = f.ahead(1.6)
    assert fingerprint(f) == before
    f.predict(1.6)
    assert box == f.box
    assert np.allclose(cov, f.cov, rtol=1e-12)
    assert f.ahead(1.0)[0] == f.box


def test_cov_is_a_copy():
    f = started()
    f.cov[:] = math.nan
    assert np.isfinite(f.cov).all()


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("accel_sizes_s1_5", 0.0),
        ("shake_sizes_s0_5", -0.1),
        ("size_shake_s0_5", -0.1),
        ("size_shake_s0_5", math.nan),
        ("growth_accel_s1_5", math.nan),
        ("pos_sigma_best", -1.0),
        ("pos_sigma_worst", 0.01),  # below best
        ("ln_size_sigma_best", math.inf),
        ("ln_size_sigma_worst", 0.01),
        ("gate_nis", 0.0),
        ("coast_tau_s", 0.0),
        ("coast_size_tau_s", -1.0),
        ("relocate_s", math.nan),
    ],
)
def test_config_names_field_and_value(field, value):
    with pytest.raises(ValueError, match=rf"filter {field} is {value}, must lie in"):
        FilterConfig(**{field: value})
