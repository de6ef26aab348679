"""A whole benchmark in this process: results, resume, what breaks, what is interrupted."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.benchmark import fakes
from tests.benchmark.conftest import BRIGHT, RAW
from tests.benchmark.fakes import mark, write_sequence
from tracker.box import Box
from tracker.messages import Frame
from uavfollow.benchmark import plan
from uavfollow.benchmark.options import BenchOptions
from uavfollow.benchmark.run import run_bench
from uavfollow.errors import InputError
from uavfollow.interrupts import orderly_end
from uavfollow.trackers import TrackerSpec

Make = Callable[..., BenchOptions]
OFFSET = TrackerSpec("bright", "9", True)  # overlap 1/7, centre error 9 px
RAISES = TrackerSpec("raises", "", False)
PNG = b"\x89PNG"


@pytest.fixture(autouse=True)
def code(monkeypatch: pytest.MonkeyPatch) -> None:
    """The code does not change while these tests run, whoever edits it."""
    monkeypatch.setattr(plan, "code_hash", lambda: "this code")


@pytest.fixture
def starts(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """One entry for each sequence that is tracked."""
    begun: list[int] = []
    init = fakes.BrightTracker.init

    def counted(self: fakes.BrightTracker, frame: Frame, box: Box) -> None:
        begun.append(frame.seq)
        init(self, frame, box)

    monkeypatch.setattr(fakes.BrightTracker, "init", counted)
    return begun


def _data(folder: Path, *names: str) -> None:
    for name in names:
        write_sequence(folder / "data" / name)


def test_everything_is_written(options: Make, tmp_path: Path) -> None:
    _data(tmp_path, "a")
    write_sequence(tmp_path / "data" / "b", frames=20, absent=range(8, 13))
    result = run_bench(options(RAW, OFFSET))
    out = tmp_path / "out"
    assert {path.relative_to(out).as_posix() for path in result.files} == {
        "table.md", "summary.csv", "summary.json", "success.png", "precision.png", "calibration.png", "plots",
    }  # fmt: skip
    plots = sorted((out / "plots").rglob("*.png"))
    assert [plot.stem for plot in plots] == ["a", "b"]
    assert all(path.read_bytes().startswith(PNG) for path in [*plots, *out.glob("*.png")])
    dataset = plots[0].parent.name
    assert (out / "bright+raw" / dataset / "b.csv").is_file()
    table = (out / "table.md").read_text()
    assert f"| {dataset}/b | 20 | 0.952 / 1.000 / 1.000 | " in table  # a perfect track: 20 of 21 thresholds
    assert "| **mean** (2 sequences) | 27 counted | **0.952 / 1.000 / 1.000** | **" in table
    values = json.loads((out / "summary.json").read_text())["trackers"]
    assert values["bright+raw"]["false_confirmed_share"] == pytest.approx(5 / 32)  # absent, and bare means LOCKED
    assert values["bright@9+raw"]["false_confirmed_share"] == pytest.approx((5 + 11 + 14) / 32)
    assert values["bright@9+raw"]["by_sequence"][f"{dataset}/a"]["p20"] == 1.0
    assert values["bright+raw"]["reliability"]["frames"] == 11 + 19  # the first box was given
    with (out / "summary.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["tracker"], row["sequence"], row["frames"]) for row in rows][:2] == [
        ("bright+raw", "a", "12"),
        ("bright@9+raw", "a", "12"),
    ]


@pytest.mark.usefixtures("no_plots")
def test_beside_as_here(options: Make, tmp_path: Path) -> None:
    _data(tmp_path, "a")
    mark(write_sequence(tmp_path / "data" / "b"))
    here, beside = (run_bench(options(RAISES, jobs=n, out=tmp_path / f"out{n}")).report for n in (1, 2))
    assert here.failures == beside.failures
    (score,), (other,) = here.scores, beside.scores
    assert score.confidence.tolist() == other.confidence.tolist()
    assert score.errors_px.tolist() == other.errors_px.tolist()


@pytest.mark.usefixtures("no_plots")
def test_what_is_finished_is_not_repeated(
    options: Make, tmp_path: Path, starts: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    _data(tmp_path, "a", "b")
    first = run_bench(options())
    assert (len(starts), first.report.reused) == (2, 0)
    again = run_bench(options())
    assert (len(starts), again.report.reused) == (2, 2)
    assert [s.curves.auc for s in again.report.scores] == [s.curves.auc for s in first.report.scores]  # type: ignore[union-attr]
    _data(tmp_path, "c")
    run_bench(options(BRIGHT, RAW))  # one more sequence, one more tracker
    assert len(starts) == 2 + 1 + 3
    (tmp_path / "data" / "a" / "img" / "0005.png").unlink()
    (tmp_path / "data" / "a" / "img" / "0005.png").write_bytes(b"another picture")
    run_bench(options(BRIGHT, RAW))
    assert len(starts) == 6 + 2
    monkeypatch.setattr(plan, "code_hash", lambda: "other code")
    run_bench(options(BRIGHT, RAW))
    assert len(starts) == 8 + 6


@pytest.mark.usefixtures("no_plots")
def test_a_broken_sequence_is_reported_and_the_rest_go_on(
    options: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _data(tmp_path, "a", "c")
    mark(write_sequence(tmp_path / "data" / "b"))
    write_sequence(tmp_path / "data" / "d", rows=5)
    report = run_bench(options(RAISES, RAW)).report
    unread, broke = (str(failure) for failure in report.failures)
    assert "groundtruth_rect.txt" in unread
    assert "5 rows for 12 images" in unread
    assert "/b with raises: image " in broke
    assert "RuntimeError: no more of this" in broke
    told = capsys.readouterr().err
    assert f"left out: {unread}" in told
    assert f"failed: {broke}" in told
    assert len(report.scores) == 5
    assert {score.name[-1] for score in report.compared} == {"a", "c"}
    table = (tmp_path / "out" / "table.md").read_text()
    assert "/b | 12 | - | 0.952 / 1.000 / 1.000 |" in table
    assert "| **mean** (2 sequences) | 24 counted |" in table
    assert "Means are over the sequences that every tracker finished." in table
    assert f"- {broke}" in table


def test_nothing_to_score_is_an_error(options: Make, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=str(tmp_path / "data")):
        run_bench(options())
    (tmp_path / "data").mkdir()
    with pytest.raises(InputError, match=str(tmp_path / "data")):
        run_bench(options())
    mark(write_sequence(tmp_path / "data" / "b"))
    with pytest.raises(InputError, match=r"no sequence could be tracked; the first: .*/b with raises: image "):
        run_bench(options(RAISES))
    assert not (tmp_path / "out" / "table.md").exists()


@pytest.mark.usefixtures("no_plots")
def test_other_data_of_the_same_names_does_not_replace_results(
    options: Make, tmp_path: Path, starts: list[int]
) -> None:
    for place, frames in (("x", 4), ("y", 5)):
        write_sequence(tmp_path / place / "data" / "a", frames=frames)
    run_bench(options(paths=(tmp_path / "x" / "data",)))
    with pytest.raises(InputError, match="holds the result of another sequence with this name"):
        run_bench(options(paths=(tmp_path / "y" / "data",)))
    assert len(starts) == 1


def test_the_folder_of_the_sequences_is_no_place_for_results(options: Make, tmp_path: Path) -> None:
    _data(tmp_path, "a")
    with pytest.raises(InputError, match="files of something else lie there"):
        run_bench(options(out=tmp_path / "data"))
    assert [p.name for p in (tmp_path / "data").iterdir()] == ["a"]


@pytest.mark.usefixtures("no_plots")
def test_an_interruption_keeps_what_is_finished(options: Make, tmp_path: Path, starts: list[int]) -> None:
    _data(tmp_path, "a", "c")
    mark(write_sequence(tmp_path / "data" / "b"))
    interrupts = TrackerSpec("interrupts", "", False)
    with pytest.raises(KeyboardInterrupt), orderly_end():
        run_bench(options(interrupts))
    assert sorted(path.stem for path in (tmp_path / "out" / "interrupts").rglob("*.csv")) == ["a"]
    assert not (tmp_path / "out" / "table.md").exists()
    begun = len(starts)
    (tmp_path / "data" / "b" / "img" / "0005.png").write_bytes(b"no picture and no mark")
    report = run_bench(options(interrupts)).report
    assert (report.reused, len(starts) - begun) == (1, 2)
    assert len(report.scores) == 3
