"""What the maps say of a candidate: other places, sharpness, change of shape; finite whatever the maps hold."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.tracker.siamapnpp.maps import SETTINGS, TARGET_PX, maps_with
from tracker.messages import Evidence
from tracker.siamapnpp.decode import ResponseMaps, decode, footprint, rank, shape_penalty
from tracker.siamapnpp.evidence import MAX_LN, MAX_SECOND, map_evidence, penalised_score

CENTRE = 10 * 21 + 10


def _evidence(maps: ResponseMaps, cell: int = CENTRE, size: float = TARGET_PX, scale: float = 1.0) -> Evidence:
    decoded = decode(maps, SETTINGS)
    plain = penalised_score(decoded, shape_penalty(decoded, size, size, SETTINGS.penalty_k))
    return map_evidence(decoded, plain, cell, footprint(size, size), (size, size), scale)


def _sigmoid(x: float) -> float:
    return 1.0 / (1.0 + math.exp(-x))


def test_a_lone_peak_has_no_second_and_is_sharp() -> None:
    lone = _evidence(maps_with({(10, 10): 6.0}))
    assert lone.second < 0.01
    assert lone.sharpness > 50
    assert lone.heads == pytest.approx((_sigmoid(6.0),) * 3)
    assert (lone.exemplar, lone.recent) == (None, None)


def test_second_is_the_share_of_the_strongest_other_place() -> None:
    maps = maps_with({(10, 10): 4.0, (10, 19): 1.0, (2, 2): 0.0})
    assert _evidence(maps).second == pytest.approx(_sigmoid(1.0) / _sigmoid(4.0), rel=1e-3)
    assert _evidence(maps, 10 * 21 + 19).second == pytest.approx(_sigmoid(4.0) / _sigmoid(1.0), rel=1e-3)


@pytest.mark.parametrize(("row", "column"), [(10, 13), (10, 7), (13, 10), (7, 10), (13, 13)])
def test_what_lies_in_the_targets_own_footprint_is_no_other_place(row: int, column: int) -> None:
    """Three cells are 24 px, less than three quarters of a target of 63.5 px."""
    assert _evidence(maps_with({(10, 10): 4.0, (row, column): 3.9})).second < 0.01


def test_the_footprint_is_that_of_the_target_but_never_less_than_a_cell() -> None:
    near_a_small_one = maps_with({(10, 10): 4.0, (10, 13): 3.9}, box_px=20.0)
    assert _evidence(near_a_small_one, size=20.0).second > 0.9
    across, down = footprint(80.0, 20.0)
    assert across == 4 * down
    assert footprint(0.1, 0.1) == (8.0, 8.0)


def test_all_heads_and_the_shape_count_for_a_second_place() -> None:
    maps = maps_with({(10, 10): 4.0, (10, 19): 4.0})
    assert _evidence(maps).second == pytest.approx(1.0)
    maps.cls1[1, 10, 19] = -4.0
    weaker = _evidence(maps).second
    assert weaker == pytest.approx(1.0 - 1.2 / 3.6, abs=0.02)
    maps.loc[2:, 10, 19] = math.log(2.0)
    assert _evidence(maps).second == pytest.approx(weaker * math.exp(-SETTINGS.penalty_k), rel=1e-3)


def test_the_window_does_not_hide_a_rival_at_the_edge() -> None:
    maps = maps_with({(10, 10): 1.0, (10, 20): 4.0})
    decoded = decode(maps, SETTINGS)
    penalty = shape_penalty(decoded, TARGET_PX, TARGET_PX, SETTINGS.penalty_k)
    assert int(rank(decoded, penalty, SETTINGS).argmax()) == CENTRE  # the window prefers the middle
    assert _evidence(maps).second > 1.2


def test_a_blurred_response_is_less_sharp() -> None:
    rng = np.random.default_rng(0)
    noise = {(int(r), int(c)): float(rng.normal()) for r, c in rng.integers(0, 21, (150, 2))}
    assert _evidence(maps_with({**noise, (10, 10): 4.0})).sharpness < 5


def test_change_of_shape_is_that_to_the_size_searched_with() -> None:
    maps = maps_with({(10, 10): 4.0})
    maps.loc[2, 10, 10], maps.loc[3, 10, 10] = math.log(2.0), math.log(0.5)
    changed = _evidence(maps)
    assert changed.ln_scale == pytest.approx(0.0, abs=1e-5)
    assert changed.ln_aspect == pytest.approx(math.log(4.0), rel=1e-5)
    maps.loc[3, 10, 10] = math.log(2.0)
    assert _evidence(maps, scale=2.0).ln_scale == pytest.approx(math.log(2.0), rel=1e-5)
    assert _evidence(maps, scale=2.0).search_scale == 2.0


@given(scale=st.floats(0, 1e6), seed=st.integers(0, 2**32 - 1), poison=st.sampled_from([0.0, np.nan, np.inf, -np.inf]))
@settings(max_examples=30, deadline=None)
def test_any_numbers_give_finite_evidence(scale: float, seed: int, poison: float) -> None:
    rng = np.random.default_rng(seed)
    parts = [(rng.standard_normal((n, 21, 21)) * scale).astype(np.float32) for n in (2, 2, 1, 4, 4)]
    for part in parts:
        part.flat[rng.integers(0, part.size, 5)] = poison
    decoded = decode(ResponseMaps(*parts), SETTINGS)
    for cell in np.flatnonzero(decoded.usable)[:8]:
        evidence = _evidence(ResponseMaps(*parts), int(cell))
        numbers = (*evidence.heads, evidence.second, evidence.sharpness, evidence.ln_scale, evidence.ln_aspect)
        assert all(math.isfinite(v) for v in numbers)
        assert all(0 <= p <= 1 for p in evidence.heads)
        assert 0 <= evidence.second <= MAX_SECOND
        assert -100 <= evidence.sharpness <= 100
        assert max(abs(evidence.ln_scale), abs(evidence.ln_aspect)) <= MAX_LN
