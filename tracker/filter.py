"""Kalman filter of the target's box: constant velocity while seen, decaying velocity while coasting.

State x = (cx_px, cy_px, ln w, ln h) and the rate of each per second; a measurement z is a box as its first four.

    predict   x- = F x,         P- = F P F' + Q         prior; F and Q are built for the measured dt
    update    y  = z - H x-,    S  = H P- H' + R        innovation and its covariance
              NIS = y' S^-1 y                           normalised innovation squared, chi-square of 4 dof
              K  = P- H' S^-1,  x = x- + K y            posterior, covariance in Joseph form (filterpy)

Q is continuous white-noise acceleration, and until the coast begins white-noise velocity of the centre: the shake of
the camera, which no velocity predicts and which over a longer time goes to and fro and adds nothing. Densities are per
second, so the frame rate does not enter. Q and R scale with the target's size sqrt(w h), so a setting means the same at
every resolution and distance. The logarithm keeps sizes positive and makes a growth rate of one meaning at all sizes.
Nothing that is not finite ever reaches filterpy, which would keep it for ever without a word.

Lock-out. A gate may shut out the truth after a real jump. Two things reopen it: P grows while nothing is accepted, and
outliers that agree among themselves for `relocate_s` open it at once: y_i^2 is added to each variance of the box, which
bounds the NIS by 4, and the rates become as unsure as at the start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np
from filterpy.kalman import KalmanFilter

from tracker.agreement import AgreeingRun
from tracker.box import Box
from tracker.messages import Array

GATE_NIS = 18.47  # chi-square, 4 degrees of freedom, 99.9 %: a true measurement is refused once in 1000
MAX_DT_S = 5.0  # the longest coast; the covariance is useless beyond, so a longer gap is integrated only this far
COAST_GRACE_S = 0.25  # full velocity this long after a measurement: trackers down to 4 FPS see an undistorted model
MIN_SIZE_PX, MAX_SIZE_PX = 0.5, 1e5  # outside of these no picture holds a target
MAX_COORD_PX = 1e6  # far outside any picture; keeps squares of innovations far from overflow

START_POS_SIZES, START_LN_SIZE = 0.1, 0.1  # one sigma of a box drawn by hand, or found again
START_VEL_SIZES_S, START_GROWTH_S = 2.0, 0.5  # one sigma of what a new target may be doing
CAP_POS_SIZES, CAP_LN_SIZE = 20.0, 1.0  # caps of one sigma: "anywhere in the picture", "a factor of e"
CAP_VEL_SIZES_S, CAP_GROWTH_S = 20.0, 3.0  # above these the direction of the motion is unknown anyway

SERIES_BELOW = 1e-3  # dt/tau below which the exact Q_xx loses digits to cancellation and equals the undamped one


def check_range(owner: str, name: str, value: float, low: float, high: float) -> None:
    """Raise ValueError naming field, value and range unless low <= value <= high (NaN never is)."""
    if not low <= value <= high:
        raise ValueError(f"{owner} {name} is {value}, must lie in {low:g}..{high:g}")


def usable_box(box: Box) -> bool:
    """Whether a box may enter the filter: finite, positive, and of a place and size that a picture can hold."""
    sizes = all(MIN_SIZE_PX <= v <= MAX_SIZE_PX for v in (box.w_px, box.h_px))
    return sizes and abs(box.cx_px) <= MAX_COORD_PX and abs(box.cy_px) <= MAX_COORD_PX


@dataclass(frozen=True, slots=True)
class FilterConfig:
    """Noise and coasting of `BoxFilter`. "sizes" are target sizes sqrt(w h); all noises are one sigma.

    `accel_sizes_s1_5` and `growth_accel_s1_5` are square roots of acceleration densities: by how much the velocity
    (sizes/s) and the growth of ln(size) (1/s) wander in one second; `shake_sizes_s0_5` that of a velocity: how far the
    centre itself is shaken about in one second (sizes), `size_shake_s0_5` the same of ln(size). `pos_sigma_*` (sizes)
    and `ln_size_sigma_*` are the measurement noise at score 1 (`_best`) and score 0 (`_worst`), geometric between.
    `coast_tau_s` and `coast_size_tau_s` are the time constants by which velocity and growth decay while nothing is
    accepted.
    """

    # Chosen among some 20 settings by replaying the boxes that the embedded `s` gave on 11 validation sequences.
    accel_sizes_s1_5: float = 0.6
    growth_accel_s1_5: float = 0.3
    shake_sizes_s0_5: float = 1.0
    size_shake_s0_5: float = 0.6
    pos_sigma_best: float = 0.04
    pos_sigma_worst: float = 0.3
    ln_size_sigma_best: float = 0.1
    ln_size_sigma_worst: float = 0.4
    gate_nis: float = GATE_NIS
    coast_tau_s: float = 1.0
    coast_size_tau_s: float = 0.3
    relocate_s: float = 0.4

    def __post_init__(self) -> None:
        """Check every range. Raises ValueError naming field, value and range."""
        for name, low, high in (
            ("accel_sizes_s1_5", 0.01, 100.0),
            ("growth_accel_s1_5", 0.01, 100.0),
            ("shake_sizes_s0_5", 0.0, 100.0),
            ("size_shake_s0_5", 0.0, 100.0),
            ("pos_sigma_best", 0.001, 10.0),
            ("pos_sigma_worst", self.pos_sigma_best, 10.0),
            ("ln_size_sigma_best", 0.001, 10.0),
            ("ln_size_sigma_worst", self.ln_size_sigma_best, 10.0),
            ("gate_nis", 1.0, 1000.0),
            ("coast_tau_s", 0.05, 60.0),
            ("coast_size_tau_s", 0.05, 60.0),
            ("relocate_s", 0.05, 10.0),
        ):
            check_range("filter", name, getattr(self, name), low, high)


class PredictReason(str, Enum):
    """What a call of `predict` did."""

    MOVED = "moved"
    NO_TIME = "no_time_passed"
    DT_CAPPED = "dt_capped"
    TIME_WENT_BACK = "time_went_back"
    NOT_FINITE = "not_finite"


class UpdateReason(str, Enum):
    """What became of a measurement."""

    INSIDE_GATE = "inside_gate"
    OUTSIDE_GATE = "outside_gate"
    RELOCATED = "relocated"
    NOT_FINITE = "not_finite"


@dataclass(frozen=True, slots=True)
class Innovation:
    """A measurement against the prior: y in (px, px, ln, ln), its NIS before any opening of the gate, and the verdict.

    Both numbers are None when the measurement is not finite.
    """

    reason: UpdateReason
    nis: float | None = None
    y: tuple[float, float, float, float] | None = None

    @property
    def gated(self) -> bool:
        """Whether it lies outside the gate."""
        return self.reason in (UpdateReason.OUTSIDE_GATE, UpdateReason.RELOCATED)

    @property
    def accepted(self) -> bool:
        """Whether it entered the state (of `BoxFilter.innovation`: would enter)."""
        return self.reason in (UpdateReason.INSIDE_GATE, UpdateReason.RELOCATED)


@dataclass(frozen=True, slots=True, eq=False)
class FilterState:
    """A copy of the estimate at a time: mean (8,) and covariance (8, 8)."""

    t_s: float
    x: Array
    p: Array

    @property
    def ln_size(self) -> float:
        """ln(sqrt(w h))."""
        return 0.5 * float(self.x[2] + self.x[3])


class BoxFilter:
    """Estimate of one target's box and its rates. `start` first: every other call raises RuntimeError before it."""

    def __init__(self, config: FilterConfig | None = None) -> None:
        self._config = config or FilterConfig()
        self._kf: Any = None
        self._t_s = self._updated_s = 0.0
        self._outliers = AgreeingRun()

    def start(self, box: Box, t_s: float) -> None:
        """Begin at a box, at rest and unsure of it. Raises ValueError when box or time (monotonic s) is unusable."""
        if not usable_box(box):
            raise ValueError(f"box {box} cannot start the filter: not finite, or of a size or place no picture holds")
        if not math.isfinite(t_s):
            raise ValueError(f"start time is {t_s}, must be finite")
        self._kf = KalmanFilter(dim_x=8, dim_z=4)
        self._kf.H = np.eye(4, 8)
        self._kf.x = np.concatenate((_measurement(box), np.zeros(4)))
        self._kf.P = np.diag(self._sigmas(START_POS_SIZES, START_LN_SIZE, START_VEL_SIZES_S, START_GROWTH_S) ** 2)
        self._t_s = self._updated_s = t_s
        self._outliers.clear()

    def predict(self, t_s: float) -> PredictReason:
        """Move the estimate to a time (monotonic s). A time that is not finite or went back leaves it untouched.

        A gap above MAX_DT_S moves the clock all the way and the state by MAX_DT_S only.
        """
        kf = self._started()
        if not math.isfinite(t_s):
            return PredictReason.NOT_FINITE
        if t_s <= self._t_s:
            return PredictReason.NO_TIME if t_s == self._t_s else PredictReason.TIME_WENT_BACK
        capped = t_s - self._t_s > MAX_DT_S
        transition, noise = self._model(t_s)
        kf.predict(F=transition, Q=noise)
        self._bound()
        self._t_s = t_s
        return PredictReason.DT_CAPPED if capped else PredictReason.MOVED

    def innovation(self, box: Box, score: float) -> Innovation:
        """Judge a measurement against the present estimate; changes nothing."""
        kf = self._started()
        if not (usable_box(box) and math.isfinite(score)):
            return Innovation(UpdateReason.NOT_FINITE)
        y = _measurement(box) - kf.x[:4]
        nis = float(y @ np.linalg.solve(kf.P[:4, :4] + self._measurement_noise(score), y))
        reason = UpdateReason.INSIDE_GATE if nis <= self._config.gate_nis else UpdateReason.OUTSIDE_GATE
        return Innovation(reason, nis, (float(y[0]), float(y[1]), float(y[2]), float(y[3])))

    def log_likelihood(self, box: Box, score: float) -> float:
        """Of a measurement under the prior: -(NIS + ln det S) / 2. Minus infinity when it is not usable."""
        judged = self.innovation(box, score)
        if judged.nis is None:
            return -math.inf
        size = 1.0 / self._size_px()  # positions in target sizes, so that filters of different sizes compare
        unit = np.diag([size, size, 1.0, 1.0])
        s = unit @ (self._kf.P[:4, :4] + self._measurement_noise(score)) @ unit
        return -0.5 * (judged.nis + float(np.linalg.slogdet(s)[1]))

    def update(self, box: Box, score: float) -> Innovation:
        """Take a measurement made at the predicted time, with the tracker's score in [0, 1] (clipped) as its quality.

        Outside the gate it is refused, until outliers that agree have lasted `relocate_s`. What is not finite is
        refused and leaves everything untouched.
        """
        judged = self.innovation(box, score)
        if judged.reason is UpdateReason.NOT_FINITE:
            return judged
        if judged.gated:
            self._outliers.add(box, self._t_s)
            if not self._outliers.lasted(self._config.relocate_s):
                return judged
            self._open_gate(np.array(judged.y))
            judged = replace(judged, reason=UpdateReason.RELOCATED)
        self._kf.update(_measurement(box), R=self._measurement_noise(score))
        self._bound()
        self._updated_s = self._t_s
        self._outliers.clear()
        return judged

    def state(self) -> FilterState:
        """A copy of the estimate."""
        kf = self._started()
        return FilterState(self._t_s, np.array(kf.x), np.array(kf.P))

    def rewind(self, state: FilterState) -> None:
        """Take back what was measured since `state`, and predict from there to the present time."""
        kf, now_s = self._started(), self._t_s
        kf.x, kf.P, self._t_s = np.array(state.x), np.array(state.p), min(state.t_s, now_s)
        self._updated_s = self._t_s
        self.predict(now_s)

    def resize(self, state: FilterState) -> None:
        """Take the size of `state` back, at rest; place and motion stay."""
        kf = self._started()
        kf.x[2:4], kf.x[6:8] = state.x[2:4], 0.0

    def halt(self) -> None:
        """Let place and size rest from now on: a target that stood is predicted where it stands."""
        self._started().x[4:8] = 0.0

    def nudge(self, box: Box) -> None:
        """Take place and size from the operator; the motion stays. Raises ValueError when the box is unusable."""
        kf = self._started()
        if not usable_box(box):
            raise ValueError(f"box {box} cannot be taken: not finite, or of a size or place no picture holds")
        kf.x[:4] = _measurement(box)
        sigmas = self._sigmas(START_POS_SIZES, START_LN_SIZE, START_VEL_SIZES_S, START_GROWTH_S)
        kf.P[:4, :], kf.P[:, :4] = 0.0, 0.0
        kf.P[:4, :4] = np.diag(sigmas[:4] ** 2)
        self._outliers.clear()

    def shift(self, dx_px: float, dy_px: float) -> bool:
        """Move the mean with the picture (ego-motion); False and untouched when not finite or too far."""
        x = self._started().x
        if not all(abs(v) <= MAX_COORD_PX for v in (dx_px, dy_px, x[0] + dx_px, x[1] + dy_px)):
            return False
        x[0] += dx_px
        x[1] += dy_px
        self._outliers.shift(dx_px, dy_px)
        return True

    def ahead(self, t_s: float) -> tuple[Box, Array]:
        """Box and covariance (4, 4) as `predict(t_s)` would leave them; changes nothing. The past means now."""
        kf = self._started()
        if not (math.isfinite(t_s) and t_s > self._t_s):
            return self.box, self.cov
        transition, noise = self._model(t_s)
        return _box(transition @ kf.x), np.asarray((transition @ kf.P @ transition.T + noise)[:4, :4])

    @property
    def box(self) -> Box:
        """The estimate: prior after `predict`, posterior after an accepted `update`."""
        return _box(self._started().x)

    @property
    def vel_px_s(self) -> tuple[float, float]:
        """Velocity of the centre."""
        x = self._started().x
        return float(x[4]), float(x[5])

    @property
    def growth_per_s(self) -> float:
        """Rate of ln(sqrt(w h))."""
        x = self._started().x
        return float(x[6] + x[7]) / 2

    @property
    def cov(self) -> Array:
        """Covariance (4, 4) of (cx_px, cy_px, ln w, ln h); a copy."""
        return np.array(self._started().P[:4, :4])

    @property
    def t_s(self) -> float:
        """The time of the estimate, monotonic seconds."""
        return self._t_s

    def _started(self) -> Any:
        if self._kf is None:
            raise RuntimeError("the box filter was not started")
        return self._kf

    def _size_px(self) -> float:
        return math.exp(0.5 * float(self._kf.x[2] + self._kf.x[3]))

    def _sigmas(self, pos_sizes: float, ln_size: float, vel_sizes_s: float, growth_s: float) -> Array:
        size = self._size_px()
        return np.repeat([pos_sizes * size, ln_size, vel_sizes_s * size, growth_s], 2)

    def _measurement_noise(self, score: float) -> Array:
        """R (4, 4): the lower the score, the larger; geometric from best to worst."""
        c, doubt = self._config, 1.0 - min(max(score, 0.0), 1.0)
        pos_px = c.pos_sigma_best * (c.pos_sigma_worst / c.pos_sigma_best) ** doubt * self._size_px()
        ln_size = c.ln_size_sigma_best * (c.ln_size_sigma_worst / c.ln_size_sigma_best) ** doubt
        return np.diag(np.repeat([pos_px**2, ln_size**2], 2))

    def _model(self, t_s: float) -> tuple[Array, Array]:
        """F and Q (8, 8) from now to `t_s`: full velocity until the grace after the last update ends, then decay."""
        dt = min(t_s - self._t_s, MAX_DT_S)
        steady_s = min(max(self._updated_s + COAST_GRACE_S - self._t_s, 0.0), dt)
        f1, q1 = self._segment(steady_s, math.inf, math.inf)
        q1[0, 0] = q1[1, 1] = q1[0, 0] + (self._config.shake_sizes_s0_5 * self._size_px()) ** 2 * steady_s
        q1[2, 2] = q1[3, 3] = q1[2, 2] + self._config.size_shake_s0_5**2 * steady_s
        if steady_s >= dt:
            return f1, q1
        f2, q2 = self._segment(dt - steady_s, self._config.coast_tau_s, self._config.coast_size_tau_s)
        return f2 @ f1, f2 @ q1 @ f2.T + q2

    def _segment(self, dt_s: float, tau_s: float, size_tau_s: float) -> tuple[Array, Array]:
        accel2 = (self._config.accel_sizes_s1_5 * self._size_px()) ** 2
        growth2 = self._config.growth_accel_s1_5**2
        f, q = np.eye(8), np.zeros((8, 8))
        for axes, tau, density in (((0, 1), tau_s, accel2), ((2, 3), size_tau_s, growth2)):
            f_xv, f_vv, q_xx, q_xv, q_vv = _white_noise_acceleration(dt_s, tau)
            for i in axes:
                f[i, i + 4], f[i + 4, i + 4] = f_xv, f_vv
                q[i, i], q[i + 4, i + 4] = density * q_xx, density * q_vv
                q[i, i + 4] = q[i + 4, i] = density * q_xv
        return f, q

    def _open_gate(self, y: Array) -> None:
        """Make the prior unsure enough to take y: with y_i^2 added to each variance, NIS <= sum(y_i^2 / y_i^2) = 4."""
        rates = self._sigmas(START_POS_SIZES, START_LN_SIZE, START_VEL_SIZES_S, START_GROWTH_S)[4:]
        self._kf.P = self._kf.P + np.diag(np.concatenate((y**2, rates**2)))

    def _bound(self) -> None:
        """Symmetrise and cap the covariance (by scaling, which keeps it positive semi-definite); bound the size."""
        kf = self._kf
        kf.x[2:4] = np.clip(kf.x[2:4], math.log(MIN_SIZE_PX), math.log(MAX_SIZE_PX))
        p = 0.5 * (kf.P + kf.P.T)
        cap = self._sigmas(CAP_POS_SIZES, CAP_LN_SIZE, CAP_VEL_SIZES_S, CAP_GROWTH_S)
        scale = np.minimum(1.0, cap / np.sqrt(np.diag(p)))
        kf.P = p * np.outer(scale, scale)


