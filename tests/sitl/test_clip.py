"""The drawn clip: deterministic, with a target that is hidden for about a second, and truth that fits the pixels."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from sitl.clip import FPS, HIDDEN_BELOW, Clip, main, write_clip


@pytest.fixture(scope="module")
def clip() -> Clip:
    return Clip()


def test_the_same_seed_draws_the_same_picture(clip: Clip) -> None:
    again, other = Clip(), Clip(seed=8)
    assert np.array_equal(clip.frame(40).image_bgr_u8, again.frame(40).image_bgr_u8)
    assert not np.array_equal(clip.frame(40).image_bgr_u8, other.frame(40).image_bgr_u8)


def test_the_tree_hides_the_car_for_about_a_second_in_the_middle(clip: Clip) -> None:
    visible = np.array([clip.frame(k).visible for k in range(0, clip.count, 3)])
    hidden = np.flatnonzero(visible < HIDDEN_BELOW)
    assert 0.9 <= len(hidden) * 3 / FPS <= 1.8
    assert hidden.tolist() == list(range(hidden[0], hidden[-1] + 1))
    assert visible[:30].min() == visible[-30:].min() == 1.0


@pytest.mark.parametrize("k", [0, 90, 299])
def test_the_box_holds_the_red_car_and_nothing_else_is_red(clip: Clip, k: int) -> None:
    frame = clip.frame(k)
    blue, green, red = (frame.image_bgr_u8[..., i].astype(int) for i in range(3))
    rows, columns = np.nonzero((red > 120) & (green < 90) & (blue < 90))
    x1, y1, x2, y2 = frame.box.to_corners()
    assert abs(columns.min() - x1) <= 3
    assert abs(columns.max() + 1 - x2) <= 5  # the lamps at the nose are not red
    assert abs(rows.min() - y1) <= 3
    assert abs(rows.max() + 1 - y2) <= 3


def test_it_writes_a_video_with_a_row_of_truth_per_frame(tmp_path: Path) -> None:
    video, truth = write_clip(tmp_path / "deep" / "clip")
    capture = cv2.VideoCapture(str(video))
    assert int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) == len(truth.read_text().splitlines()) == 300
    assert capture.get(cv2.CAP_PROP_FPS) == FPS


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert main(["--out", str(tmp_path / "file" / "clip")]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
