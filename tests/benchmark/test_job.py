"""One tracker over one sequence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.benchmark import fakes
from tests.benchmark.conftest import BRIGHT, RAW
from tests.benchmark.fakes import FRAMES, HEIGHT_PX, WIDTH_PX, mark, truth_box, write_sequence
from tracker.benchmark.readers import find_sequences
from tracker.box import Box
from tracker.messages import Candidate, Frame, SearchHint, TargetReason, TargetStatus
from uavfollow.benchmark.job import Job, Track, run_job
from uavfollow.trackers import TrackerSpec
from uavfollow.workers import JobError

LOCKED = TargetStatus.LOCKED


def _job(folder: Path, spec: TrackerSpec = BRIGHT) -> Job:
    return Job(spec, find_sequences((folder,))[0][0], "data/a", "key", "auto", "cpu", fakes.build, FRAMES)


def _track(job: Job) -> Track:
    track = run_job(job, lambda: False)
    assert track is not None
    return track


def test_a_row_for_each_image_at_the_times_of_the_frame_rate(tmp_path: Path) -> None:
    job = _job(write_sequence(tmp_path / "a", absent=range(8, 10)))
    track = _track(job)
    assert len(track.rows) == FRAMES
    assert (track.engine, track.unread) == ("fake/auto", 0)
    assert track.seconds > 0
    assert track.rows[0].box == truth_box(0)
    statuses = [row.status for row in track.rows]
    assert statuses[0] is TargetStatus.ACQUIRING
    assert TargetStatus.LOCKED not in statuses[8:10]


def test_times_are_those_of_the_frame_rate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    times_s = []

    class Records(fakes.BrightTracker):
        def update(self, frame: Frame, hint: SearchHint | None = None) -> tuple[Candidate, ...]:
            times_s.append((frame.seq, frame.t_capture_s))
            return super().update(frame, hint)

    monkeypatch.setitem(fakes.KINDS, "bright", Records)
    job = _job(write_sequence(tmp_path / "a", frames=4))
    _track(replace(job, sequence=replace(job.sequence, fps=5.0)))
    assert times_s == [(k, pytest.approx(k / 5.0)) for k in (1, 2, 3)]


def test_the_bare_tracker_is_locked_and_its_confidence_is_its_score(tmp_path: Path) -> None:
    track = _track(_job(write_sequence(tmp_path / "a", absent=range(8, 10)), RAW))
    assert {row.status for row in track.rows[:8]} == {TargetStatus.LOCKED}
    assert [row.confidence for row in track.rows[1:10]] == [0.9] * 7 + [0.0] * 2
    assert track.rows[0].confidence is None, "the selection is no measurement"
    assert track.rows[8].reason is TargetReason.NO_CANDIDATE


def test_an_image_that_cannot_be_read_is_a_step_without_candidates(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path / "a")
    (folder / "img" / "0009.png").write_bytes(b"no picture")
    track = _track(_job(folder, RAW))
    assert track.unread == 1
    assert [row.status for row in track.rows[7:10]] == [LOCKED, TargetStatus.SEARCHING, LOCKED]


def test_a_first_image_that_cannot_be_read_is_an_error(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path / "a")
    (folder / "img" / "0001.png").write_bytes(b"no picture")
    with pytest.raises(JobError, match=r"^image .*/img/0001\.png: the first image cannot be read"):
        run_job(_job(folder), lambda: False)


class Strict(fakes.BrightTracker):
    """As strict as the network's tracker: the box must lie in the picture."""

    def init(self, frame: Frame, box: Box) -> None:
        x1, y1, x2, y2 = box.to_corners()
        if x1 < 0 or y1 < 0 or x2 > WIDTH_PX or y2 > HEIGHT_PX:
            raise ValueError("outside")
        super().init(frame, box)


def test_a_first_box_that_reaches_beyond_the_picture_is_cut(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(fakes.KINDS, "bright", Strict)
    job = _job(write_sequence(tmp_path / "a"))
    over = Box.from_xywh(-1.0, 18.0, 12.0, HEIGHT_PX)
    cut = _track(replace(job, sequence=replace(job.sequence, first=over))).rows[0].box
    assert cut is not None
    assert cut.to_xywh() == pytest.approx((0.0, 18.0, 11.0, HEIGHT_PX - 18.0), abs=1e-5)
    with pytest.raises(JobError, match=r"the first box -30,5 to -20,15 lies outside of the picture"):
        _track(replace(job, sequence=replace(job.sequence, first=Box.from_xywh(-30, 5, 10, 10))))


def test_an_error_says_where_in_one_line(tmp_path: Path) -> None:
    job = _job(mark(write_sequence(tmp_path / "a")), TrackerSpec("raises", "", False))
    with pytest.raises(JobError) as broke:
        _track(job)
    told = str(broke.value)
    assert told.startswith(f"image {tmp_path / 'a/img/0005.png'}: RuntimeError: no more of this (")
    assert "tests/benchmark/fakes.py:" in told


def test_it_can_be_stopped_before_every_image(tmp_path: Path) -> None:
    asked = []

    def tick() -> bool:
        asked.append(True)
        return len(asked) == 5

    assert run_job(_job(write_sequence(tmp_path / "a")), tick) is None
    assert len(asked) == 5
