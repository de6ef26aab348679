"""`uavfollow bench track` as it is typed."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from tests.benchmark.fakes import mark, write_sequence
from uavfollow import trackers
from uavfollow.__main__ import main
from uavfollow.benchmark.store import MARK

TWO = "fake+raw,fake@9+raw"


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_plots: None) -> Path:
    monkeypatch.setitem(trackers.BUILT_IN, "fake", trackers.BuiltIn("tests.benchmark.fakes:factory", ""))
    write_sequence(tmp_path / "data" / "a")
    return tmp_path / "data"


def _run(*arguments: object) -> int:
    return main(["bench", "track", *map(str, arguments)])


def test_the_means_and_the_places_are_printed(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert _run(data, "--tracker", TWO, "--out", out) == 0
    printed = capsys.readouterr().out
    assert "mean of 1 sequences, 12 images, mode honest" in printed
    assert "fake+raw    0.952  1.000" in printed
    assert f"wrote {out / 'table.md'}" in printed
    assert "lay there already" not in printed
    assert _run(data, "--tracker", "fake+raw", "--tracker", "fake@9+raw", "--out", out, "--mode", "toolkit") == 0
    printed = capsys.readouterr().out
    assert "mode toolkit" in printed
    assert "2 tracks lay there already and were not repeated" in printed


def test_json_is_the_summary(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ("--tracker", "fake", "--model", "9", "--max-frames", 5, "--fps", 10)
    assert _run(data, *options, "--json", "--out", tmp_path / "out") == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "out" / "summary.json").read_text())
    (sequence,) = printed["trackers"]["fake@9"]["by_sequence"].values()
    assert (sequence["frames"], sequence["whole_frames"], sequence["fps"]) == (5, 12, 10.0)
    assert (printed["max_frames"], printed["fps"]) == (5, 10.0)
    with (tmp_path / "out" / "fake@9" / "data" / "a.csv").open() as file:
        assert list(csv.DictReader(file).fieldnames or ()) == list(printed["frame_columns"])


def test_trackers_of_other_commands_are_named(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert _run(data, "--tracker", TWO, "--out", out) == 0
    assert "Not shown" not in capsys.readouterr().out
    assert _run(data, "--tracker", "fake@9+raw", "--out", out) == 0
    assert "Not shown: the folder also holds results of fake+raw;" in capsys.readouterr().out
    assert "Not shown: the folder also holds results of fake+raw;" in (out / "table.md").read_text()


def test_what_cannot_be_written_is_one_line_and_the_command_goes_on_from_there(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    write_sequence(data / "b")
    blocked = out / "fake" / "data" / "b.csv"
    blocked.mkdir(parents=True)
    (out / "bench.json").write_text(json.dumps(MARK))
    assert _run(data, "--tracker", "fake", "--out", out) == 2
    told = capsys.readouterr().err
    assert f"{blocked}: cannot be written (Is a directory); make room" in told
    assert told.count("\n") == 1
    blocked.rmdir()
    assert _run(data, "--tracker", "fake", "--out", out) == 0
    assert "1 tracks lay there already" in capsys.readouterr().out


def test_help_names_what_is_given(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        _run("--help")
    shown = capsys.readouterr().out
    assert "PATH [PATH ...]" in shown
    assert "--max-frames N" in shown


def test_falling_short_is_exit_code_1(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_sequence(data / "b", rows=3)
    assert _run(data, "--tracker", TWO, "--out", tmp_path / "out") == 1
    assert "1 not scored; the first: " in capsys.readouterr().out


def test_an_interruption_is_exit_code_130(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(trackers.BUILT_IN, "fake", trackers.BuiltIn("tests.benchmark.fakes:interrupting", ""))
    mark(write_sequence(data / "b"))
    assert _run(data, "--tracker", "fake+raw", "--out", tmp_path / "out") == 130
    assert "stopped; what was finished is kept, and the same command goes on where it was" in capsys.readouterr().err
    assert [path.stem for path in (tmp_path / "out").rglob("*.csv")] == ["a"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--tracker", "fak"], "did you mean fake"),
        (["--tracker", "fake,,fake+raw"], "--tracker fake,,fake+raw: a name is empty there"),
        (["--jobs", "0"], "--jobs 0 is out of range"),
        (["--max-frames", "1"], "--max-frames 1 is out of range"),
        (["--fps", "nan"], "--fps nan is out of range"),
        (["--trackers", "fake"], "did you mean --tracker"),
    ],
)
def test_bad_input_is_one_line(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert _run(data, "--out", tmp_path / "out", *arguments) == 2
    told = capsys.readouterr().err
    assert message in told
    assert told.count("\n") == 1
    assert not (tmp_path / "out").exists()
