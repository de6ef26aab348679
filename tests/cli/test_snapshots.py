"""Which moments of a run the report shows."""

from tracker.messages import TargetStatus
from uavfollow.record.report import Snapshots

LOCKED, COASTING = TargetStatus.LOCKED, TargetStatus.COASTING


def _wanted(count, statuses):
    snapshots = Snapshots(count)
    return [k for k, status in enumerate(statuses) if snapshots.wants(k, status)]


def test_evenly_through_the_run_to_its_end_and_each_status_once():
    wanted = _wanted(60, [LOCKED] * 30 + [COASTING] * 8 + [LOCKED] * 22)
    assert wanted == [5, 15, 25, 35, 45, 55]  # LOCKED at 5 and COASTING at 35 are among them


def test_a_status_between_the_spaced_ones_gets_a_picture_of_its_own():
    assert _wanted(60, [LOCKED] * 16 + [COASTING] * 8 + [LOCKED] * 36) == [5, 15, 21, 25, 35, 45, 55]


def test_a_status_that_hardly_lasted_gets_none():
    assert _wanted(60, [LOCKED] * 16 + [COASTING] * 3 + [LOCKED] * 41) == [5, 15, 25, 35, 45, 55]


def test_a_run_of_unknown_length_keeps_a_bounded_number():
    assert len(_wanted(None, [LOCKED] * 5000)) <= 7
