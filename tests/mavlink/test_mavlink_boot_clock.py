"""The autopilot's clock on ours: TIMESYNC, its absence, other people's answers, reboots."""

from __future__ import annotations

import pytest

from uavfollow.mavlink.boot_clock import BootClock

OFFSET_S = -70.0  # their clock minus ours


def synced(round_trips_s: list[float], share_out: float = 0.5) -> BootClock:
    clock, now_s = BootClock(), 100.0
    for round_trip_s in round_trips_s:
        ts1 = clock.request(now_s)
        tc1 = int((now_s + share_out * round_trip_s + OFFSET_S) * 1e9)
        assert clock.reply(tc1, ts1, now_s + round_trip_s)
        now_s += 1.0
    return clock


def test_offset_from_symmetric_round_trips_is_exact():
    assert synced([0.02, 0.08, 0.01]).offset_s == pytest.approx(OFFSET_S, abs=1e-6)


def test_the_shortest_round_trip_wins():
    """All of a round trip on one way is the worst case: the error is half of it, so the shortest is the best."""
    assert synced([0.2, 0.01, 0.2], share_out=1.0).offset_s == pytest.approx(OFFSET_S + 0.005, abs=1e-6)


def test_answers_to_others_and_late_ones_are_not_taken():
    clock = BootClock()
    ts1 = clock.request(100.0)
    assert not clock.reply(1, ts1 + 1, 100.01)
    assert not clock.reply(1, ts1, 101.5), "a round trip of 1.5 s"
    assert not clock.reply(1, ts1, 100.01), "each answer counts once"
    assert clock.offset_s is None


def test_without_timesync_the_quickest_message_counts():
    clock = BootClock()
    for delay_s, now_s in ((0.05, 100.0), (0.01, 101.0), (0.09, 102.0)):
        assert clock.heard(now_s - delay_s + OFFSET_S, now_s)
    assert clock.offset_s == pytest.approx(OFFSET_S - 0.01)
    assert clock.ours(102.0 - 0.09 + OFFSET_S, 102.0) == pytest.approx(102.0 - 0.08)


def test_no_stamp_comes_out_in_the_future():
    clock = synced([0.01])
    assert clock.ours(500.0, 110.0) == 110.0
    assert BootClock().ours(5.0, 110.0) == 110.0


def test_a_clock_that_goes_back_is_a_reboot_and_forgets():
    clock = synced([0.01])
    assert clock.heard(30.0, 100.0)
    assert clock.heard(29.5, 100.1), "a message that was overtaken"
    assert not clock.heard(1.0, 100.2)
    assert clock.offset_s == pytest.approx(1.0 - 100.2)
    assert clock.heard(1.1, 100.3)
