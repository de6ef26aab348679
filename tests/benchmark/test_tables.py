"""Tables: which numbers, over which sequences, beside which published ones."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence as Seq
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.benchmark import fakes
from tests.benchmark.conftest import BRIGHT, RAW
from tracker.benchmark.long_term import LongTerm
from tracker.benchmark.scores import Mode
from tracker.benchmark.sequence import Sequence
from tracker.benchmark.shares import Share
from tracker.box import Box
from tracker.messages import MemorySlot, MemoryWrite, TargetReason, TargetStatus
from uavfollow.benchmark import files
from uavfollow.benchmark.files import write_report
from uavfollow.benchmark.job import Job, Row
from uavfollow.benchmark.published import ATTRIBUTES, TABLE_I
from uavfollow.benchmark.report import Failure, Report
from uavfollow.benchmark.scoring import SequenceScore, by_attribute, score_sequence
from uavfollow.benchmark.store import Header, Result
from uavfollow.benchmark.tables import as_markdown, as_text
from uavfollow.trackers import TrackerSpec

TRUTH = Box(50.0, 50.0, 20.0, 20.0)
MISS = Box(150.0, 50.0, 20.0, 20.0)
LOCKED, SEARCHING = TargetStatus.LOCKED, TargetStatus.SEARCHING


def _score(
    spec: TrackerSpec = BRIGHT,
    name: str = "set/a",
    boxes: Seq[Box | None] = (TRUTH,) * 4,
    statuses: Seq[TargetStatus] = (LOCKED,) * 4,
    confidence: Seq[float] = (1.0,) * 4,
    truth: Seq[Box | None] = (TRUTH,) * 4,
    attributes: Seq[str] = (),
    memory: Box | None = None,
    mode: Mode = Mode.HONEST,
    unread: int = 0,
    whole: int | None = None,
) -> SequenceScore:
    dataset, _, short = name.partition("/")
    images = tuple(Path(f"{k}.jpg") for k in range(len(truth)))
    sequence = Sequence(short, dataset, images, tuple(truth), 10.0, frozenset(attributes), TRUTH)
    write = MemoryWrite(MemorySlot.RECENT, memory) if memory else None
    rows = tuple(
        Row(box, status, TargetReason.SEEN, said, (), write)
        for box, status, said in zip(boxes, statuses, confidence, strict=True)
    )
    header = Header("key", str(spec), name, "images", len(rows), 10.0, 0.5, unread, "engine", "cpu", "0")
    job = Job(spec, sequence, name, "key", "auto", "cpu", fakes.build, len(rows) if whole is None else whole)
    return score_sequence(job, Result(header, rows), mode)


def _report(
    *scores: SequenceScore, specs: Seq[TrackerSpec] = (BRIGHT,), mode: Mode = Mode.HONEST, **more: Any
) -> Report:
    return Report(mode, dict.fromkeys(specs, "engine"), "cpu", scores, (), 0, **more)


def _published_sets(**more: Any) -> list[SequenceScore]:
    """As many sequences as the published tables are of."""
    sizes = (("UAV20L", 20), ("UAV123@10fps", 123))
    return [
        _score(name=f"{d}/{k}", attributes=ATTRIBUTES, mode=Mode.TOOLKIT, **more) for d, n in sizes for k in range(n)
    ]


def _rows(report: Report, first: str) -> list[list[str]]:
    """Cells of the lines of table.md whose first cell begins so."""
    cells = [[c.strip() for c in line.strip("|").split("|")] for line in as_markdown(report).splitlines()]
    return [row for row in cells if row[0].startswith(first)]


def test_the_honesty_of_a_tracker() -> None:
    score = _score(
        boxes=(TRUTH, TRUTH, MISS, None, TRUTH),
        statuses=(LOCKED, SEARCHING, LOCKED, SEARCHING, LOCKED),
        confidence=(1.0, 0.9, 0.6, 0.2, 0.8),
        truth=(TRUTH, TRUTH, TRUTH, None, TRUTH),
        memory=MISS,
    )
    total = _report(score).totals[0]
    assert (total.long_term.honest_lock.hits, total.long_term.honest_lock.of) == (2, 3)
    assert (total.long_term.false_confirmed.hits, total.long_term.false_confirmed.of) == (1, 5)
    assert (total.long_term.wrong_writes.hits, total.long_term.wrong_writes.of) == (5, 5)
    assert total.reliability.roc_auc == 1.0
    assert total.reliability.frames == 4
    row = _rows(_report(score), "bright")[-1]
    assert row[1:3] == ["66.7 %", "20.0 %"]
    assert row[7] == "5 of 5"
    assert row[8] == "1.000"


def test_a_bare_tracker_counts_as_locked_in_every_frame() -> None:
    score = _score(RAW, boxes=(TRUTH, MISS, MISS, MISS), statuses=(LOCKED, LOCKED, SEARCHING, SEARCHING))
    assert score.long_term.false_confirmed.hits == 3
    assert score.statuses is None


def test_confidence_that_is_no_probability_spoils_nothing() -> None:
    score = _score(confidence=(0.0, float("nan"), 1.5, -0.5))
    assert score.confidence.tolist() == [0.0, 1.0, 0.0]


def test_the_mode_decides_what_absent_frames_count_for() -> None:
    truth = (TRUTH, None, TRUTH, None)
    honest, toolkit = (_score(truth=truth, mode=mode).curves for mode in (Mode.HONEST, Mode.TOOLKIT))
    assert honest is not None
    assert toolkit is not None
    assert (honest.auc, honest.p20) == (pytest.approx(20 / 21), 1.0)
    assert (toolkit.auc, toolkit.p20) == (pytest.approx(10 / 21), 1.0)


def test_means_are_over_sequences_that_every_tracker_finished() -> None:
    bad = (TRUTH, MISS, MISS, MISS)
    report = _report(
        _score(BRIGHT, "set/a"),
        _score(RAW, "set/a", boxes=bad),
        _score(BRIGHT, "set/b", boxes=bad),
        specs=(BRIGHT, RAW),
    )
    assert [total.sequences for total in report.totals] == [1, 1]
    (mean,) = _rows(report, "**mean**")
    assert mean[2:] == ["**0.952 / 1.000 / 1.000**", "**0.238 / 0.250 / 0.250**"]
    assert _rows(report, "set/b")[0][2:] == ["0.238 / 0.250 / 0.250", "-"]
    assert "Means are over the sequences that every tracker finished." in as_markdown(report)
    assert as_text(report)[0] == "mean of 1 sequences, 4 images, mode honest (set at 10 (assumed) images/s)"
    assert "Means are over the sequences that every tracker finished." in as_text(report)
    assert as_text(report)[2].split() == ["bright", "0.952", "1.000", "1.000", "100.0", "%", "0.0", "%", "-", "8.0"]


def test_several_data_sets_have_means_of_their_own() -> None:
    bad = (TRUTH, MISS, MISS, MISS)
    report = _report(_score(name="x/a"), _score(name="y/a", boxes=bad), _score(name="y/b", boxes=bad))
    assert [row[0] for row in _rows(report, "**mean")] == [
        "**mean of x** (1 sequences)", "**mean of y** (2 sequences)", "**mean** (3 sequences)",
    ]  # fmt: skip


def test_published_rows_stand_beside_ours_where_the_attributes_exist() -> None:
    report = _report(_score(attributes=("FOC", "SV", "BC")), _score(name="set/b", attributes=("SV",)))
    text = as_markdown(report)
    header = next(line for line in text.splitlines() if line.startswith("| tracker | FOC"))
    assert header == "| tracker | FOC (full occlusion), 1 sequences | SV (scale variation), 2 sequences |"
    assert _rows(report, "bright (ours")[0][0] == "bright (ours: 0 of 143 sequences)"
    assert _rows(report, "SiamAPN++ (published)") == [["SiamAPN++ (published)", "0.358 / 0.577", "0.554 / 0.729"]]
    assert len([line for line in text.splitlines() if "(published)" in line]) == len(TABLE_I)
    assert _rows(report, "BC") == [["BC", "1", "0.952 / 1.000"]]
    assert (
        "**Do not compare directly**: ours are of set alone; are counted in mode `honest` (published: `toolkit`)."
        in text
    )


def test_the_same_sequences_and_mode_compare_directly() -> None:
    text = as_markdown(_report(*_published_sets(), mode=Mode.TOOLKIT))
    assert "Published: Table I of the SiamAPN++ paper, average over UAV20L and UAV123@10fps." in text
    assert "compare directly" not in text
    assert "(ours" not in text
    assert "Partial" not in text


@pytest.mark.parametrize(
    ("score", "options", "row", "message"),
    [
        ({}, {"fps": 15.0}, "143 of 143", "ours were tracked as if at 15 images per second (--fps)."),
        ({"unread": 1}, {}, "143 of 143", "ours lack images that could not be read."),
        (
            {"whole": 9},
            {"max_frames": 4},
            "143 of 143 sequences, cut",
            "ours end after the first 4 images of a sequence.",
        ),
    ],
)
def test_what_keeps_whole_sets_from_being_compared(score: dict, options: dict, row: str, message: str) -> None:
    text = as_markdown(_report(*_published_sets(**score), mode=Mode.TOOLKIT, **options))
    assert f"**Do not compare directly**: {message}" in text
    assert f"| bright (ours: {row}" in text


def test_a_part_of_a_set_is_never_compared_in_silence() -> None:
    report = _report(*_published_sets()[1:24], mode=Mode.TOOLKIT)
    text = as_markdown(report)
    assert (
        "**Do not compare directly**: ours cover only 19 of the 20 sequences of UAV20L; "
        "cover only 4 of the 123 sequences of UAV123@10fps." in text
    )
    assert "| bright (ours: 23 of 143 sequences) |" in text
    assert _rows(report, "UAV20L")[0][1] == "19 of 20"
    assert "Partial: 4 of the 123 sequences of UAV123@10fps." in as_text(report)


def test_what_was_scored() -> None:
    report = _report(
        _score(BRIGHT, "UAV123@10fps/a", whole=90, unread=2),
        _score(RAW, "UAV123@10fps/a", whole=90, unread=3),
        _score(BRIGHT, "set/b"),
        _score(RAW, "set/b"),
        _score(RAW, "set/c", unread=1),
        specs=(BRIGHT, RAW),
        max_frames=4,
        further=("nano", "old"),
    )
    assert _rows(report, "UAV123@10fps")[:2] == [
        ["UAV123@10fps", "1 of 123", "4 of 90 (cut by --max-frames 4)", "10", "3"],
        ["UAV123@10fps/a", "4 of 90, 3 not read", "0.952 / 1.000 / 1.000", "0.952 / 1.000 / 1.000"],
    ]
    assert _rows(report, "set")[0] == ["set", "1", "4", "10 (assumed)", "0"]
    told = as_text(report)
    assert told[0] == (
        "mean of 2 sequences, 8 images, mode honest (UAV123@10fps at 10 images/s, set at 10 (assumed) images/s)"
    )
    for words in (
        "Cut: of 1 of the 2 sequences only the first 4 images were tracked",
        "Partial: 1 of the 123 sequences of UAV123@10fps.",
        "Unread: 3 images of 1 sequences could not be read",
        "Not shown: the folder also holds results of nano, old; name all trackers in one --tracker",
    ):
        (line,) = (line for line in told if line.startswith(words))
        assert line in as_markdown(report).splitlines()
        assert line in files.as_json(report)["notes"]
    values = files.as_json(report)
    assert (values["max_frames"], values["fps"], values["further_trackers"]) == (4, None, ["nano", "old"])
    assert values["scored"][0]["whole_frames"] == 90
    assert values["trackers"]["bright"]["unread_frames"] == 2
    assert values["trackers"]["bright"]["by_sequence"]["UAV123@10fps/a"]["whole_frames"] == 90
    assert "10 (--fps)" in as_markdown(_report(_score(), fps=10.0))


def test_each_number_has_its_own_name() -> None:
    shares = [Share(k, 10 * k) for k in range(1, 7)]
    long = LongTerm(shares[0], shares[1], (0.2, 0.9, 0.4), shares[2], 7, *shares[3:])
    (own,) = files.as_json(_report(replace(_score(), long_term=long)))["trackers"]["bright"]["by_sequence"].values()
    expected = {
        "losses": 3, "leave_locked_median_s": 0.4, "left_in_time": 3, "left_in_time_of": 30, "never_left": 7,
        "reacquired_in_frames": 4, "reacquired_in_frames_of": 40, "reacquired_in_time": 5, "reacquired_in_time_of": 50,
        "wrong_writes": 6, "writes": 60,
    }  # fmt: skip
    assert {name: own[name] for name in expected} == expected
    assert own["locked_after_loss_s"] == [0.2, 0.9, 0.4]


def test_nothing_to_say_of_whole_sequences() -> None:
    assert len(as_text(_report(_score()))) == 3


def test_without_attributes_nothing_published_is_shown() -> None:
    text = as_markdown(_report(_score()))
    assert "published" not in text
    assert "By attribute" not in text
    assert "published" not in as_markdown(_report(_score(attributes=("BC",))))


def test_attributes_over_data_sets_are_means_of_means() -> None:
    bad = (TRUTH, MISS, MISS, MISS)
    one, others = (
        _score(name="x/a", attributes=("SV",)),
        [_score(name=f"y/{n}", boxes=bad, attributes=("SV",)) for n in "abc"],
    )
    auc, p20, count = by_attribute([one, *others])["SV"]
    assert (p20, count) == (pytest.approx((1.0 + 0.25) / 2), 4)
    assert auc == pytest.approx((20 / 21 + 5 / 21) / 2)


def test_table_i_is_the_papers() -> None:
    assert len(TABLE_I) == 15
    for values in ("p20", "auc"):
        table = np.array([getattr(row, values) for row in TABLE_I])
        assert table.shape == (15, 5)
        assert TABLE_I[-1].tracker == "SiamAPN++"
        assert (table.argmax(axis=0) == 14).all()  # printed bold: the best in each column
    assert TABLE_I[1].scores("FM") == (0.319, 0.529)


def test_a_sequence_that_cannot_be_scored_breaks_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "plot_errors", lambda path, scores: None)
    failure = Failure("set/c with bright", "it | broke")
    score = _score(truth=(None,) * 4, attributes=("SV",), unread=1, whole=7)
    report = Report(Mode.HONEST, {BRIGHT: "engine"}, "cpu", (score,), (failure,), 0, 4)
    write_report(report, tmp_path, lambda done, of: None)
    values = json.loads((tmp_path / "summary.json").read_text())
    assert values["trackers"]["bright"]["auc"] is None
    assert values["failures"] == [{"where": "set/c with bright", "message": "it | broke"}]
    with (tmp_path / "summary.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert list(row) == list(values["columns"]), "each column is told of once"
    assert (row["unread_frames"], row["whole_frames"], row["fps"], row["sequence"]) == ("1", "7", "10", "a")
    own = values["trackers"]["bright"]["by_sequence"]["set/a"]
    for name in files.VALUES:
        assert row[name] == ("" if own[name] is None else f"{own[name]:.5g}"), name
        assert name in values["trackers"]["bright"]
    assert (row["auc"], row["frames"], row["false_confirmed_share"]) == ("", "4", "1")
    assert "## Not scored (1)\n\n- set/c with bright: it | broke" in (tmp_path / "table.md").read_text()
    assert _rows(report, "set/a")[0][2] == "-"
