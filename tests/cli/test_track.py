"""`uavfollow track` as its user runs it: what it writes, and what it says to bad input."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from pymavlink import mavutil

from tests.cli.conftest import FRAMES, Material
from tracker.box import Box

WRITTEN = {
    "track.csv",
    "commands.csv",
    "overlay.mp4",
    "setpoints.tlog",
    "report.html",
    "summary.json",
    "commands.png",
    "snapshots.jpg",
    "centre_error.png",
}


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def _messages(path: Path) -> list[object]:
    log = mavutil.mavlink_connection(str(path))
    messages = []
    while (message := log.recv_match()) is not None:
        messages.append(message)
    return messages


@pytest.fixture(scope="module")
def tracked(material: Material, tmp_path_factory: pytest.TempPathFactory) -> Path:
    from uavfollow.__main__ import main

    out = tmp_path_factory.mktemp("run") / "out"
    assert main(["track", str(material.video), "--truth", str(material.truth), "--out", str(out)]) == 0
    return out


def test_everything_is_written_and_nothing_else(tracked: Path) -> None:
    assert {p.name for p in tracked.iterdir()} == WRITTEN


def test_rows_follow_the_target(tracked: Path, material: Material) -> None:
    rows = _rows(tracked / "track.csv")
    assert list(rows[0]) == ["frame", "t_s", "x", "y", "w", "h", "confidence", "status", "reason"]
    assert [int(r["frame"]) for r in rows] == list(range(FRAMES))
    assert [r["status"] for r in rows[-10:]] == ["LOCKED"] * 10
    assert rows[0]["reason"] == "selected"
    assert float(rows[12]["t_s"]) == pytest.approx(12 / 30, abs=1e-6)
    for row, line in zip(rows, material.truth.read_text().splitlines(), strict=True):
        found = Box.from_xywh(*(float(row[k]) for k in "xywh"))
        assert found.iou(Box.from_xywh(*map(float, line.split(",")))) > 0.5


def test_the_overlay_has_every_frame_in_the_sources_size(tracked: Path) -> None:
    capture = cv2.VideoCapture(str(tracked / "overlay.mp4"))
    assert int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) == FRAMES
    assert (int(capture.get(3)), int(capture.get(4))) == (640, 360)


def test_the_setpoints_are_a_tlog_that_mavutil_reads(tracked: Path) -> None:
    messages = _messages(tracked / "setpoints.tlog")
    kinds = [m.get_type() for m in messages]
    assert kinds.count("GIMBAL_MANAGER_SET_ATTITUDE") == kinds.count("SET_POSITION_TARGET_LOCAL_NED") == FRAMES + 1
    assert kinds.count("HEARTBEAT") == 1
    rates = [m for m in messages if m.get_type() == "GIMBAL_MANAGER_SET_ATTITUDE"]
    # The car drives left of and below the picture's centre: the camera is to turn left and down.
    assert rates[-2].angular_velocity_z < -0.01
    assert rates[-2].angular_velocity_y < -0.01
    assert all(np.isnan(m.q).all() and m.flags == 44 for m in rates)
    velocity = [m for m in messages if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]
    assert {(m.type_mask, m.coordinate_frame) for m in velocity} == {(1479, 1)}
    assert velocity[-2].yaw_rate < -0.01
    assert (rates[-1].angular_velocity_y, rates[-1].angular_velocity_z) == (0, 0)
    assert (velocity[-1].vx, velocity[-1].vy, velocity[-1].vz, velocity[-1].yaw_rate) == (0, 0, 0, 0)
    stamps = [m._timestamp for m in messages]
    assert stamps == sorted(stamps)
    assert stamps[-1] - stamps[0] == pytest.approx((FRAMES - 1) / 30, abs=1e-4)


def test_the_report_names_the_scores_and_its_pictures_exist(tracked: Path) -> None:
    page = (tracked / "report.html").read_text()
    assert "success AUC" in page
    for name in ("snapshots.jpg", "centre_error.png", "commands.png"):
        assert f'src="{name}"' in page
        assert cv2.imread(str(tracked / name)) is not None


def test_every_command_has_a_reason(tracked: Path) -> None:
    commands, track = _rows(tracked / "commands.csv"), _rows(tracked / "track.csv")
    assert [c["frame"] for c in commands] == [t["frame"] for t in track]
    for command, row in zip(commands, track, strict=True):
        moves = any(float(command[k]) != 0 for k in ("north_m_s", "east_m_s", "down_m_s", "yaw_rate_rad_s"))
        if row["status"] not in ("LOCKED", "COASTING"):
            assert command["vehicle_reason"] == command["gimbal_reason"] == "hold_no_target"
            assert not moves
    assert {c["vehicle_reason"] for c in commands} > {"hold_no_target"}
    assert commands[0]["range_m"] == "20.000"


def test_a_folder_of_images_and_json(material: Material, tmp_path: Path, cli) -> None:
    result = cli(
        "track",
        material.folder,
        "--truth",
        material.truth,
        "--fps",
        10,
        "--out",
        tmp_path / "o",
        "--json",
        "--no-video",
        "--raw",
    )
    assert result.code == 0
    summary = json.loads(result.out)
    assert summary["frames"] == FRAMES
    assert summary["duration_s"] == pytest.approx(FRAMES / 10)
    assert summary["status_share"] == {"LOCKED": 1.0}
    assert summary["scores"]["auc"] > 0.6
    assert summary["scores"]["p20"] == 1.0
    assert set(summary["rates_fps"]) == {"read", "track", "filter", "write", "total"}
    assert not (tmp_path / "o" / "overlay.mp4").exists()


def test_scores_are_those_of_the_written_boxes(tracked: Path, material: Material, tmp_path: Path, cli) -> None:
    result = cli("track", material.video, "--truth", material.truth, "--out", tmp_path / "o", "--json")
    rows = _rows(tmp_path / "o" / "track.csv")
    truth = [Box.from_xywh(*map(float, line.split(","))) for line in material.truth.read_text().splitlines()]
    overlaps = np.array(
        [Box.from_xywh(*(float(r[k]) for k in "xywh")).iou(t) for r, t in zip(rows, truth, strict=True)]
    )
    auc = np.mean([(overlaps > t).mean() for t in np.linspace(0, 1, 21)])
    assert json.loads(result.out)["scores"]["auc"] == pytest.approx(auc, abs=0.003)
    # The same input gives the same rows.
    assert rows == _rows(tracked / "track.csv")


def test_without_a_box_a_grid_is_drawn(material: Material, tmp_path: Path, cli) -> None:
    result = cli("track", material.video, "--out", tmp_path / "o")
    assert result.code == 2
    assert "--box X,Y,W,H" in result.err
    grid = tmp_path / "o" / "first_frame_grid.png"
    assert str(grid) in result.err
    assert cv2.imread(str(grid)).shape == (360, 640, 3)
    assert [p.name for p in (tmp_path / "o").iterdir()] == [grid.name]


def test_one_damaged_image_is_survived_and_told(material: Material, tmp_path: Path, cli) -> None:
    folder = tmp_path / "images"
    shutil.copytree(material.folder, folder)
    (folder / "12.jpg").write_bytes(b"not a picture")
    cv2.imwrite(str(folder / "15.jpg"), np.zeros((90, 160, 3), np.uint8))  # of another size
    result = cli("track", folder, "--box", material.box, "--out", tmp_path / "o")
    assert result.code == 0
    assert "2 frames with a fault; the first: frame 11" in result.out
    rows = _rows(tmp_path / "o" / "track.csv")
    assert len(rows) == FRAMES
    assert rows[11]["status"] != "LOCKED"
    assert [float(r["t_s"]) for r in rows] == pytest.approx([k / 30 for k in range(FRAMES)], abs=1e-5)
    assert rows[-1]["status"] == "LOCKED"


def test_the_tlog_can_go_elsewhere_and_is_never_overwritten(material: Material, tmp_path: Path, cli) -> None:
    tlog = tmp_path / "mine.tlog"
    arguments = ("track", material.video, "--box", material.box, "--out", tmp_path / "o", "--max-frames", 4)
    assert cli(*arguments, "--gimbal-mavlink", tlog).code == 0
    assert not (tmp_path / "o" / "setpoints.tlog").exists()
    before = tlog.read_bytes()
    result = cli(*arguments, "--gimbal-mavlink", tlog)
    assert result.code == 2
    assert "exists already" in result.err
    assert tlog.read_bytes() == before


def test_an_interruption_keeps_what_there_is(
    material: Material, tmp_path: Path, cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    from uavfollow.app import App

    step = App.step

    def interrupted(self: App, *arguments: object) -> object:
        if self._seq == 6:
            raise KeyboardInterrupt
        return step(self, *arguments)

    monkeypatch.setattr(App, "step", interrupted)
    result = cli("track", material.video, "--box", material.box, "--out", tmp_path / "o")
    assert result.code == 130
    assert len(_rows(tmp_path / "o" / "track.csv")) == 6
    assert _messages(tmp_path / "o" / "setpoints.tlog")


def _truncate(source: Path, target: Path, share: float) -> Path:
    data = source.read_bytes()
    target.write_bytes(data[: int(len(data) * share)])
    return target


def _truncated_avi(material: Material, tmp_path: Path) -> Path:
    """A container whose index is lost with its end: it opens, and delivers fewer frames than it announces."""
    path = tmp_path / "whole.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30, (640, 360))
    for image in sorted(material.folder.iterdir(), key=lambda p: int(p.stem)):
        writer.write(cv2.imread(str(image)))
    writer.release()
    return _truncate(path, tmp_path / "cut.avi", 0.5)


BAD_INPUT = {
    "missing source": (lambda m, t: ["nowhere.mp4", "--box", m.box], "no such file or folder"),
    "empty file": (lambda m, t: [_truncate(m.video, t / "e.mp4", 0), "--box", m.box], "empty"),
    "truncated video": (lambda m, t: [_truncate(m.video, t / "t.mp4", 0.6), "--box", m.box], "truncated"),
    "truncated avi": (lambda m, t: [_truncated_avi(m, t), "--box", m.box], "truncated"),
    "not a video": (lambda m, t: [m.truth, "--box", m.box], "not a readable video"),
    "empty folder": (lambda m, t: [t, "--box", m.box], "holds no images"),
    "box outside": (lambda m, t: [m.video, "--box", "630,300,40,40"], "outside the frame of 640 x 360"),
    "box too small": (lambda m, t: [m.video, "--box", "100,100,3,20"], "at least 4 px"),
    "box nan": (lambda m, t: [m.video, "--box", "nan,100,30,20"], "finite"),
    "box inf": (lambda m, t: [m.video, "--box", "10,100,inf,20"], "finite"),
    "box of words": (lambda m, t: [m.video, "--box", "left,100,30,20"], "four numbers"),
    "box of three": (lambda m, t: [m.video, "--box", "100,30,20"], "four numbers"),
    "no such camera": (lambda m, t: ["63", "--box", m.box], "camera 63"),
    "fps": (lambda m, t: [m.folder, "--box", m.box, "--fps", "0"], "--fps"),
    "fps nan": (lambda m, t: [m.folder, "--box", m.box, "--fps", "nan"], "--fps"),
    "hfov": (lambda m, t: [m.video, "--box", m.box, "--hfov-deg", "nan"], "--hfov-deg"),
    "range": (lambda m, t: [m.video, "--box", m.box, "--range-m", "-1"], "--range-m"),
    "threads": (lambda m, t: [m.video, "--box", m.box, "--threads", "0"], "--threads"),
    "no such model": (lambda m, t: [m.video, "--box", m.box, "--model", "xl"], "a model is `s`, `full`"),
    "foreign weights": (lambda m, t: [m.video, "--box", m.box, "--model", m.video], "not a safetensors file"),
    "truth missing": (lambda m, t: [m.video, "--truth", t / "none.txt"], "cannot be read"),
    "truth too short": (lambda m, t: [m.video, "--truth", _truth(t, "1,2,30,40\n")], "1 rows for 24 frames"),
    "truth of words": (lambda m, t: [m.video, "--truth", _truth(t, "1,2,a,4\n")], "line 1"),
    "truth of three": (lambda m, t: [m.video, "--truth", _truth(t, "1,2,3,4\n1,2,3\n")], "line 2: 3 numbers"),
    "truth empty": (lambda m, t: [m.video, "--truth", _truth(t, "")], "empty"),
    "truth starts absent": (lambda m, t: [m.video, "--truth", _truth(t, "nan,nan,nan,nan\n" * 24)], "--box"),
    "cuda": (lambda m, t: [m.video, "--box", m.box, "--device", "cuda"], "CUDA"),
    "link that does not parse": (
        lambda m, t: [m.video, "--box", m.box, "--gimbal-mavlink", "udpin:0.0.0.0"],
        "--gimbal-mavlink: link address 'udpin:0.0.0.0': has no port",
    ),
    "tlog without its ending": (
        lambda m, t: [m.video, "--box", m.box, "--gimbal-mavlink", t / "x.log"],
        "end in .tlog",
    ),
    "setpoints to a vehicle": (
        lambda m, t: [m.video, "--box", m.box, "--gimbal-mavlink", "udpout:127.0.0.1:14550"],
        "sent to no vehicle",
    ),
    "tlog in no folder": (lambda m, t: [m.video, "--box", m.box, "--gimbal-mavlink", t / "no" / "x.tlog"], "x.tlog"),
    "option misspelt": (lambda m, t: [m.video, "--bxo", m.box], "did you mean --box?"),
    "option of another": (lambda m, t: [m.video, "--precision", "fp8"], "fp8"),
}


def _truth(folder: Path, text: str) -> Path:
    path = folder / "truth.txt"
    path.write_text(text)
    return path


@pytest.mark.parametrize("case", BAD_INPUT)
def test_bad_input_is_one_clear_line_and_leaves_nothing(case: str, material: Material, tmp_path: Path, cli) -> None:
    import torch

    if case == "cuda" and torch.cuda.is_available():
        pytest.skip("this machine has CUDA")
    work, out = tmp_path / "work", tmp_path / "results" / "out"
    work.mkdir()
    arguments, word = BAD_INPUT[case]
    result = cli("track", *arguments(material, work), "--out", out)
    assert result.code == 2
    assert len(result.err.strip().splitlines()) == 1, result.err
    assert result.err.startswith("uavfollow: error: ")
    assert word in result.err
    assert not out.parent.exists()


def test_an_output_folder_that_cannot_be_written(material: Material, tmp_path: Path, cli) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("mine")
    result = cli("track", material.video, "--box", material.box, "--out", blocked / "out")
    assert result.code == 2
    assert "cannot be written" in result.err
    assert blocked.read_text() == "mine"


def test_a_place_where_nobody_may_write(material: Material, cli) -> None:
    result = cli("track", material.video, "--box", material.box, "--out", "/proc/uavfollow")  # not even root
    assert result.code == 2
    assert "cannot be written" in result.err


def test_a_failing_run_leaves_an_older_result_alone(
    material: Material, tmp_path: Path, cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "o"
    assert cli("track", material.video, "--box", material.box, "--out", out, "--max-frames", 3).code == 0
    before = {p.name: p.read_bytes() for p in out.iterdir()}
    from uavfollow.record import plots

    monkeypatch.setattr("uavfollow.record.report.plot_commands", _explode)
    assert plots.plot_commands is not _explode
    result = cli("track", material.video, "--box", material.box, "--out", out, "--max-frames", 5)
    assert result.code == 2
    assert "disk full" in result.err
    assert {p.name: p.read_bytes() for p in out.iterdir()} == before


def _explode(*_: object) -> None:
    raise OSError("disk full")


def test_real_sequences_are_tracked(sequences: Path, tmp_path: Path, cli) -> None:
    folder = sequences / "UAV123_10fps" / "truck4_1"
    result = cli(
        "track",
        folder,
        "--truth",
        folder / "groundtruth_rect.txt",
        "--fps",
        10,
        "--out",
        tmp_path / "o",
        "--json",
        "--no-video",
    )
    assert result.code == 0
    scores = json.loads(result.out)["scores"]
    assert scores["auc"] > 0.5
    assert scores["p20"] > 0.9
