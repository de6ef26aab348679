"""The search plan: what is covered, what it costs, and that nonsense does no harm."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tracker.box import Box
from tracker.messages import SearchTile
from tracker.search_plan import (
    CORE_SIDES,
    MAX_SCALE,
    MAX_TILES,
    PlannedSearch,
    SearchPlan,
    SearchPlanConfig,
    SearchStage,
)
from tracker.siamapnpp.crop import exemplar_side_px

REGION, SWEEP, WHOLE, NO_PLACE = SearchStage.REGION, SearchStage.SWEEP, SearchStage.WHOLE, SearchStage.NO_PLACE
IMAGE = (640.0, 360.0)
BOX = Box(200.0, 150.0, 30.0, 40.0)
COV = (100.0, 0.0, 100.0)
BAD = (math.nan, math.inf, -math.inf)
CONFIG = SearchPlanConfig()

images = st.tuples(st.floats(16.0, 1920.0), st.floats(16.0, 1080.0))
sizes = st.floats(8.0, 300.0)
calls = st.integers(1, 6)


def side_px(box: Box) -> float:
    return exemplar_side_px(box.w_px, box.h_px) * CONFIG.search_sides


def windows(plan: PlannedSearch) -> tuple[SearchTile, ...]:
    return (SearchTile(plan.center_px, plan.scale), *plan.tiles)


def warm(n: int, fps: float) -> SearchPlan:
    """A plan that knows the rate of the pictures; those of 8, 16 and 32 per second have an exact period."""
    plan = SearchPlan()
    for k in range(2):
        assert plan.step(BOX, COV, IMAGE, 0.0, n, k / fps).stage is REGION
    return plan


def run(
    steps: int, box: Box = BOX, image: tuple[float, float] = IMAGE, n: int = 2, unseen_s: float = 5.0, fps: float = 32.0
) -> list[PlannedSearch]:
    plan = warm(n, fps)
    return [plan.step(box, COV, image, unseen_s, n, k / fps) for k in range(2, steps + 2)]


def elsewhere(plans: list[PlannedSearch], centre: tuple[float, float], n: int, fps: float = 32.0) -> list[SearchTile]:
    """The windows of a sweep, without the prediction's own, which comes every `own_s`."""
    found: list[SearchTile] = []
    every = max(math.ceil(CONFIG.own_s * fps - 1e-6), 1 if n > 1 else 2)
    for i, plan in enumerate(plans):
        own = i % every == 0
        assert not own or (plan.center_px == centre and plan.scale == 1.0)
        found += windows(plan)[1:] if own else windows(plan)
    return found


def per_second(n: int, fps: float) -> float:
    """Windows of a sweep that are searched in a second, on the average."""
    return max(n - min(1.0 / (fps * CONFIG.own_s), 1.0), 0.5) * fps


def covers(tiles: Sequence[SearchTile], side: float, image: tuple[float, float]) -> bool:
    """Whether every point of a fine grid, corners included, lies in the core of some tile (half a px of rounding)."""
    x, y = np.meshgrid(np.linspace(0.0, image[0], 33), np.linspace(0.0, image[1], 33))
    inside = np.zeros(x.shape, dtype=bool)
    for tile in tiles:
        reach = CORE_SIDES * side * tile.scale / 2 + 0.5
        inside |= np.maximum(abs(x - tile.center_px[0]), abs(y - tile.center_px[1])) <= reach
    return bool(inside.all())


@given(image=images, w=sizes, h=sizes, x=st.floats(-0.5, 1.5), y=st.floats(-0.5, 1.5), n=calls)
@settings(max_examples=30, deadline=None)
def test_one_sweep_covers_the_picture_and_then_starts_anew(
    image: tuple[float, float], w: float, h: float, x: float, y: float, n: int
) -> None:
    box = Box(x * image[0], y * image[1], w, h)
    centre = (min(max(box.cx_px, 0.0), image[0]), min(max(box.cy_px, 0.0), image[1]))
    plans = run(2 * MAX_TILES + 4 if n == 1 else MAX_TILES + 4, box, image, n)
    tiles = elsewhere(plans, centre, n)
    once = tiles[: len(set(tiles))]
    assume(len(once) < MAX_TILES)
    assert len(set(once)) == len(once)  # nothing twice before everything once
    assert covers(once, side_px(box), image)
    again = tiles.index(tiles[0], 1)
    assert len(once) == again  # all were there before the first came again


