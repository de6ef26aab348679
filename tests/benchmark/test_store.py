"""Results in their folder: whole, with their key, in no folder of others."""

from __future__ import annotations

import csv
import errno
import json
from dataclasses import replace
from pathlib import Path

import pytest

from tests.benchmark import fakes
from tests.benchmark.conftest import BRIGHT
from tests.benchmark.fakes import FRAMES, write_sequence
from tracker.benchmark.readers import find_sequences
from tracker.box import Box
from tracker.messages import MemorySlot, MemoryWrite, TargetAlarm, TargetReason, TargetStatus
from uavfollow.benchmark import store as store_module
from uavfollow.benchmark.job import Job, Row, Track
from uavfollow.benchmark.store import MARKER, Store, opened
from uavfollow.errors import InputError
from uavfollow.trackers import TrackerSpec

BOX = Box.from_xywh(1.25, 2.5, 10.0, 20.125)
ROWS = (
    Row(BOX, TargetStatus.ACQUIRING, TargetReason.SELECTED, None),
    Row(BOX, TargetStatus.LOCKED, TargetReason.SEEN, 0.875, (TargetAlarm.DISTRACTOR, TargetAlarm.FALSE_LOCK),
        MemoryWrite(MemorySlot.ANCHOR, Box.from_xywh(3.0, 4.0, 5.0, 6.0))),
    Row(None, TargetStatus.LOST, TargetReason.GAVE_UP, 0.0),
    *(Row(BOX, TargetStatus.SEARCHING, TargetReason.COAST_EXPIRED, 0.5) for _ in range(FRAMES - 3)),
)  # fmt: skip
TRACK = Track(ROWS, 1.5, 2, "engine")


@pytest.fixture
def job(tmp_path: Path) -> Job:
    sequence = find_sequences((write_sequence(tmp_path / "data" / "a"),))[0][0]
    return Job(BRIGHT, sequence, "set/a", "key", "auto", "cpu", fakes.build, FRAMES)


def _with_key(job: Job, key: str) -> Job:
    return replace(job, key=key)


def test_a_result_comes_back_as_it_was(tmp_path: Path, job: Job) -> None:
    with opened(tmp_path / "out") as store:
        assert store.read(job) is None
        store.write(job, TRACK)
        result = store.read(job)
    assert result is not None
    assert result.rows == ROWS
    header = result.header
    assert (header.seconds, header.unread, header.engine, header.fps) == (1.5, 2, "engine", job.sequence.fps)
    lines = (tmp_path / "out" / "bright" / "set" / "a.txt").read_text().splitlines()
    assert lines[1:3] == ["1.2500,2.5000,10.0000,20.1250", "nan,nan,nan,nan"]
    assert len(lines) == FRAMES


def test_another_key_is_no_result_until_it_is_written(tmp_path: Path, job: Job) -> None:
    other = _with_key(job, "other")
    with opened(tmp_path / "out") as store:
        store.write(job, TRACK)
        assert store.read(other) is None
        store.write(other, TRACK)
        assert store.read(other) is not None
        assert store.read(job) is None


