"""The key of a result: changes with all that the result depends on, and with nothing else."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from tests.benchmark.conftest import BRIGHT, RAW
from tests.benchmark.fakes import FRAMES, write_sequence
from tracker.benchmark.readers import find_sequences
from tracker.benchmark.sequence import Sequence
from uavfollow.benchmark import plan as plan_module
from uavfollow.benchmark.options import BenchOptions, chosen_trackers
from uavfollow.benchmark.plan import code_hash, make_plan
from uavfollow.errors import InputError
from uavfollow.trackers import TrackerSpec

Make = Callable[..., BenchOptions]


@pytest.fixture
def sequence(tmp_path: Path) -> Sequence:
    return _found(write_sequence(tmp_path / "data" / "a"))


def _found(folder: Path) -> Sequence:
    return find_sequences((folder,))[0][0]


def _key(options: BenchOptions, sequence: Sequence) -> str:
    (job,) = make_plan(options, [sequence])[0].jobs
    return job.key


def test_every_tracker_runs_over_every_sequence(options: Make, sequence: Sequence) -> None:
    other = replace(sequence, name="b")
    plan, problems = make_plan(options(BRIGHT, RAW, precision="fp32"), [sequence, other])
    assert [(job.name, job.spec) for job in plan.jobs] == [
        (f"{sequence.dataset}/{name}", spec) for name in "ab" for spec in (BRIGHT, RAW)
    ]
    assert len({job.key for job in plan.jobs}) == 2  # the two sequences are the same material, the trackers are not
    assert plan.engines == {BRIGHT: "fake/fp32", RAW: "fake/fp32"}
    assert problems == []


@pytest.mark.parametrize(
    ("change", "spec"),
    [
        ({"fps": 10.0}, BRIGHT),
        ({"max_frames": FRAMES - 1}, BRIGHT),
        ({"precision": "bf16"}, BRIGHT),
        ({}, TrackerSpec("bright", "1.0", False)),
        ({}, RAW),
    ],
)
def test_settings_and_weights_change_the_key(
    options: Make, sequence: Sequence, change: dict, spec: TrackerSpec
) -> None:
    assert _key(options(spec, **change), sequence) != _key(options(), sequence)


@pytest.mark.parametrize("change", [{"mode": "toolkit"}, {"jobs": 3}, {"out": Path("elsewhere")}, {"fps": 30.0}])
def test_what_does_not_touch_the_result_does_not_change_the_key(
    options: Make, sequence: Sequence, change: dict
) -> None:
    assert _key(options(**change), sequence) == _key(options(), sequence)


def test_annotation_and_images_change_the_key(options: Make, sequence: Sequence) -> None:
    keys = {_key(options(), sequence)}
    keys.add(_key(options(), replace(sequence, truth=(*sequence.truth[:-1], None))))
    keys.add(_key(options(), replace(sequence, first=replace(sequence.first, w_px=13.0))))
    keys.add(_key(options(), replace(sequence, images=(*sequence.images[:-1], sequence.images[0]))))
    os.truncate(sequence.images[3], 50)
    keys.add(_key(options(), sequence))
    sequence.images[3].unlink()
    keys.add(_key(options(), sequence))
    assert len(keys) == 6


def test_a_data_set_may_be_moved(options: Make, sequence: Sequence, tmp_path: Path) -> None:
    shutil.copytree(tmp_path / "data" / "a", tmp_path / "moved" / "a")
    assert _key(options(), _found(tmp_path / "moved" / "a")) == _key(options(), sequence)


def test_code_changes_the_key(options: Make, sequence: Sequence, monkeypatch: pytest.MonkeyPatch) -> None:
    before = _key(options(), sequence)
    monkeypatch.setattr(plan_module, "code_hash", lambda: "other code")
    assert _key(options(), sequence) != before


def test_the_code_of_a_result_is_that_of_the_tracker(tmp_path: Path) -> None:
    paths = [
        "tracker/target.py", "tracker/siamapnpp/decode.py", "uavfollow/trackers.py", "uavfollow/benchmark/job.py",
        "tracker/training/loop.py", "tracker/benchmark/scores.py", "control/gimbal.py", "uavfollow/benchmark/tables.py",
    ]  # fmt: skip
    for path in paths:
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text("old")
    before, changing = code_hash(tmp_path), []
    for path in paths:
        (tmp_path / path).write_text("new")
        changing.append(code_hash(tmp_path) != before)
        (tmp_path / path).write_text("old")
    assert changing == [True] * 4 + [False] * 4
    (tmp_path / "tracker/target.py").rename(tmp_path / "tracker/renamed.py")
    assert code_hash(tmp_path) != before


def test_one_name_for_two_sequences_is_a_problem_and_the_same_twice_is_none(
    options: Make, sequence: Sequence, tmp_path: Path
) -> None:
    shutil.copytree(tmp_path / "data" / "a", tmp_path / "other" / "data" / "a")
    twin = replace(_found(tmp_path / "other" / "data" / "a"), dataset=sequence.dataset)
    plan, problems = make_plan(options(), [sequence, sequence, twin])
    assert [seq for _, seq in plan.sequences] == [sequence]
    (problem,) = problems
    assert problem.where == str(tmp_path / "other/data/a/img")
    assert f"is also called {sequence.dataset}/a, as {tmp_path / 'data/a/img'} is" in problem.message
    assert "Rename one" in problem.message


def test_another_annotation_of_the_same_images_is_another_sequence(options: Make, sequence: Sequence) -> None:
    other = replace(sequence, truth=(*sequence.truth[:-1], None))
    assert len(make_plan(options(max_frames=3), [sequence, other])[1]) == 1


def test_a_cut_is_remembered(options: Make, sequence: Sequence) -> None:
    (job,) = make_plan(options(max_frames=5, fps=7.0), [sequence])[0].jobs
    assert (len(job.sequence.images), len(job.sequence.truth), job.whole_frames) == (5, 5, FRAMES)
    assert job.sequence.fps == 7.0


@pytest.mark.parametrize(
    ("dataset", "name", "expected"),
    [
        ("x,y", 'a "#|\n', "x-y/a-----"),
        ("x/y", "a b", "x-y/a-b"),
        ("..", ".a", "unnamed/a"),
        ("UAV123@10fps", "é", None),
    ],
)
def test_names_are_those_of_files_inside_the_folder(
    options: Make, sequence: Sequence, dataset: str, name: str, expected: str | None
) -> None:
    plan, _ = make_plan(options(), [replace(sequence, dataset=dataset, name=name)])
    assert plan.jobs[0].name == (expected or f"{dataset}/{name}")


def test_trackers_by_their_names() -> None:
    specs = chosen_trackers(["siamapnpp,siamapnpp@full+raw", "nanotrack@x"], "")
    assert [spec.label for spec in specs] == ["siamapnpp@s", "siamapnpp@full+raw", "nanotrack@x"]
    assert chosen_trackers(["siamapnpp+raw"], "full")[0].model == "full"
    for texts, message in (
        (["siamapnpp", "siamapnpp@s"], "is named twice"),
        (["siamapnpp@a/w.safetensors,siamapnpp@b/w.safetensors"], "would have the same name, siamapnpp@w.safetensors"),
        (["siamapn"], "unknown tracker"),
        (["siamapnpp,,nanotrack@x"], "--tracker siamapnpp,,nanotrack@x: a name is empty there"),
        (["siamapnpp", " "], "--tracker  : a name is empty there"),
    ):
        with pytest.raises(InputError, match=message):
            chosen_trackers(texts, "")
