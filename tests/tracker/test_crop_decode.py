"""Crops are where they say they are; decoding follows the sheet's formulas and survives any number."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tracker.siamapnpp.crop import CropGeometry, crop_square, exemplar_side_px
from tracker.siamapnpp.decode import ResponseMaps, decode, grid, hann, pick, rank, shape_penalty
from tracker.siamapnpp.settings import CentreTerm, TrackerSettings

FILL = (10.0, 20.0, 30.0)


def _gradient(height: int = 200, width: int = 300) -> np.ndarray:
    """A picture whose colours tell the place: blue is x/2, green is y."""
    image = np.zeros((height, width, 3), np.uint8)
    image[..., 0] = np.arange(width)[None, :] // 2
    image[..., 1] = np.arange(height)[:, None]
    return image


def test_exemplar_side_of_a_square_is_twice_its_side() -> None:
    assert exemplar_side_px(40, 40) == pytest.approx(80)
    assert exemplar_side_px(20, 60) == pytest.approx(math.sqrt((20 + 40) * (60 + 40)))


def test_unit_scale_crop_is_the_picture_itself() -> None:
    image = _gradient()
    crop = crop_square(image, CropGeometry(100.5, 80.5, 63, 63), FILL)
    assert np.array_equal(crop, image[49:112, 69:132])


@pytest.mark.parametrize(("side", "out"), [(127, 127), (60, 127), (254, 127), (190, 63), (900, 127)])
def test_the_middle_of_the_crop_shows_the_geometrys_centre(side: float, out: int) -> None:
    image = _gradient()
    crop = crop_square(image, CropGeometry(150.5, 100.5, side, out), FILL)
    middle = crop[out // 2, out // 2].astype(float)
    assert middle[0] == pytest.approx(75, abs=2.1)
    assert middle[1] == pytest.approx(100, abs=2.1)


def test_outside_is_the_fill_colour_and_the_frame_is_untouched() -> None:
    image = _gradient()
    before = image.copy()
    crop = crop_square(image, CropGeometry(0, 0, 100, 127), FILL)
    assert tuple(crop[0, 0]) == (10, 20, 30)
    assert tuple(crop[-1, -1]) != (10, 20, 30)
    assert np.array_equal(image, before)
    far = crop_square(image, CropGeometry(-5000, 9000, 100, 127), FILL)
    assert (far == np.array([10, 20, 30], np.uint8)).all()


@given(
    cx=st.floats(-500, 800), cy=st.floats(-500, 800), side=st.floats(0.01, 20000), out=st.sampled_from([127, 223, 287])
)
@settings(max_examples=60)
def test_any_window_gives_a_crop(cx: float, cy: float, side: float, out: int) -> None:
    crop = crop_square(_gradient(), CropGeometry(cx, cy, side, out), FILL)
    assert crop.shape == (out, out, 3)
    assert crop.dtype == np.uint8


def _maps(cells: int = 21) -> ResponseMaps:
    zero = np.zeros
    anchor = np.full((4, cells, cells), 20 / 71, np.float32)
    return ResponseMaps(
        zero((2, cells, cells), np.float32),
        zero((2, cells, cells), np.float32),
        zero((1, cells, cells), np.float32),
        zero((4, cells, cells), np.float32),
        anchor,
    )


def test_grid_is_8i_minus_80_row_major() -> None:
    gx, gy = grid(21)
    assert (gx[0], gx[20], gx[21]) == (-80, 80, -80)
    assert (gy[0], gy[20], gy[21], gy[440]) == (-80, -80, -72, 80)


def test_boxes_follow_anchor_and_delta() -> None:
    maps = _maps()
    maps.anchor[:, 3, 5] = np.array([10, 30, 8, 12], np.float32) / 71  # left, right, top, bottom
    maps.loc[:, 3, 5] = [0.1, -0.2, math.log(2), math.log(0.5)]
    decoded = decode(maps, TrackerSettings())
    i = 3 * 21 + 5
    gx, gy = 8 * 5 - 80, 8 * 3 - 80
    assert decoded.cx[i] == pytest.approx(gx - 10 + 20 + 0.1 * 40, abs=1e-4)
    assert decoded.cy[i] == pytest.approx(gy - 8 + 10 - 0.2 * 20, abs=1e-4)
    assert (decoded.w[i], decoded.h[i]) == (pytest.approx(80, rel=1e-5), pytest.approx(10, rel=1e-5))


def test_scores_follow_the_class_weights() -> None:
    maps = _maps()
    maps.cls1[:, 2, 2], maps.cls2[:, 2, 2], maps.cls3[0, 2, 2] = [0, 2], [0, 1], 3.0
    p1, p2, p3 = (1 / (1 + math.exp(-v)) for v in (2, 1, 3))
    official = decode(maps, TrackerSettings())
    ours = decode(maps, TrackerSettings(centre_term=CentreTerm.SIGMOID))
    i = 2 * 21 + 2
    assert official.ranking[i] == pytest.approx((1.2 * p1 + 1.3 * p2 + 1.1 * 3.0) / 3)
    assert official.ranking[i] > 1  # no probability: this is why confidence is another number
    assert ours.ranking[i] == ours.confidence[i] == official.confidence[i]
    assert ours.confidence[i] == pytest.approx((1.2 * p1 + 1.3 * p2 + 1.1 * p3) / 3.6)
    assert ours.similarity[i] == pytest.approx(p2)


def test_the_hann_window_wins_when_all_cells_are_alike() -> None:
    decoded = decode(_maps(), TrackerSettings())
    penalty = shape_penalty(decoded, 40, 40, 0.079)
    assert penalty == pytest.approx(1.0)
    ranked = rank(decoded, penalty, TrackerSettings())
    assert int(ranked.argmax()) == 220  # the centre cell
    assert hann(21)[220] == 1
    assert hann(21)[0] == 0


def test_penalty_falls_with_scale_and_aspect_change() -> None:
    maps = _maps()
    maps.loc[2, 0, 0] = maps.loc[3, 0, 0] = math.log(2)  # twice as large
    maps.loc[2, 0, 1], maps.loc[3, 0, 1] = math.log(2), -math.log(2)  # four times as wide as high
    penalty = shape_penalty(decode(maps, TrackerSettings()), 40, 40, 0.079)
    assert penalty[0] == pytest.approx(math.exp(-(2 - 1) * 0.079), rel=1e-6)
    assert penalty[1] < penalty[0] < penalty[2]


def test_negative_anchors_and_nans_are_never_chosen() -> None:
    maps = _maps()
    maps.anchor[:, 10, 10] = -1
    maps.cls1[1] = 5
    maps.loc[:, 10, 11] = np.nan
    maps.cls3[0, 10, 9] = np.inf
    decoded = decode(maps, TrackerSettings())
    ranked = rank(decoded, shape_penalty(decoded, 40, 40, 0.079), TrackerSettings())
    assert not decoded.usable[[220, 221, 219]].any()
    chosen = pick(decoded, ranked, (40, 40), 3)
    assert chosen
    assert not set(chosen) & {219, 220, 221}


def test_nothing_usable_gives_nothing() -> None:
    maps = _maps()
    maps.anchor[:] = np.nan
    decoded = decode(maps, TrackerSettings())
    assert pick(decoded, rank(decoded, shape_penalty(decoded, 40, 40, 0.079), TrackerSettings()), (40, 40), 3) == []


def test_candidates_lie_a_target_apart() -> None:
    maps = _maps()
    maps.cls2[1, 10, 10], maps.cls2[1, 10, 11], maps.cls2[1, 10, 18] = 6, 5, 4
    decoded = decode(maps, TrackerSettings())
    ranked = rank(decoded, shape_penalty(decoded, 40, 40, 0.079), TrackerSettings(window=0.0))
    assert pick(decoded, ranked, (40, 40), 2) == [220, 228]


@given(scale=st.floats(0, 1e6), seed=st.integers(0, 2**32 - 1), poison=st.sampled_from([0.0, np.nan, np.inf, -np.inf]))
@settings(max_examples=60)
def test_decoding_any_numbers_stays_finite(scale: float, seed: int, poison: float) -> None:
    rng = np.random.default_rng(seed)
    shapes = ((2, 21, 21), (2, 21, 21), (1, 21, 21), (4, 21, 21), (4, 21, 21))
    parts = [(rng.standard_normal(s) * scale).astype(np.float32) for s in shapes]
    for part in parts:
        part.flat[rng.integers(0, part.size, 5)] = poison
    decoded = decode(ResponseMaps(*parts), TrackerSettings())
    for values in (decoded.cx, decoded.cy, decoded.w, decoded.h, decoded.ranking, decoded.confidence):
        assert np.isfinite(values).all()
    assert ((decoded.confidence >= 0) & (decoded.confidence <= 1)).all()


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"penalty_k": -1}, "penalty_k"),
        ({"window": 2}, "window"),
        ({"size_lr": float("nan")}, "size_lr"),
        ({"search_px": 286}, "search_px"),
        ({"class_weights": [1, 2]}, "class_weights"),
        ({"class_weights": [0, 0, 0]}, "class_weights"),
        ({"centre_term": "cosine"}, "centre"),
        ({"windov": 0.4}, "windov"),
        ({"penalty_k": "x"}, "kind"),
    ],
)
def test_impossible_settings_are_named(values: dict[str, object], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        TrackerSettings.from_card(values)
