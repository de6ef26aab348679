from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from tests.tracker.selection.scenes import ground, put_car
from tracker.box import Box
from tracker.messages import ImageU8
from tracker.selection import MotionProposals, Proposal, Reason
from tracker.selection.ego_shift import estimate_motion, moved_points

WORLD = ground(5, (640, 480))
FPS = 20.0
CAMERA_PX_S = (40.0, -24.0)  # of the view over the world: the picture moves the other way
CAR_PX_S = (70.0, 0.0)


def _picture(t_s: float, car_px_s: tuple[float, float] | None = CAR_PX_S) -> tuple[ImageU8, Box]:
    """The view at a time, and where the car is in it."""
    x0, y0 = 100 + round(CAMERA_PX_S[0] * t_s), 120 + round(CAMERA_PX_S[1] * t_s)
    vx, vy = car_px_s or (0.0, 0.0)
    box = Box(200.0 + round(vx * t_s) - x0, 220.0 + round(vy * t_s) - y0, 30.0, 16.0)
    view = np.ascontiguousarray(WORLD[y0 : y0 + 240, x0 : x0 + 320])
    return put_car(view, box), box


def _run(
    steps: int = 20, fps: float = FPS, car: tuple[float, float] | None = CAR_PX_S
) -> tuple[tuple[Proposal, ...], Box]:
    motion, found, box = MotionProposals(), (), Box(0, 0, 0, 0)
    for k in range(steps):
        image, box = _picture(k / fps, car)
        found = motion.step(image, k / fps)
    return found, box


@pytest.mark.parametrize("fps", [10.0, 20.0, 30.0])
def test_the_moving_car_is_first_at_every_frame_rate(fps: float) -> None:
    found, box = _run(steps=round(fps), fps=fps)
    # Its trailing half looks as before: of a thing of one colour only the leading part may differ.
    assert found[0].box.iou(box) > 0.3
    assert found[0].reason is Reason.MOVING
    assert found[0].score > 0.4


def test_nothing_moves_when_only_the_camera_does() -> None:
    found, _ = _run(car=None)
    assert found == ()


def test_steady_things_rank_above_new_ones() -> None:
    assert _run(steps=20)[0][0].score > 1.5 * _run(steps=5)[0][0].score


def test_a_shift_from_the_gyroscopes_will_do() -> None:
    motion, found, box = MotionProposals(), (), Box(0, 0, 0, 0)
    for k in range(20):
        image, box = _picture(k / FPS)
        before = [round(v * (k - 1) / FPS) for v in CAMERA_PX_S]
        now = [round(v * k / FPS) for v in CAMERA_PX_S]
        found = motion.step(image, k / FPS, (float(before[0] - now[0]), float(before[1] - now[1])))
    assert found[0].box.iou(box) > 0.3
    # A wrong one must show, or the shift given was not used at all.
    wrong = MotionProposals()
    for k in range(8):
        wrongly = wrong.step(_picture(k / FPS, None)[0], k / FPS, (9.0, 9.0))
    assert wrongly != ()


def test_what_stops_is_forgotten() -> None:
    motion = MotionProposals()
    for k in range(12):
        found = motion.step(_picture(k / FPS)[0], k / FPS)
    assert len(found) == 1
    image, _ = _picture(11 / FPS)
    for k in range(12, 32):
        found = motion.step(image, k / FPS, (0.0, 0.0))
    assert found == ()


@pytest.mark.parametrize("bad_s", [math.nan, math.inf, 0.25, 0.1])
def test_a_bad_time_starts_afresh(bad_s: float) -> None:
    motion = MotionProposals()
    for k in range(6):
        motion.step(_picture(k / FPS)[0], k / FPS)
    assert motion.step(_picture(0.5)[0], bad_s) == ()
    for k in range(12):
        found = motion.step(_picture(k / FPS)[0], 10 + k / FPS)
    assert found[0].box.iou(_picture(11 / FPS)[1]) > 0.3


def test_another_size_or_no_texture_gives_nothing_and_raises_nothing() -> None:
    motion = MotionProposals()
    motion.step(_picture(0.0)[0], 0.0)
    assert motion.step(np.zeros((90, 160, 3), np.uint8), 0.05) == ()
    assert motion.step(np.zeros((90, 160, 3), np.uint8), 0.10) == ()
    assert motion.step(np.zeros((90, 160, 3), np.uint8), 0.15, (math.nan, 0.0)) == ()


def test_the_ground_is_followed_through_turn_and_zoom() -> None:
    grey = cv2.cvtColor(WORLD, cv2.COLOR_BGR2GRAY)
    truth = np.vstack((cv2.getRotationMatrix2D((320, 240), 2.0, 1.02), (0, 0, 1)))
    after = cv2.warpPerspective(grey, truth, (640, 480))
    found = estimate_motion(grey, after)
    assert found is not None
    points = np.array([[100.0, 100.0], [500.0, 100.0], [300.0, 400.0]])
    assert np.abs(moved_points(found, points) - moved_points(truth, points)).max() < 0.7


def test_without_corners_there_is_no_motion() -> None:
    assert estimate_motion(np.zeros((100, 100), np.uint8), np.zeros((100, 100), np.uint8)) is None


def test_the_place_that_was_left_is_no_part_of_it() -> None:
    found, box = _run(steps=15, car=(240.0, 0.0))  # by its own length and more between the pictures compared
    assert found[0].box.iou(box) > 0.6
    assert all(p.box.cx_px > box.cx_px - 20 for p in found)
