"""Candidates of several windows become one list: by rank, one per place, rivals of all windows counted."""

from __future__ import annotations

import pytest

from tracker.box import Box
from tracker.messages import Candidate, Evidence
from tracker.siamapnpp.evidence import MAX_SECOND
from tracker.siamapnpp.merge import Found, merge


def _found(cx: float, rank: float, second: float = 0.0, reach: float = 30.0, scale: float = 1.0) -> Found:
    evidence = Evidence((rank,) * 3, second, 1.0, None, None, 0.0, 0.0, scale)
    return Found(Candidate(Box(cx, 100.0, 40.0, 40.0), rank, rank, rank, evidence), rank, (reach, reach))


def test_one_window_keeps_its_own_order() -> None:
    found = [_found(100, 0.5), _found(200, 0.9)]
    assert merge([found], 5) == tuple(f.candidate for f in found)
    assert merge([found], 1) == (found[0].candidate,)
    assert merge([[]], 5) == ()


def test_the_best_of_all_windows_comes_first_and_each_place_once() -> None:
    merged = merge([[_found(100, 0.3), _found(300, 0.2)], [_found(500, 0.8), _found(110, 0.6, scale=2.0)], []], 5)
    assert [c.box.cx_px for c in merged] == [500, 110, 300]
    assert merged[1].evidence is not None
    assert merged[1].evidence.search_scale == 2.0
    assert len(merge([[_found(100, 0.5), _found(300, 0.2)], [_found(500, 0.8)]], 2)) == 2


def test_what_a_narrow_window_shows_nearly_as_well_is_taken_from_there() -> None:
    for narrow in (0.37, 0.59, 0.7):
        for order in (1, -1):
            windows = [[_found(110, 0.6, scale=2.0)], [_found(100, narrow)]][::order]
            assert [c.box.cx_px for c in merge(windows, 5)] == [100]
    assert [c.box.cx_px for c in merge([[_found(110, 0.6, scale=2.0)], [_found(100, 0.35)]], 5)] == [110]


def test_a_coarse_window_cannot_tell_apart_what_a_fine_one_can() -> None:
    assert len(merge([[_found(100, 0.5)], [_found(140, 0.4)]], 5)) == 2
    assert len(merge([[_found(100, 0.5)], [_found(140, 0.4, reach=60.0)]], 5)) == 1


def test_second_counts_the_rivals_of_other_windows() -> None:
    merged = merge([[_found(100, 0.5, second=0.1)], [_found(500, 0.4, second=0.9)]], 5)
    seconds = [c.evidence.second for c in merged if c.evidence is not None]
    assert seconds == [pytest.approx(0.8), pytest.approx(1.25)]
    own = merge([[_found(100, 0.5, second=0.9)], [_found(500, 0.1)]], 5)
    assert own[0].evidence is not None
    assert own[0].evidence.second == 0.9
    nothing = merge([[_found(100, 0.5)], [_found(500, 0.0)]], 5)
    assert nothing[1].evidence is not None
    assert nothing[1].evidence.second == MAX_SECOND