@given(image=images, w=sizes, h=sizes, n=calls, unseen=st.floats(0.0, 12.0), var=st.floats(0.0, 1e8))
@settings(max_examples=100, deadline=None)
def test_windows_are_few_in_the_picture_and_of_a_known_scale(
    image: tuple[float, float], w: float, h: float, n: int, unseen: float, var: float
) -> None:
    plan = SearchPlan()
    for k in range(8):
        found = plan.step(Box(k * 99.0 - 200.0, 80.0, w, h), (var, 0.0, var / 2), image, unseen, n, k / 30)
        assert len(windows(found)) <= n
        for tile in windows(found):
            assert 1.0 <= tile.scale <= MAX_SCALE
            assert 0.0 <= tile.center_px[0] <= image[0]
            assert 0.0 <= tile.center_px[1] <= image[1]


anything = st.floats(allow_nan=True, allow_infinity=True)


@given(st.lists(st.tuples(*[anything] * 14), min_size=1, max_size=4), st.integers(-3, 5))
@settings(max_examples=100, deadline=None)
def test_nothing_raises_and_everything_is_finite(steps: list[tuple[float, ...]], n: int) -> None:
    plan = SearchPlan()
    for a in steps:
        found = plan.step(Box(*a[:4]), (a[4], a[5], a[6]), (a[7], a[8]), a[9], n, a[10])
        plan.shift(a[11], a[12])
        assert len(windows(found)) <= max(n, 1)
        assert all(math.isfinite(v) for t in windows(found) for v in (*t.center_px, t.scale))


@pytest.mark.parametrize("bad", BAD)
def test_nonsense_gives_the_narrow_window_at_a_finite_place(bad: float) -> None:
    plan = SearchPlan()
    for box in (Box(bad, 150.0, 30.0, 40.0), Box(200.0, 150.0, bad, 40.0)):
        found = plan.step(box, COV, IMAGE, 5.0, 4, 0.0)
        assert (found.stage, found.scale, found.tiles) == (NO_PLACE, 1.0, ())
    assert plan.step(Box(bad, 150.0, 30.0, 40.0), COV, IMAGE, 5.0, 4, 0.0).center_px == (320.0, 150.0)
    assert plan.step(BOX, COV, (bad, 360.0), 5.0, 4, 0.0) == PlannedSearch((200.0, 150.0), 1.0, (), NO_PLACE)
    assert plan.step(BOX, (bad, 0.0, 1.0), IMAGE, 0.0, 1, 0.0) == PlannedSearch((200.0, 150.0), 1.0, (), REGION)
    plan.step(BOX, COV, IMAGE, 5.0, 2, 0.0)
    plan.shift(bad, 0.0)
    assert plan.step(BOX, COV, IMAGE, 5.0, 2, bad).tiles


@pytest.mark.parametrize("image", [(0.0, 360.0), (640.0, -1.0), (1e9, 1e9)])
def test_a_picture_without_area_or_beyond_all_size_is_no_picture(image: tuple[float, float]) -> None:
    assert SearchPlan().step(BOX, COV, image, 5.0, 4, 0.0).stage is NO_PLACE
    assert SearchPlan().step(Box(1.0, 1.0, 0.0, 40.0), COV, IMAGE, 5.0, 4, 0.0).stage is NO_PLACE


def test_region_alternates_the_narrow_window_with_one_that_grows_geometrically() -> None:
    plan = SearchPlan()
    found = [plan.step(BOX, COV, IMAGE, unseen, 1, unseen) for unseen in (0.0, 0.25, 0.5, 1.25, 1.5)]
    assert {f.stage for f in found} == {REGION}
    assert [f.scale for f in found] == pytest.approx([1.0, 2.0**0.125, 1.0, 2.0**0.625, 1.0])
    both = SearchPlan().step(BOX, COV, IMAGE, 1.0, 2, 0.0)
    assert windows(both) == (SearchTile((200.0, 150.0), 1.0), SearchTile((200.0, 150.0), 2.0**0.5))