def _measurement(box: Box) -> Array:
    return np.array([box.cx_px, box.cy_px, math.log(box.w_px), math.log(box.h_px)])


def _box(x: Array) -> Box:
    return Box(float(x[0]), float(x[1]), math.exp(float(x[2])), math.exp(float(x[3])))


def _white_noise_acceleration(dt_s: float, tau_s: float) -> tuple[float, float, float, float, float]:
    """F_xv, F_vv and Q_xx, Q_xv, Q_vv for unit density; velocity decays by exp(-t/tau) (tau infinite: never).

    Exact for any dt: steps of dt1 and dt2 equal one of dt1 + dt2 (Bar-Shalom et al. 2001, sections 6.2.2 and 8.2.2).
    """
    if math.isinf(tau_s):
        return dt_s, 1.0, dt_s**3 / 3, dt_s**2 / 2, dt_s
    reach = -tau_s * math.expm1(-dt_s / tau_s)  # way of a unit velocity
    q_vv = -tau_s / 2 * math.expm1(-2 * dt_s / tau_s)
    q_xx = tau_s**2 * (dt_s - 2 * reach + q_vv) if dt_s > SERIES_BELOW * tau_s else dt_s**3 / 3
    return reach, math.exp(-dt_s / tau_s), q_xx, reach**2 / 2, q_vv
