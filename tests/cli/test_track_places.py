"""Where a run may write, what it replaces, and how it ends when it is stopped or the disk is full."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

import uavfollow
from tests.cli.conftest import FRAMES, Material
from uavfollow.app import App
from uavfollow.record.output import OutputFolder

SHORT = ("--max-frames", 3)


def _tree(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.mark.parametrize("what", ["source", "truth"])
def test_what_is_read_is_never_written_over(what: str, material: Material, tmp_path: Path, cli) -> None:
    out = tmp_path / "o"
    out.mkdir()
    source, truth = material.video, material.truth
    if what == "source":
        source = Path(shutil.copy(material.video, out / "overlay.mp4"))
    else:
        truth = Path(shutil.copy(material.truth, out / "track.csv"))
    before = _tree(out)
    result = cli("track", source, "--truth", truth, "--out", out)
    assert result.code == 2
    assert "would be written" in result.err
    assert _tree(out) == before


@pytest.mark.parametrize("inner", ["", "img"])
def test_outputs_never_become_pictures_of_the_source(inner: str, material: Material, tmp_path: Path, cli) -> None:
    folder = tmp_path / "sequence"
    shutil.copytree(material.folder, folder / inner)
    before = _tree(folder)
    result = cli("track", folder, "--box", material.box, "--out", folder / inner, *SHORT)
    assert result.code == 2
    assert "folder of the images" in result.err
    assert _tree(folder) == before


@pytest.mark.parametrize("name", ["track.csv", "overlay.mp4", "commands.png", "report.html"])
def test_a_folder_in_the_place_of_an_output_is_told_before_anything_is_replaced(
    name: str, material: Material, tmp_path: Path, cli
) -> None:
    out = tmp_path / "o"
    (out / name).mkdir(parents=True)
    (out / "setpoints.tlog").write_bytes(b"of yesterday")
    result = cli("track", material.video, "--box", material.box, "--out", out, *SHORT)
    assert result.code == 2
    assert f"{name} is a folder" in result.err
    assert _tree(out) == {"setpoints.tlog": b"of yesterday"}
    assert sorted(p.name for p in out.iterdir()) == sorted({name, "setpoints.tlog"})


def test_a_second_run_leaves_nothing_of_the_first_but_what_is_not_ours(material: Material, tmp_path: Path, cli) -> None:
    out = tmp_path / "o"
    assert cli("track", material.video, "--truth", material.truth, "--out", out).code == 0
    (out / "notes.txt").write_text("mine")
    tlog = tmp_path / "t.tlog"
    again = cli(
        "track", material.video, "--box", material.box, "--out", out, "--no-video", "--gimbal-mavlink", tlog, *SHORT
    )
    assert again.code == 0
    assert {p.name for p in out.iterdir()} == {
        "notes.txt", "track.csv", "commands.csv", "report.html", "summary.json", "snapshots.jpg", "commands.png",
    }  # fmt: skip
    assert str(tlog) in (out / "report.html").read_text()


def test_sources_of_one_name_do_not_share_a_default_folder(
    material: Material, tmp_path: Path, cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for parent in ("car", "boat"):
        shutil.copytree(material.folder, tmp_path / parent / "img")
        assert cli("track", tmp_path / parent / "img", "--box", material.box, "--no-video", *SHORT).code == 0
    assert cli("track", tmp_path / "car" / "img", "--box", material.box, "--no-video", *SHORT).code == 0
    assert sorted(p.name for p in (tmp_path / "runs").iterdir()) == ["track-boat", "track-car", "track-car-2"]


def test_the_summary_says_what_the_numbers_depend_on(material: Material, tmp_path: Path, cli) -> None:
    result = cli("track", material.video, "--box", material.box, "--out", tmp_path / "o", "--range-m", 35, *SHORT)
    assert "range_m 35" in result.out
    kept = json.loads((tmp_path / "o" / "summary.json").read_text())
    assert kept["settings"] == {
        "box": ",".join(f"{float(v):g}" for v in material.box.split(",")),
        "fps": 30.0,
        "hfov_deg": 66.0,
        "range_m": 35.0,
        "max_frames": 3,
        "preset": None,
        "raw": False,
        "source": str(material.video),
        "tracker": "siamapnpp",
        "truth": None,
        "version": uavfollow.__version__,
    }
    listed = {Path(name) for name in kept["files"]}
    assert listed == set((tmp_path / "o").iterdir())
    assert kept["interrupted"] is False


def test_material_that_is_mostly_unreadable_falls_short(material: Material, tmp_path: Path, cli) -> None:
    folder = tmp_path / "images"
    shutil.copytree(material.folder, folder)
    for number in range(5, FRAMES + 1):
        (folder / f"{number}.jpg").write_bytes(b"not a picture")
    result = cli("track", folder, "--box", material.box, "--out", tmp_path / "o", "--no-video")
    assert result.code == 1
    assert "20 frames with a fault" in result.out


@pytest.mark.parametrize("broken", ["write_image", "VideoWriter", "csv"])
def test_a_full_disk_is_one_line_and_leaves_nothing(
    broken: str, material: Material, tmp_path: Path, cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    import uavfollow.record.report
    import uavfollow.record.track_csv

    def full(*arguments: object) -> None:
        raise OSError(28, "No space left on device")

    if broken == "write_image":
        monkeypatch.setattr(uavfollow.record.report, "write_image", full)
    elif broken == "csv":
        monkeypatch.setattr(uavfollow.record.track_csv.TrackCsv, "write", full)
    else:  # OpenCV says nothing and writes nothing
        monkeypatch.setattr(cv2.VideoWriter, "write", lambda *a: None, raising=False)
        monkeypatch.setattr("uavfollow.video.writer.cv2.VideoWriter", _DeafWriter)
    out = tmp_path / "o"
    result = cli("track", material.video, "--box", material.box, "--out", out, *SHORT)
    assert result.code == 2
    assert result.err.count("\n") == 1
    assert "space" in result.err
    assert not out.exists()


class _DeafWriter:
    """A video writer on a full disk."""

    fourcc = staticmethod(cv2.VideoWriter.fourcc)

    def __init__(self, path: str, *arguments: object) -> None:
        Path(path).write_bytes(b"")

    def isOpened(self) -> bool:
        return True

    def write(self, image: np.ndarray) -> None:
        return

    def release(self) -> None:
        return


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_run_that_is_ended_from_outside_keeps_what_it_has(
    number: int, material: Material, tmp_path: Path, cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = signal.getsignal(number)
    step, commit = App.step, OutputFolder.commit

    def struck_step(self: App, *arguments: object) -> object:
        if self._seq == 6:
            signal.raise_signal(number)
        return step(self, *arguments)

    def struck_commit(self: OutputFolder, *arguments: object, **named: object) -> object:
        signal.raise_signal(number)  # impatience changes nothing
        return commit(self, *arguments, **named)

    monkeypatch.setattr(App, "step", struck_step)
    monkeypatch.setattr(OutputFolder, "commit", struck_commit)
    out = tmp_path / "o"
    result = cli("track", material.video, "--box", material.box, "--out", out)
    assert result.code == 130
    assert "6 frames, then interrupted" in result.out
    assert (out / "track.csv").read_text().count("\n") == 1 + 6
    assert json.loads((out / "summary.json").read_text())["interrupted"] is True
    assert not [p for p in out.iterdir() if "partial" in p.name]
    assert signal.getsignal(number) is before


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["track", ""], "empty"),
        (["track", "a\udcff.mp4"], "not UTF-8"),
        (["track", "a.mp4", "--box", "-20,-20,50,50"], "--box=-20"),
        (["track", "x" * 300 + ".mp4", "--box", "1,2,30,40"], "name too long"),
        (["track", "/proc", "--box", "1,2,30,40", "--out", "y" * 300], "holds no images"),
        (["weights", "info", "x" * 300], "name too long"),
        (["weights", "import", "x" * 300], "name too long"),
    ],
)
def test_absurd_arguments_are_one_line(arguments: list[str], expected: str, cli) -> None:
    result = cli(*arguments)
    assert result.code == 2
    assert expected.lower() in result.err.lower()
    assert result.err.count("\n") == 1


def test_a_box_from_the_truth_that_cannot_be_is_named_as_such(material: Material, tmp_path: Path, cli) -> None:
    truth = tmp_path / "truth.txt"
    truth.write_text("\ufeff5000,10,30,30\n" + "nan,nan,nan,nan\n" * (FRAMES - 1), encoding="utf-8")
    result = cli("track", material.video, "--truth", truth, "--out", tmp_path / "o")
    assert result.code == 2
    assert "--truth, first row" in result.err


@pytest.mark.parametrize("row", ["inf,1,2,3", "1e308,1,30,30"])
def test_truth_that_is_no_place_is_named(row: str, material: Material, tmp_path: Path, cli) -> None:
    truth = tmp_path / "truth.txt"
    truth.write_text(f"{row}\n" * FRAMES)
    result = cli("track", material.video, "--truth", truth, "--out", tmp_path / "o")
    assert result.code == 2
    assert "line 1" in result.err


def test_a_closed_standard_error_is_no_fault(material: Material, tmp_path: Path) -> None:
    command = f'"{sys.executable}" -m uavfollow track "{material.video}" --box {material.box} --max-frames 3 2>&-'
    run = subprocess.run(
        ["sh", "-c", f'{command} --out "{tmp_path / "o"}"'], capture_output=True, text=True, env={**os.environ}
    )
    assert run.returncode == 0
    assert "report:" in run.stdout