def test_the_region_holds_the_ellipse_and_where_it_cannot_the_frame_is_swept() -> None:
    long_axis = side_px(BOX) * 0.8 / 2.0  # 2 sigma = 0.8 sides: 1.6 windows
    turned = (long_axis**2 / 2, long_axis**2 / 2, long_axis**2 / 2)  # along the diagonal
    assert SearchPlan().step(BOX, turned, IMAGE, 0.1, 2, 0.0).tiles[0].scale == pytest.approx(1.6)
    wide = (0.99 * side_px(BOX)) ** 2 / 4.0  # 2 sigma = 0.99 sides
    assert SearchPlan().step(BOX, (wide, 0.0, 1.0), IMAGE, 0.1, 2, 0.0).stage is REGION
    assert SearchPlan().step(BOX, (1.0, 0.0, wide * 1.05), IMAGE, 0.1, 2, 0.0).stage is SWEEP


@pytest.mark.parametrize("n", [1, 2, 3])
def test_the_frame_is_swept_from_its_time_on_nearest_first(n: int) -> None:
    plan = SearchPlan()
    assert plan.step(BOX, COV, IMAGE, CONFIG.region_s - 0.01, n, 0.0).stage is REGION
    plan.reset()
    plans = [plan.step(BOX, COV, IMAGE, CONFIG.region_s, n, k / 30) for k in range(12)]
    assert {p.stage for p in plans} == {SWEEP}
    tiles = elsewhere(plans, (200.0, 150.0), n, fps=30.0)
    away = [math.hypot(t.center_px[0] - 200.0, t.center_px[1] - 150.0) for t in tiles]
    assert all(a <= b + 1e-9 for a, b in pairwise(away[: len(set(tiles))]))


@pytest.mark.parametrize("fps", [8.0, 16.0, 32.0])
@pytest.mark.parametrize("n", [1, 2, 4])
@pytest.mark.parametrize("size", [20.0, 40.0, 90.0])
def test_a_sweep_takes_no_longer_than_planned_where_tiles_may_grow(fps: float, n: int, size: float) -> None:
    box = Box(200.0, 150.0, size, size)
    tiles = elsewhere(run(400, box, n=n, fps=fps), (200.0, 150.0), n, fps)
    seconds = len(set(tiles)) / per_second(n, fps)
    assert seconds <= CONFIG.sweep_s or tiles[0].scale == pytest.approx(CONFIG.tile_scale)
    if tiles[0].scale > 1.0:  # and they are no larger than they must be
        smaller = tiles[0].scale / 2.0 ** (1.0 / 8.0)
        step_px = CORE_SIDES * side_px(box) * smaller
        count = math.ceil(IMAGE[0] / step_px) * math.ceil(IMAGE[1] / step_px)
        assert count / per_second(n, fps) > CONFIG.sweep_s


def test_with_one_call_and_slow_pictures_the_sweep_goes_on_all_the_same() -> None:
    plans = run(40, Box(200.0, 150.0, 60.0, 60.0), n=1, fps=2.0)
    tiles = elsewhere(plans, (200.0, 150.0), 1, fps=2.0)
    assert len(tiles) == 20
    assert len(set(tiles)) > 5


def test_a_picture_that_fits_into_the_calls_of_a_step_says_so() -> None:
    large = Box(320.0, 180.0, 190.0, 190.0)
    found = SearchPlan().step(large, COV, IMAGE, 5.0, 3, 0.0)
    assert found.stage is WHOLE
    assert covers(list(found.tiles), side_px(large), IMAGE)
    assert SearchPlan().step(Box(320.0, 180.0, 40.0, 40.0), COV, IMAGE, 5.0, 3, 0.0).stage is SWEEP


def test_pending_tiles_move_with_the_picture() -> None:
    still, moved = SearchPlan(), SearchPlan()
    for plan in (still, moved):
        plan.step(BOX, COV, IMAGE, 5.0, 2, 0.0)
    moved.shift(12.0, -7.0)
    a, b = (p.step(BOX, COV, IMAGE, 5.0, 3, 0.1).tiles[0] for p in (still, moved))
    assert b.center_px == pytest.approx((a.center_px[0] + 12.0, a.center_px[1] - 7.0))


