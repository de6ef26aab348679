from __future__ import annotations

import math
from dataclasses import replace

import pytest

from sitl.metrics import flight
from sitl.metrics.flight import FlightLimits
from sitl.metrics.sample import Sample, Setpoint
from tests.sitl.metrics.samples import DT_S, run

LIMITS = FlightLimits()


def test_standoff_height_and_bearing() -> None:
    away = run(10, lambda i, s: replace(s, vehicle_pos_ned_m=(-1.0 if i % 2 else 1.0, 0.0, -12.0)))
    assert flight.standoff_err_rms_m(away, 20.0) == pytest.approx(1.0)
    assert flight.standoff_err_rms_m(away, 17.0) == pytest.approx(math.sqrt((4 * 4 + 2 * 2) / 2))
    high = run(10, lambda i, s: replace(s, vehicle_pos_ned_m=(0.0, 0.0, -12.0 - (i > 0))))
    assert flight.height_err_rms_m(high, 12.0) == pytest.approx(math.sqrt(0.9))
    assert flight.height_err_rms_m(high, None) == pytest.approx(math.sqrt(0.9))
    assert flight.height_err_rms_m(high, 13.0) == pytest.approx(math.sqrt(0.1))
    assert flight.bearing_err_rms_deg(run(5), math.pi) == pytest.approx(0.0, abs=1e-9)
    assert flight.bearing_err_rms_deg(run(5), -math.pi + math.radians(3)) == pytest.approx(3.0)
    assert flight.bearing_err_rms_deg(run(5), None) is None


def test_only_following_counts() -> None:
    still = run(10, lambda i, s: replace(s, following=False))
    assert flight.standoff_err_rms_m(still, 20.0) is None
    assert flight.height_err_rms_m(still, None) is None
    assert flight.bearing_err_rms_deg(still, 0.0) is None
    mixed = run(10, lambda i, s: replace(s, following=i >= 5, vehicle_pos_ned_m=(0.0 if i >= 5 else 9.0, 0.0, -12.0)))
    assert flight.standoff_err_rms_m(mixed, 20.0) == 0.0


def test_gimbal_commands_count_at_rest_when_locked_and_centred() -> None:
    def change(i: int, s: Sample) -> Sample:
        rate = math.radians(30.0) if i < 30 else math.radians(3.0)
        s = replace(s, gimbal_pitch_rate_rad_s=rate, gimbal_yaw_rate_rad_s=rate * 4 / 3)
        return replace(s, target_vel_ned_m_s=(3.0, 0.0, 0.0), gimbal_pitch_rate_rad_s=9.0) if i >= 60 else s

    assert flight.gimbal_cmd_rms_deg_s(run(90, change)) == pytest.approx(5.0)
    assert flight.gimbal_cmd_rms_deg_s(run(20, change)) is None
    assert flight.gimbal_cmd_rms_deg_s(run(90, lambda i, s: replace(s, target_vel_ned_m_s=(1.0, 0, 0)))) is None


def test_setpoint_rate_and_gap_of_a_steady_stream() -> None:
    samples = run(91)  # now_s from 0.1 to 3.1
    times = [0.1 + 0.05 * i for i in range(61)]
    found = flight.setpoint_metrics(samples, times)
    assert found["setpoint_rate_hz"] == pytest.approx(20.0)
    assert found["setpoint_gap_max_s"] == pytest.approx(0.05)


def test_a_stream_that_starts_late_pauses_or_dies_shows_in_the_gap() -> None:
    samples = run(91)
    assert flight.setpoint_metrics(samples, [1.1, 1.2, 3.1])["setpoint_gap_max_s"] == pytest.approx(1.9)
    assert flight.setpoint_metrics(samples, [0.1, 0.2, 0.3])["setpoint_gap_max_s"] == pytest.approx(2.8)
    assert flight.setpoint_metrics(samples, [2.1, 2.6, 3.1])["setpoint_gap_max_s"] == pytest.approx(2.0)
    assert flight.setpoint_metrics(samples, []) == {"setpoint_rate_hz": None, "setpoint_gap_max_s": pytest.approx(3.0)}


