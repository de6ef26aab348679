from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sitl.render.order import Boxes, hiding, paint_order

EYE = np.array([0.0, 0.0, -10.0])


def boxes(*parts: tuple[tuple[float, float, float], tuple[float, float, float], float]) -> Boxes:
    return Boxes.stack([(np.array(c), np.array(h), yaw) for c, h, yaw in parts])


def order(items: Boxes, eye: np.ndarray = EYE) -> list[int]:
    count = len(items.yaw)
    return paint_order(items, np.zeros((count, 2)), np.ones((count, 2)), eye)


def test_a_long_wall_beside_the_way_does_not_hide_what_is_before_it() -> None:
    """By distance of the middles the wall would be drawn last; its face tells the truth."""
    wall = ((10.0, 6.0, -2.0), (40.0, 1.0, 2.0), 0.0)
    car = ((38.0, 3.0, -0.7), (2.2, 0.9, 0.7), 0.0)
    assert order(boxes(wall, car)) == [0, 1]
    assert order(boxes(car, wall)) == [1, 0]


def test_a_deck_hides_the_car_below_from_above_and_not_from_below() -> None:
    deck, car = ((20.0, 0.0, -5.0), (2.0, 9.0, 0.3), 0.0), ((20.0, 0.0, -0.7), (2.2, 0.9, 0.7), 0.0)
    assert order(boxes(deck, car)) == [1, 0]
    assert order(boxes(deck, car), np.array([16.0, 0.0, -1.8])) == [0, 1]


NUMBER = st.floats(-30, 30)
BOX = st.tuples(st.tuples(NUMBER, NUMBER, st.floats(-8, 0)), st.tuples(*[st.floats(0.2, 5)] * 3), st.floats(-3.2, 3.2))


@given(BOX, BOX, st.tuples(NUMBER, NUMBER, st.floats(-25, -1)), st.integers(0, 2**31))
def test_what_cannot_hide_never_does(a: tuple, b: tuple, eye: tuple[float, float, float], seed: int) -> None:  # type: ignore[type-arg]
    """Against brute force: points of both boxes on one line of sight, the nearer one tells who hides whom."""
    pair, point = boxes(a, b), np.array(eye)
    first, second = hiding(pair, np.array([0]), np.array([1]), point)
    rng = np.random.default_rng(seed)
    local = rng.uniform(-0.98, 0.98, (60, 3)) * pair.half[1]
    c, s = np.cos(pair.yaw[1]), np.sin(pair.yaw[1])
    targets = pair.centre[1] + np.stack(
        [local[:, 0] * c - local[:, 1] * s, local[:, 0] * s + local[:, 1] * c, local[:, 2]], axis=1
    )
    enter, leave = slab(pair, 0, point, targets)
    if (np.maximum(enter, 0) < np.minimum(leave, 1) - 1e-6).any():
        assert first[0]
    if ((enter > 1 + 1e-6) & (enter < leave - 1e-6)).any():
        assert second[0]


def slab(pair: Boxes, index: int, eye: np.ndarray, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where lines eye + t (target - eye) enter and leave a box."""
    c, s = np.cos(pair.yaw[index]), np.sin(pair.yaw[index])
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    start, way = turn @ (eye - pair.centre[index]), (targets - eye) @ turn.T
    way = np.where(np.abs(way) < 1e-12, 1e-12, way)
    t = np.stack([(side * pair.half[index] - start) / way for side in (-1, 1)])
    return t.min(axis=0).max(axis=1), t.max(axis=0).min(axis=1)


def test_a_circle_still_gives_every_box_once() -> None:
    beams = [((2.0, 0.0, -1.0), (3.0, 0.3, 0.3), k * 2.0944) for k in range(3)]
    assert sorted(order(boxes(*beams))) == [0, 1, 2]
