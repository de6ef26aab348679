"""`uavfollow track` with a click, a list and a preset."""

from __future__ import annotations

import json

import cv2
import pytest

from tests.cli.conftest import Material
from tracker.box import Box
from uavfollow.cli import build_parser


def _middle(box: str) -> str:
    x, y, w, h = map(float, box.split(","))
    return f"{x + w / 2:.0f},{y + h / 2:.0f}"


def _start(out) -> Box:
    row = (out / "track.csv").read_text().splitlines()[1].split(",")
    return Box.from_xywh(*map(float, row[2:6]))


def test_one_click_tracks_the_car(material: Material, tmp_path, cli) -> None:
    out = tmp_path / "o"
    result = cli(
        "track", material.folder, "--click", _middle(material.box), "--preset", "vehicle", "--max-frames", 3,
        "--no-video", "--out", out,
    )  # fmt: skip
    assert result.code == 0
    assert _start(out).iou(Box.from_xywh(*map(float, material.box.split(",")))) > 0.5
    told = json.loads((out / "summary.json").read_text())["settings"]
    assert told["preset"] == "vehicle"
    assert told["click"] == _middle(material.box)
    assert told["pick"] == 1
    assert told["targets"].startswith("1  ")
    assert "forced" not in told
    assert "took box 1 of " in result.out
    assert "--pick K takes another" in result.out


def test_targets_lists_the_moving_car_and_pick_takes_it(material: Material, tmp_path, cli) -> None:
    truth = Box.from_xywh(*map(float, material.box.split(",")))
    result = cli("track", material.folder, "--targets", "--out", tmp_path / "o")
    assert result.code == 0
    number, box, why, _ = next(line for line in result.out.splitlines() if "moving" in line).split()
    assert number == "1"
    assert why == "moving"
    assert Box.from_xywh(*map(float, box.split(","))).iou(truth) > 0.4  # with its shadow
    assert [p.name for p in (tmp_path / "o").iterdir()] == ["first_frame_proposals.png"]
    picture = cv2.imread(str(tmp_path / "o" / "first_frame_proposals.png"))
    assert picture.shape == (540, 960, 3)


def test_targets_of_a_click_and_a_pick(material: Material, tmp_path, cli) -> None:
    point = _middle(material.box)
    result = cli("track", material.folder, "--targets", "--click", point, "--out", tmp_path / "o")
    second = next(line for line in result.out.splitlines() if line.startswith("2 ")).split()[1]
    out = tmp_path / "p"
    picked = cli("track", material.folder, "--click", point, "--pick", 2, "--max-frames", 2, "--no-video", "--out", out)
    assert picked.code == 0
    assert _start(out).iou(Box.from_xywh(*map(float, second.split(",")))) > 0.95
    assert "took box 2 of " in picked.out
    assert json.loads((out / "summary.json").read_text())["settings"]["pick"] == 2


def test_the_list_as_json(material: Material, tmp_path, cli) -> None:
    result = cli("track", material.folder, "--targets", "--json", "--out", tmp_path / "o")
    told = json.loads(result.out)
    assert [t["number"] for t in told["targets"]] == list(range(1, len(told["targets"]) + 1))
    assert set(told["targets"][0]) == {"number", "box", "reason", "score", "unsuitable"}
    assert told["files"] == [str(tmp_path / "o" / "first_frame_proposals.png")]


def test_json_of_a_run_is_json_alone(material: Material, tmp_path, cli) -> None:
    options = ("--targets", "--pick", 1, "--json", "--max-frames", 2, "--no-video", "--out", tmp_path / "o")
    result = cli("track", material.folder, *options)
    assert json.loads(result.out) == json.loads((tmp_path / "o" / "summary.json").read_text()) | {
        "files": json.loads(result.out)["files"]
    }
    assert "took box 1 of " in result.err


def test_the_options_of_choosing_are_a_group_of_the_help() -> None:
    _, commands = build_parser()
    text = commands["track"].format_help()
    group = text[text.index("choosing the target:") :]
    assert all(f"  {option}" in group for option in ("--click", "--targets", "--pick", "--force", "--preset"))
    assert "--hfov-deg" not in group


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--click", "1,2,3"), "--click '1,2,3' is not X,Y"),
        (("--click", "nan,2"), "--click 'nan,2' is not X,Y"),
        (("--click", "700,20"), "outside of the frame of 640 x 360 px"),
        (("--click", "300,200", "--pick", "99"), "look at them with --targets"),
        (("--click", "300,200", "--pick", "0"), "numbered from 1"),
        (("--pick", "1"), "give one of them too"),
        (("--click", "3,3", "--box", "1,1,20,20"), "leave one out"),
        (("--targets", "--box", "1,1,20,20"), "leave one out"),
        (("--preset", "boat", "--raw", "--box", "50,50,20,20"), "--preset sets the filter"),
        (("--box", "50,50,20,6"), "too_small"),
        (("--box", "0,50,40,40"), "at_edge"),
        (("--box", "20,20,600,300"), "too_large"),
    ],
)
def test_bad_choices_are_refused(material: Material, tmp_path, cli, options, says: str) -> None:
    result = cli("track", material.folder, *options, "--out", tmp_path / "o")
    assert result.code == 2
    assert says in result.err
    assert result.err.count("\n") == 1
    assert not (tmp_path / "o").exists()


def test_force_overrides(material: Material, tmp_path, cli) -> None:
    out = tmp_path / "o"
    options = ("--box", "0,50,40,40", "--force", "--max-frames", 2, "--no-video", "--out", out)
    assert cli("track", material.folder, *options).code == 0
    assert json.loads((out / "summary.json").read_text())["settings"]["forced"] == "at_edge"
