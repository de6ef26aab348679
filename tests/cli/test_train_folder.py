"""The folder of a run: whose it is, and what is refused before anything is opened."""

from __future__ import annotations

import fcntl
import os
import shutil
import signal
from pathlib import Path

import pytest
import torch

from tests.cli.test_train import RECIPE
from tracker.training.checkpoint import BEST, LAST, write_recipe
from tracker.training.curves import Curves
from tracker.training.recipe_file import parse_recipe
from uavfollow.errors import InputError
from uavfollow.training import run
from uavfollow.training.folder import run_folder
from uavfollow.training.lock import LOCK, held

TINY = parse_recipe(RECIPE, "tiny")


def _all(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize(
    "name",
    [
        "curve.csv",
        "validation.csv",
        "curves.png",
        "weights.json",
        "best.safetensors",
        "last.ckpt",
        "variant.safetensors",
    ],
)
def test_files_of_something_else_are_not_written_over(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("mine")
    (tmp_path / "notes.txt").write_text("these do not matter")
    before = _all(tmp_path)
    with pytest.raises(InputError) as refused:
        run_folder(TINY, tmp_path, resume=False)
    told = f"--out {tmp_path}: files of something else lie there ({name}): choose another folder"
    assert str(refused.value) == told
    with pytest.raises(InputError, match=rf"recipe\.json is missing beside {name}: put it back"):
        run_folder(TINY, tmp_path, resume=True)
    assert _all(tmp_path) == before


def test_a_folder_with_other_files_or_a_lock_is_taken(tmp_path: Path) -> None:
    for name in ("notes.txt", LOCK, "weights"):
        (tmp_path / name).touch()
    assert run_folder(TINY, tmp_path, resume=False) == tmp_path
    with pytest.raises(InputError, match="no run to resume lies there"):
        run_folder(TINY, tmp_path, resume=True)


def test_a_run_without_a_checkpoint_yet_goes_on_but_not_over_its_best(tmp_path: Path) -> None:
    write_recipe(tmp_path, TINY)
    assert run_folder(TINY, tmp_path, resume=True) == tmp_path
    (tmp_path / BEST).touch()
    with pytest.raises(InputError, match=rf"{LAST} is missing; go on from the best validation \(mv "):
        run_folder(TINY, tmp_path, resume=True)


def test_only_one_run_writes_in_a_folder(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "run"
    with held(folder):
        (folder / "recipe.json").touch()
        with pytest.raises(InputError) as refused, held(folder):
            pass
        assert str(refused.value) == (
            f"--out {folder}: another run is writing there; wait for it or choose another folder"
        )
    with held(folder):
        pass
    assert sorted(path.name for path in folder.iterdir()) == [LOCK, "recipe.json"]


def test_a_child_process_does_not_keep_the_folder(tmp_path: Path) -> None:
    """Those that make batches may live a little longer."""
    reader, writer = os.pipe()
    with held(tmp_path):
        child = os.fork()
        if child == 0:
            os.read(reader, 1)
            os._exit(0)
    with held(tmp_path):
        pass
    os.write(writer, b"x")
    os.waitpid(child, 0)


def test_what_was_made_for_nothing_is_gone_again(tmp_path: Path) -> None:
    with held(tmp_path / "a" / "b"):
        pass
    assert list(tmp_path.iterdir()) == []
    with held(tmp_path):
        pass
    assert [path.name for path in tmp_path.iterdir()] == [LOCK]


def test_without_locks_it_runs_all_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(descriptor: int, operation: int) -> None:
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(fcntl, "flock", unknown)
    with pytest.raises(KeyError), held(tmp_path):
        raise KeyError


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of what was opened; in the end there is nothing to train on."""
    seen: list[str] = []

    def open_sources(*arguments: object) -> None:
        seen.append("sources")
        raise InputError("no data here")

    monkeypatch.setattr(run, "open_sources", open_sources)
    return seen


@pytest.mark.parametrize(
    ("change", "arguments", "expected"),
    [
        (("", ""), ("--resident",), "--resident keeps packed crops on the device; give --packed DIR"),
        (("", ""), ("--out", "file"), "--out file: cannot be written (File exists); choose a folder"),
        (("", ""), ("--out", "file/run"), "--out file/run: cannot be written (Not a directory); choose a folder"),
        (("backbone: s", "backbone: gone.pth"), (), "start.backbone: gone.pth: no such file"),
        (("backbone: s", "model: gone.safetensors"), (), "start.model: gone.safetensors: no such weights file"),
        (("ema: 0.5", "teacher: {model: gone.safetensors}"), (), "teacher.model: gone.safetensors: no such weights"),
    ],
)
def test_before_hours_of_opening(cli, tmp_path, monkeypatch, opened, change, arguments, expected: str) -> None:
    monkeypatch.chdir(tmp_path)
    Path("tiny.yaml").write_text(RECIPE.replace(*change))
    Path("file").touch()
    result = cli("train", "run", "tiny.yaml", "--device", "cpu", *arguments)
    assert (result.code, result.out, result.err.count("\n")) == (2, "", 1), result.err
    assert expected in result.err
    assert opened == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "tiny.yaml"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_signal_while_it_opens_is_one_line(cli, tmp_path, monkeypatch, number: int) -> None:
    monkeypatch.chdir(tmp_path)
    Path("tiny.yaml").write_text(RECIPE)
    monkeypatch.setattr(run, "open_sources", lambda *arguments: signal.raise_signal(number))
    result = cli("train", "run", "tiny.yaml", "--device", "cpu")
    assert (result.code, result.out, result.err) == (130, "", "uavfollow: interrupted\n")
    assert [path.name for path in tmp_path.iterdir()] == ["tiny.yaml"]


@pytest.fixture
def train(cli, material, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A run of two pairs in `run`, from a sequence beside it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Curves, "draw", lambda self: None)
    threads = torch.get_num_threads()
    Path("train/a").mkdir(parents=True)
    Path("train/a/img").symlink_to(material.folder)
    shutil.copy(material.truth, "train/a/groundtruth_rect.txt")
    Path("tiny.yaml").write_text(RECIPE[: RECIPE.index("validation:")].replace("ema: 0.5", "ema:"))
    yield lambda *more: cli(
        "train",
        "run",
        "tiny.yaml",
        "--pairs",
        2,
        "--workers",
        0,
        "--threads",
        1,
        "--device",
        "cpu",
        "--out",
        "run",
        *more,
    )
    torch.set_num_threads(threads)


def test_a_run_that_never_saved_begins_anew_and_another_is_kept_out(train) -> None:
    write_recipe_of_run = parse_recipe(Path("tiny.yaml").read_text(), "tiny")
    Path("run").mkdir()
    write_recipe(Path("run"), run.effective_recipe(write_recipe_of_run, run.RunOptions(pairs=2)))
    with held(Path("run")):
        refused = train("--resume")
    assert refused.code == 2
    assert refused.err == (
        "uavfollow: error: --out run: another run is writing there; wait for it or choose another folder\n"
    )
    assert not Path("run", LAST).exists()
    done = train("--resume")
    assert done.code == 0, done.err
    assert "in run: it ended before its first checkpoint and begins anew at step 0" in done.err
    assert Path("run", LAST).exists()