def test_tiles_that_left_the_picture_are_dropped_and_others_stay_in_it() -> None:
    always = SearchPlanConfig(own_s=0.0)
    plan = SearchPlan(always)
    plan.step(BOX, COV, IMAGE, 5.0, 2, 0.0)
    first = plan.step(BOX, COV, IMAGE, 5.0, 2, 0.0).tiles
    plan.shift(0.0, 5000.0)
    second = plan.step(BOX, COV, IMAGE, 5.0, 2, 0.0).tiles
    assert first != second == SearchPlan(always).step(BOX, COV, IMAGE, 5.0, 2, 0.0).tiles  # nothing was left: anew
    plan.shift(0.0, 150.0)
    for k in range(40):
        for tile in windows(plan.step(BOX, COV, IMAGE, 5.0, 2, 0.2 + k / 30)):
            assert 0.0 <= tile.center_px[1] <= IMAGE[1]


@pytest.mark.parametrize("corner", [(0.0, 0.0), (640.0, 360.0)])
def test_a_tile_that_still_reaches_into_the_picture_is_searched_at_its_edge(corner: tuple[float, float]) -> None:
    plan = SearchPlan()
    whole = plan.step(BOX, COV, IMAGE, 5.0, 1000, 0.0).tiles
    side, nearest = side_px(BOX), min(whole, key=lambda t: math.dist(t.center_px, corner))
    inside = [abs(c - at) for c, at in zip(nearest.center_px, corner, strict=True)]
    for beyond, searched in ((0.9, True), (1.1, False)):
        plan = SearchPlan()
        plan.step(BOX, COV, IMAGE, 5.0, 1, 0.0)
        way = [d + beyond * CORE_SIDES * side * nearest.scale / 2 for d in inside]
        plan.shift(*(-w if at == 0.0 else w for w, at in zip(way, corner, strict=True)))
        assert (corner in [t.center_px for t in windows(plan.step(BOX, COV, IMAGE, 5.0, 1000, 0.1))]) is searched


def test_a_sweep_goes_on_while_the_size_drifts_and_is_planned_anew_after_a_jump() -> None:
    plan, grown = (SearchPlan(SearchPlanConfig(own_s=0.0)) for _ in range(2))
    first = [p.step(BOX, COV, IMAGE, 5.0, 2, 0.0).tiles[0] for p in (plan, grown)]
    assert first[0] == first[1]
    next_px = plan.step(BOX, COV, IMAGE, 5.0, 2, 0.1).tiles[0].center_px
    drifted = Box(BOX.cx_px, BOX.cy_px, BOX.w_px * 0.95, BOX.h_px * 0.95)
    tile = grown.step(drifted, COV, IMAGE, 5.0, 2, 0.1).tiles[0]
    assert tile.center_px == next_px
    assert tile.scale * side_px(drifted) == pytest.approx(first[0].scale * side_px(BOX))
    small = Box(BOX.cx_px, BOX.cy_px, 12.0, 16.0)
    assert grown.step(small, COV, IMAGE, 5.0, 2, 0.2).tiles[0].scale < 3.0
    other, new = (
        p.step(BOX, COV, (1280.0, 720.0), 5.0, 2, 0.2).tiles[0] for p in (plan, SearchPlan(SearchPlanConfig(own_s=0.0)))
    )
    assert other == new or other.scale != first[0].scale


def test_the_smallest_target_in_a_large_picture_has_a_bounded_sweep() -> None:
    plans = run(MAX_TILES + 1, Box(900.0, 500.0, 4.0, 4.0), (3840.0, 2160.0))
    tiles = elsewhere(plans, (900.0, 500.0), 2)
    assert len(set(tiles)) == MAX_TILES
    assert tiles[MAX_TILES] == tiles[0]


def test_the_plan_is_deterministic_and_reset_forgets() -> None:
    plan = SearchPlan()
    runs = []
    for _ in range(2):
        plan.reset()
        runs.append([plan.step(BOX, COV, IMAGE, 1.8 + k / 30, 1, k / 30) for k in range(30)])
    assert runs[0] == runs[1]


@pytest.mark.parametrize("name", ["double_s", "region_scale", "region_s", "tile_scale", "sweep_s", "search_sides"])
@pytest.mark.parametrize("value", [-1.0, math.nan, 1e9])
def test_config_names_what_is_out_of_range(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"search plan {name}"):
        SearchPlanConfig(**{name: value})
