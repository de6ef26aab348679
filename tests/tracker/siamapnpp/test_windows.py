"""Which windows are searched: the hint's, its tiles up to the calls it allows, never a wild one."""

from __future__ import annotations

import math

import pytest

from tracker.messages import SearchHint, SearchTile
from tracker.siamapnpp.windows import FLOOR_PX, MAX_CALLS, MAX_HINT_SIZE_PX, hinted_size, windows

SIDE_PX = 80 * 287 / 127  # of the normal window for a target of 40 x 40
TILES = tuple(SearchTile((1000.0 + k, 50.0), 2.0) for k in range(40))


def _windows(hint: SearchHint | None, sure_px: int | None = None) -> list[tuple[float, float, float, int, float]]:
    found = windows(hint, (300.0, 200.0), (40.0, 40.0), 287, sure_px)
    return [(w.geometry.cx_px, w.geometry.cy_px, w.geometry.side_px, w.geometry.out_px, w.scale) for w in found]


def test_without_a_usable_hint_the_window_is_at_the_last_place() -> None:
    normal = [(300.0, 200.0, pytest.approx(SIDE_PX), 287, 1.0)]
    assert _windows(None) == normal
    assert _windows(SearchHint((math.nan, 200.0), (1, 0, 1), tiles=TILES, max_calls=9)) == normal


def test_tiles_are_searched_as_far_as_the_calls_reach() -> None:
    for calls, count in ((0, 1), (1, 1), (3, 3), (1000, MAX_CALLS)):
        hint = SearchHint((310.0, 200.0), (1, 0, 1), max_calls=calls, tiles=TILES)
        found = _windows(hint)
        assert len(found) == count
        assert found[0] == (310.0, 200.0, pytest.approx(SIDE_PX), 287, 1.0)
        assert found[1:] == [(1000.0 + k, 50.0, pytest.approx(2 * SIDE_PX), 287, 2.0) for k in range(count - 1)]


def test_broken_tiles_are_left_out_and_wild_scales_bounded() -> None:
    tiles = (SearchTile((math.inf, 0.0)), SearchTile((5.0, 5.0), math.nan), SearchTile((9.0, 9.0), 1e9))
    found = _windows(SearchHint((300.0, 200.0), (1, 0, 1), max_calls=4, tiles=tiles))
    assert found[1:] == [(9.0, 9.0, pytest.approx(4 * SIDE_PX), 287, 4.0)]


def test_a_sure_hint_takes_the_small_crop_at_the_same_resolution() -> None:
    sure = SearchHint((300.0, 200.0), (1, 0, 1), sure=True)
    assert _windows(sure, 223) == [(300.0, 200.0, pytest.approx(SIDE_PX * 223 / 287), 223, 1.0)]
    assert _windows(sure)[0][3] == 287
    for unsure in (
        SearchHint((300.0, 200.0), (1, 0, 1)),
        SearchHint((300.0, 200.0), (1, 0, 1), 1.5, sure=True),
        SearchHint((300.0, 200.0), (1, 0, 1), max_calls=2, tiles=TILES[:1], sure=True),
    ):
        assert _windows(unsure, 223)[0][3] == 287


def test_the_hinted_size_is_bounded() -> None:
    assert hinted_size(SearchHint((0, 0), (1, 0, 1), size_px=(20.0, 30.0))) == (20.0, 30.0)
    assert hinted_size(SearchHint((0, 0), (1, 0, 1), size_px=(-5.0, 1e9))) == (FLOOR_PX, MAX_HINT_SIZE_PX)
    for none in (None, SearchHint((0, 0), (1, 0, 1)), SearchHint((0, 0), (1, 0, 1), size_px=(math.nan, 5.0))):
        assert hinted_size(none) is None