@pytest.mark.parametrize(
    ("name", "spoil"),
    [
        ("a.csv", lambda text: text[: len(text) // 2]),
        ("a.csv", lambda text: text.replace("LOCKED", "LOCK")),
        ("a.csv", lambda text: text.replace("0.875000", "much")),
        ("a.csv", lambda text: text.replace("0.875000", "")),
        ("a.csv", lambda text: text.replace("status", "state")),
        ("a.json", lambda text: text[:-4]),
        ("a.json", lambda text: "[]"),
        ("a.json", lambda text: text.replace("unread", "unknown")),
    ],
)
def test_a_damaged_result_is_none(tmp_path: Path, job: Job, name: str, spoil: object) -> None:
    with opened(tmp_path / "out") as store:
        store.write(job, TRACK)
        path = tmp_path / "out" / "bright" / "set" / name
        path.write_text(spoil(path.read_text()))  # type: ignore[operator]
        assert store.read(job) is None


def test_an_old_header_never_vouches_for_new_rows(tmp_path: Path, job: Job, monkeypatch: pytest.MonkeyPatch) -> None:
    with opened(tmp_path / "out") as store:
        store.write(job, TRACK)

        def broken(path: Path, values: object) -> None:
            raise OSError("no space")

        monkeypatch.setattr(store_module, "write_json", broken)
        with pytest.raises(OSError, match="no space"):
            store.write(_with_key(job, "other"), TRACK)
        assert store.read(job) is None
    assert not list((tmp_path / "out").rglob(".part-*"))


def test_the_folder_grows_and_loses_what_a_killed_run_left(tmp_path: Path, job: Job) -> None:
    out = tmp_path / "out"
    with opened(out) as store:
        store.write(job, TRACK)
    (out / "bright" / ".part-b.csv").write_text("half")
    with opened(out) as store:
        assert store.read(job) is not None
    assert not (out / "bright" / ".part-b.csv").exists()


@pytest.mark.parametrize("name", ["notes.txt", "img", "zebra.csv"])
def test_a_folder_of_something_else_is_refused_and_left_alone(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("mine")
    with (
        pytest.raises(InputError, match=rf"files of something else lie there \({name}, ...\): choose another"),
        opened(tmp_path),
    ):
        pass
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_an_empty_folder_is_taken_and_marked(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    with opened(tmp_path / "out"):
        pass
    assert json.loads((tmp_path / "out" / MARKER).read_text()) == store_module.MARK


@pytest.mark.parametrize("text", ["{}", "no json", '{"what": "results of uavfollow bench track", "schema": 2}'])
def test_a_marker_of_something_else_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / MARKER).write_text(text)
    with pytest.raises(InputError, match="is not of this version"), opened(tmp_path):
        pass


def test_two_runs_do_not_share_a_folder(tmp_path: Path) -> None:
    with (
        opened(tmp_path / "out"),
        pytest.raises(InputError, match="another run is writing there"),
        opened(tmp_path / "out"),
    ):
        pass


def test_a_file_in_place_of_the_folder_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(InputError, match="cannot be written"), opened(tmp_path / "out"):
        pass


def test_names_of_specs_are_folders(tmp_path: Path, job: Job) -> None:
    named = replace(job, spec=TrackerSpec("bright", "some/where/1.5", True))
    Store(tmp_path / "out").write(named, TRACK)
    assert (tmp_path / "out" / "bright@1.5+raw" / "set" / "a.csv").is_file()


def test_the_first_image_has_no_confidence(tmp_path: Path, job: Job) -> None:
    Store(tmp_path).write(job, TRACK)
    with (tmp_path / "bright" / "set" / "a.csv").open() as file:
        said = [row["confidence"] for row in csv.DictReader(file)]
    assert said[:3] == ["", "0.875000", "0.000000"]


def test_a_file_that_cannot_be_written_is_named_and_what_is_there_stays(
    tmp_path: Path, job: Job, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = OSError(errno.ENOSPC, "No space left on device")
    with opened(tmp_path / "out") as store:
        store.write(job, TRACK)

        def writes(path: Path, text: str, **options: object) -> int:
            raise full

        monkeypatch.setattr(Path, "write_text", writes)
        with pytest.raises(InputError, match=r"set/b\.txt: cannot be written \(No space left on device\); make room"):
            store.write(replace(job, name="set/b"), TRACK)
        monkeypatch.undo()
        assert store.read(job) is not None
        assert store.read(replace(job, name="set/b")) is None
        (tmp_path / "out" / "bright" / "other").write_text("a file in place of a folder")
        with pytest.raises(InputError, match=r"bright/other/a\.json: cannot be written \(.*What was finished is kept"):
            store.write(replace(job, name="other/a"), TRACK)
    assert not list((tmp_path / "out").rglob(".part-*"))


def test_further_trackers_are_those_with_results(tmp_path: Path, job: Job) -> None:
    store = Store(tmp_path)
    for name in ("bright", "zeta", "alpha"):
        store.write(replace(job, spec=TrackerSpec(name, "", False)), TRACK)
    (tmp_path / "plots" / "set").mkdir(parents=True)
    (tmp_path / "plots" / "set" / "a.png").write_bytes(b"")
    assert store.further({"bright"}) == ("alpha", "zeta")
    assert store.further({"bright", "alpha", "zeta"}) == ()


def test_results_of_another_sequence_of_the_name_are_not_replaced(tmp_path: Path, job: Job) -> None:
    twin = find_sequences((write_sequence(tmp_path / "else" / "data" / "a"),))[0][0]
    other = replace(job, sequence=twin, key="other")
    store = Store(tmp_path / "out")
    store.check_replaces([job, other])
    store.write(job, TRACK)
    store.check_replaces([job, _with_key(job, "new settings")])
    message = (
        rf"{tmp_path}/out/bright/set/a\.json: .*{tmp_path}/data/a/img, and that of {tmp_path}/else/data/a/img would"
    )
    with pytest.raises(InputError, match=message):
        store.check_replaces([other])
    (tmp_path / "data").rename(tmp_path / "moved")
    store.check_replaces([other])
