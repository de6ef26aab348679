"""Checkpoints: whole or not at all, checked when read, and their folder's tables and recipe."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
import torch

from tests.tracker.training.blobs import recipe, stage
from tracker.training.checkpoint import (
    BEST,
    LAST,
    MAGIC,
    Checkpoint,
    Position,
    from_bytes,
    has_checkpoint,
    read_checkpoint,
    read_recipe,
    to_bytes,
    write_checkpoint,
    write_recipe,
)
from tracker.training.curves import CURVE, VALIDATION, Curves, read_rows
from tracker.training.errors import TrainingError
from tracker.training.types import Skipped
from tracker.training.validate import SequenceScore, Validated


def _checkpoint() -> Checkpoint:
    scores = (SequenceScore("a", 5, 0.5, 0.75), SequenceScore("b", 0, None, None))
    unused = Skipped(Counter({"unreadable image": 3}), {"unreadable image": ["a.jpg", "b.jpg"]})
    position = Position(1, 7, 480, 1.5, 99.0, 90.0, 2, 1, unused, [Validated(320, 1.2, scores)])
    optimiser = {"state": {0: {"exp_avg": torch.ones(3)}}, "param_groups": [{"lr": 1e-3, "params": [0]}]}
    return Checkpoint(position, {"w": torch.arange(4.0)}, {"w": torch.arange(4.0) + 1}, optimiser, {})


def test_everything_comes_back(tmp_path: Path) -> None:
    given = _checkpoint()
    write_checkpoint(tmp_path / LAST, to_bytes(given))
    got = read_checkpoint(tmp_path / LAST)
    assert got.position == given.position
    assert torch.equal(got.network["w"], given.network["w"])
    assert torch.equal(got.average["w"], given.average["w"])
    assert got.optimiser is not None
    assert torch.equal(got.optimiser["state"][0]["exp_avg"], torch.ones(3))
    assert got.optimiser["param_groups"] == [{"lr": 1e-3, "params": [0]}]
    assert [p.name for p in tmp_path.iterdir()] == [LAST]  # no part file is left


def test_a_single_changed_bit_is_found_and_the_best_is_offered(tmp_path: Path) -> None:
    data = bytearray(to_bytes(_checkpoint()))
    data[len(data) // 2] ^= 1
    write_checkpoint(tmp_path / LAST, bytes(data))
    with pytest.raises(TrainingError, match=r"last\.ckpt.*damaged.*start anew") as alone:
        read_checkpoint(tmp_path / LAST)
    assert BEST not in str(alone.value)
    write_checkpoint(tmp_path / BEST, to_bytes(_checkpoint()))
    with pytest.raises(TrainingError, match=r"last\.ckpt.*damaged.*best\.ckpt"):
        read_checkpoint(tmp_path / LAST)


@pytest.mark.parametrize("kept", [0, 10, 80, 200])
def test_a_file_cut_short_is_an_error(tmp_path: Path, kept: int) -> None:
    with pytest.raises(TrainingError, match=r"x\.ckpt"):
        from_bytes(to_bytes(_checkpoint())[:kept], tmp_path / "x.ckpt")


def test_code_in_a_checkpoint_is_not_run(tmp_path: Path) -> None:
    import hashlib
    import pickle

    class Evil:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return (Path.mkdir, (tmp_path / "owned",))  # type: ignore[return-value]

    payload = pickle.dumps({"position": Evil()}, protocol=2)
    data = MAGIC + hashlib.sha256(payload).hexdigest().encode() + b"\n" + payload
    with pytest.raises(TrainingError, match="something else"):
        from_bytes(data, tmp_path / LAST)
    assert not (tmp_path / "owned").exists()


def test_a_write_that_fails_leaves_the_old_checkpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_checkpoint(tmp_path / LAST, b"old")

    def full_disk(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tracker.training.checkpoint.os.fsync", full_disk)
    with pytest.raises(TrainingError, match="No space left"):
        write_checkpoint(tmp_path / LAST, b"new")
    assert (tmp_path / LAST).read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == [LAST]


def test_the_recipe_of_a_folder(tmp_path: Path) -> None:
    assert read_recipe(tmp_path) is None
    assert not has_checkpoint(tmp_path)
    write_recipe(tmp_path, recipe(stage(8), seed=5))
    assert read_recipe(tmp_path) == recipe(stage(8), seed=5)
    (tmp_path / "recipe.json").write_text('{"name": 3}')
    with pytest.raises(TrainingError, match=r"recipe\.json"):
        read_recipe(tmp_path)


def _row(pairs: int) -> dict[str, object]:
    return {"pairs": pairs, "minutes": pairs / 100, "stage": 1, "rate": 1e-3, "pairs_per_s": 20, "skipped": 0}


def test_tables_grow_row_by_row_and_are_cut_on_resume(tmp_path: Path) -> None:
    curves = Curves(tmp_path)
    for pairs in (100, 200, 300):
        curves.add(_row(pairs), {"total": 5.0 - pairs / 100, "cls": 0.25})
        curves.add_validation(pairs, 1.0, (SequenceScore("a", 9, 0.5, 1.0), SequenceScore("b", 0, None, None)))
    assert [r["total"] for r in read_rows(tmp_path / CURVE)] == ["4", "3", "2"]
    scores = (SequenceScore("a", 9, 0.5, 1.0), SequenceScore("b", 0, None, None))
    Curves(tmp_path).cut(200, [Validated(at, 1.0, scores) for at in (100, 200)])
    assert [r["pairs"] for r in read_rows(tmp_path / CURVE)] == ["100", "200"]
    last = read_rows(tmp_path / VALIDATION)[-1]
    assert (last["sequence"], last["pairs"], last["auc"]) == (
        "mean",
        "200",
        "0.5000",
    )  # b has no score: not in the mean
    curves.add(_row(250), {"total": 1.0, "cls": 0.5})
    assert [r["pairs"] for r in read_rows(tmp_path / CURVE)] == ["100", "200", "250"]


def test_a_row_cut_short_by_a_crash_is_left_out(tmp_path: Path) -> None:
    curves = Curves(tmp_path)
    curves.add(_row(100), {"total": 1.0, "cls": 0.5})
    with (tmp_path / CURVE).open("a") as file:
        file.write("200,2.0,1")
    curves.cut(1000)
    curves.add(_row(300), {"total": 1.0, "cls": 0.5})
    assert [r["pairs"] for r in read_rows(tmp_path / CURVE)] == ["100", "300"]


def test_the_picture(tmp_path: Path) -> None:
    curves = Curves(tmp_path)
    assert curves.draw() is None
    curves.add(_row(100), {"total": 1.0, "cls": 0.0})
    curves.add_validation(100, 1.0, (SequenceScore("a", 9, None, None),))
    picture = curves.draw()
    assert picture is not None
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["curve.csv", "curves.png", "validation.csv"]
