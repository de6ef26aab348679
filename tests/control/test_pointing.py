import math

import numpy as np
import pytest

from control.frames import direction_from_angles
from control.pointing import MAX_EXTRAPOLATION_S, PointingTrack, TargetRate
from tests.control.builders import gimbal


def track_of(*reports) -> PointingTrack:
    track = PointingTrack()
    for t_s, pitch, yaw in reports:
        track.update(gimbal(pitch, yaw, t_s=t_s))
    return track


def test_the_line_through_two_reports_across_the_seam():
    track = track_of((1.0, 0.0, 3.1), (1.1, -0.1, 3.1 + 0.1 - math.tau))
    assert track.at(1.1) == pytest.approx((-0.1, 3.2 - math.tau))
    assert track.at(1.2) == pytest.approx((-0.2, 3.3 - math.tau))
    assert track.at(1.0) == pytest.approx((0.0, 3.1))
    assert track.at(9.0) == pytest.approx((-0.1 - MAX_EXTRAPOLATION_S, 3.2 + MAX_EXTRAPOLATION_S - math.tau))


def test_a_repeated_report_keeps_the_line():
    track = track_of((1.0, 0.0, 0.0), (1.1, 0.0, 0.1), (1.1, 0.0, 0.1))
    assert track.at(1.2)[1] == pytest.approx(0.2)


@pytest.mark.parametrize("t_s", [0.9, 2.0])
def test_time_that_runs_back_or_a_gap_leaves_a_point(t_s):
    assert track_of((1.0, 0.0, 0.0), (1.1, 0.0, 0.1), (t_s, 0.0, 0.2)).at(t_s + 0.1)[1] == pytest.approx(0.2)


def test_nothing_reported_is_the_base_itself_and_pitch_ends_at_the_poles():
    assert PointingTrack().at(1.0) == (0.0, 0.0)
    assert track_of((1.0, -1.4, 0.0), (1.1, -1.55, 0.0)).at(1.2)[0] == -math.pi / 2
    track = track_of((1.0, 0.5, 0.5))
    track.reset()
    assert track.at(1.0) == (0.0, 0.0)


@pytest.mark.parametrize("hz", [10, 50])
def test_rate_rises_with_its_filter_at_every_rate_of_frames(hz):
    rate = TargetRate(0.2, 5.0)
    for i in range(round(0.2 * hz) + 1):
        rate.update(i / hz, direction_from_angles(i / hz, -0.3))
    expected = (1 - math.exp(-1.0)) * math.sin(1 / hz) * hz
    assert rate.rate_rad_s == pytest.approx((0.0, expected), abs=1e-6)


def test_elevation_rate_is_up_positive():
    rate = TargetRate(0.0, 5.0)
    rate.update(0.0, direction_from_angles(0.5, 0.0))
    rate.update(0.01, direction_from_angles(0.5, 0.01))
    assert rate.rate_rad_s == pytest.approx((1.0, 0.0), rel=1e-3, abs=1e-9)


def test_one_wrong_box_is_bounded():
    rate = TargetRate(0.0, 0.5)
    rate.update(0.0, direction_from_angles(0.0, 0.0))
    rate.update(0.01, direction_from_angles(-1.0, 1.0))
    assert rate.rate_rad_s == (0.5, -0.5)


def test_the_same_frame_again_changes_nothing_and_a_gap_starts_anew():
    rate = TargetRate(0.0, 5.0)
    rate.update(0.0, direction_from_angles(0.0, 0.0))
    rate.update(0.1, direction_from_angles(0.1, 0.0))
    before = rate.rate_rad_s
    rate.update(0.1, direction_from_angles(0.1, 0.0))
    assert rate.rate_rad_s == before != (0.0, 0.0)
    rate.update(2.0, direction_from_angles(0.3, 0.0))
    assert rate.rate_rad_s == (0.0, 0.0)
    rate.update(1.0, direction_from_angles(0.5, 0.0))
    assert rate.rate_rad_s == (0.0, 0.0)


def test_a_measured_rate_is_taken_as_it_is():
    rate = TargetRate(0.0, 5.0)
    rate.update(0.0, np.array([1.0, 0.0, 0.0]))
    rate.update(0.1, np.array([1.0, 0.0, 0.0]), (0.2, -0.3))
    assert rate.rate_rad_s == (0.2, -0.3)


@pytest.mark.parametrize("gap_s", [0.001, 5e-324])
def test_bunched_reports_make_no_rate_of_their_own(gap_s):
    first_s = 0.0 if gap_s < 1e-300 else 1.1
    track = track_of((first_s - 0.1, 0.0, 0.0), (first_s, 0.0, 0.05), (first_s + gap_s, 0.0, 0.05 + math.radians(3)))
    newest = 0.05 + math.radians(3)
    assert track.at(first_s + gap_s + 0.1)[1] == pytest.approx(newest + 0.05)  # the rate of before, from the newest


@pytest.mark.parametrize("gap_s", [0.001, 5e-324])
def test_bunched_frames_make_no_rate_of_their_own(gap_s):
    rate = TargetRate(0.0, 5.0)
    rate.update(-0.1, direction_from_angles(0.0, 0.0))
    rate.update(0.0, direction_from_angles(0.1, 0.0))
    before = rate.rate_rad_s
    rate.update(gap_s, direction_from_angles(0.2, 0.0))
    assert rate.rate_rad_s == before