def test_time_between_two_stretches_of_following_is_no_gap() -> None:
    samples = run(121, lambda i, s: replace(s, following=i <= 30 or i >= 90))
    times = [0.1 + 0.1 * i for i in range(11)] + [3.1 + 0.1 * i for i in range(11)]
    found = flight.setpoint_metrics(samples, times)
    assert found["setpoint_gap_max_s"] == pytest.approx(0.1)
    assert found["setpoint_rate_hz"] == pytest.approx(10.0)
    assert flight.following_spans(samples) == [
        (pytest.approx(0.1), pytest.approx(1.1)),
        (pytest.approx(3.1), pytest.approx(4.1)),
    ]


def test_without_following_there_is_no_rate() -> None:
    samples = run(30, lambda i, s: replace(s, following=False))
    assert flight.setpoint_metrics(samples, [0.1, 0.2]) == {"setpoint_rate_hz": None, "setpoint_gap_max_s": None}


def test_commands_after_override() -> None:
    assert flight.commands_after_override([1.0, 2.0, 3.0], 2.0) == 1.0
    assert flight.commands_after_override([1.0], 2.0) == 0.0
    assert flight.commands_after_override([1.0], None) is None
    assert flight.commands_after_override([1.0, 2.5, 4.0, 5.0], 2.0, 4.0) == 1.0, "those after a new start are wanted"


@pytest.mark.parametrize(
    ("velocity", "yaw_rate", "violations"),
    [
        ((3.0, 4.0, 0.0), 0.0, 0.0),
        ((3.1, 4.0, 0.0), 0.0, 1.0),
        ((0.0, 0.0, -1.0), 0.0, 0.0),
        ((0.0, 0.0, -1.1), 0.0, 1.0),
        ((0.0, 0.0, 1.1), 0.0, 1.0),
        ((0.0, 0.0, 0.0), math.radians(45), 0.0),
        ((0.0, 0.0, 0.0), math.radians(-46), 1.0),
        ((math.nan, 0.0, 0.0), 0.0, 1.0),
        ((0.0, 0.0, 0.0), math.inf, 1.0),
    ],
)
def test_speed_limits(velocity: tuple[float, float, float], yaw_rate: float, violations: float) -> None:
    assert flight.limit_violations([Setpoint(1.0, velocity, yaw_rate)], LIMITS) == violations
    assert flight.limit_violations([], LIMITS) is None


def test_a_sudden_change_of_speed_is_a_violation_but_for_zeros() -> None:
    def sent(*speeds: float) -> list[Setpoint]:
        return [Setpoint(i * DT_S, (v, 0.0, 0.0), 0.0) for i, v in enumerate(speeds)]

    assert flight.limit_violations(sent(3.0, 3.0, 0.0, 0.0), LIMITS) == 0.0, "a stop may come at once"
    assert flight.limit_violations(sent(3.0, 3.0, 0.5, 0.5), LIMITS) == 1.0
    assert flight.limit_violations(sent(0.0, 0.0, 3.0), LIMITS) == 1.0
    assert flight.limit_violations(sent(*(i * 2.0 * DT_S for i in range(10))), LIMITS) == 0.0


def test_tighter_limits_count() -> None:
    sent = [Setpoint(i * DT_S, (1.0, 0.0, 0.0), 0.0) for i in range(4)]
    assert flight.limit_violations(sent, FlightLimits(max_horizontal_m_s=0.9)) == 4.0


def test_limits_are_those_of_the_application() -> None:
    from control.limits import VelocityLimits

    theirs = VelocityLimits()
    assert LIMITS.max_horizontal_m_s == theirs.max_horizontal_m_s
    assert LIMITS.max_up_m_s == theirs.max_up_m_s
    assert LIMITS.max_down_m_s == theirs.max_down_m_s
    assert LIMITS.max_yaw_rate_rad_s == theirs.max_yaw_rate_rad_s
    assert LIMITS.max_accel_m_s2 == max(theirs.max_horizontal_accel_m_s2, theirs.brake_horizontal_accel_m_s2)
