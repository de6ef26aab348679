"""What goes wrong around a run: foreign checkpoints, damaged files, a picture that cannot be drawn, no memory."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from tests.tracker.training.blobs import Blobs, Clock, after, footage, never, recipe, stage, tiny_network
from tracker.training.checkpoint import BEST, LAST, RECIPE, read_checkpoint, to_bytes, write_checkpoint
from tracker.training.curves import CURVE, VALIDATION, Curves, read_rows
from tracker.training.distributed import World
from tracker.training.errors import TrainingError
from tracker.training.loop import Trainer
from tracker.training.progress import Outcome, Progress
from tracker.training.recipe import Recipe, Validation
from tracker.training.types import Batch
from tracker.training.validate import SequenceScore

PLAN = recipe(stage(4))


@pytest.fixture(autouse=True)
def _light(monkeypatch: pytest.MonkeyPatch) -> None:
    torch.set_num_threads(1)
    monkeypatch.setattr(Curves, "draw", lambda self: None)


def _run(
    plan: Recipe,
    folder: Path,
    should_stop: Callable[[], bool] = never,
    resume: bool = True,
    reports: list[Progress] | None = None,
    validates: bool = False,
    batches: Blobs | None = None,
) -> Outcome:
    trainer = Trainer(
        plan,
        tiny_network(),
        lambda index: batches or Blobs(index),
        folder,
        device=torch.device("cpu"),
        world=World(),
        footage=[footage(frames=2)] if validates else [],
        resume=resume,
    )
    return trainer.run(should_stop, Clock(0.5), (reports if reports is not None else []).append)


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stopped")
    _run(PLAN, folder, after(1))
    return folder


@pytest.fixture
def folder(stopped: Path, tmp_path: Path) -> Path:
    """Of a run of PLAN that was stopped after its first step."""
    return Path(shutil.copytree(stopped, tmp_path / "run"))


def _all(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_checkpoint_is_taken_over_only_when_asked(folder: Path) -> None:
    before = _all(folder)
    with pytest.raises(TrainingError, match=r"last\.ckpt: a run lies there; resume it, or choose another folder$"):
        _run(PLAN, folder, resume=False)
    assert _all(folder) == before


@pytest.mark.parametrize("changes", [{"seed": 9}, {"ema": None}, {"description": "another"}])
def test_a_checkpoint_of_another_recipe_is_refused(folder: Path, changes: dict[str, object]) -> None:
    """Even where recipe.json has been replaced."""
    other = PLAN.model_copy(update=changes)
    (folder / RECIPE).write_text(other.model_dump_json())
    before = _all(folder)
    with pytest.raises(TrainingError, match=r"last\.ckpt: is of another recipe; resume it with its own recipe"):
        _run(other, folder)
    assert _all(folder) == before


def test_a_checkpoint_that_holds_no_recipe_goes_by_the_file_beside_it(folder: Path) -> None:
    old = replace(read_checkpoint(folder / LAST), recipe=None)
    write_checkpoint(folder / LAST, to_bytes(old))
    with pytest.raises(TrainingError, match="another recipe"):
        _run(PLAN.model_copy(update={"seed": 9}), folder)
    outcome = _run(PLAN, folder)
    assert (outcome.finished, outcome.pairs) == (True, 4)
    write_checkpoint(folder / LAST, to_bytes(old))
    (folder / RECIPE).unlink()
    with pytest.raises(TrainingError, match="another recipe"):
        _run(PLAN, folder)


def test_the_state_of_another_optimiser_is_one_line(folder: Path) -> None:
    kept = read_checkpoint(folder / LAST)
    assert kept.optimiser is not None
    foreign = {"state": {}, "param_groups": kept.optimiser["param_groups"][:1]}
    write_checkpoint(folder / LAST, to_bytes(replace(kept, optimiser=foreign)))
    with pytest.raises(TrainingError, match=r"^last\.ckpt: its optimiser's state is of another recipe \([^\n]+\)"):
        _run(PLAN, folder)


def test_a_damaged_best_checkpoint_costs_only_its_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scores = iter([(SequenceScore("a", 2, auc, auc),) for auc in (0.5, 0.4)])
    monkeypatch.setattr("tracker.training.loop.validate", lambda *arguments: next(scores))
    plan = recipe(stage(4), validation=Validation(every_pairs=2))

    class Breaking(Blobs):
        def batch(self, step: int) -> Batch:
            if step == 1:
                (tmp_path / BEST).write_bytes((tmp_path / BEST).read_bytes()[:-9])
            return super().batch(step)

    reports: list[Progress] = []
    outcome = _run(plan, tmp_path, reports=reports, validates=True, batches=Breaking())
    assert outcome.finished
    assert outcome.notes == ("best.ckpt is damaged, best.safetensors was not made",)
    assert reports[-1].note == outcome.notes[0]
    assert "weights.safetensors" in {path.name for path in outcome.files}
    assert not (tmp_path / "best.safetensors").exists()


def test_a_picture_that_cannot_be_drawn_is_a_note(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(self: Curves) -> None:
        raise KeyError("a font\nis missing")

    monkeypatch.setattr(Curves, "draw", broken)
    reports: list[Progress] = []
    outcome = _run(recipe(stage(6), checkpoint_minutes=0.01), tmp_path, reports=reports)
    assert outcome.finished
    (note,) = outcome.notes
    assert note.startswith("the curves were not drawn (KeyError: ")
    assert [report.note for report in reports].count(note) == 1


def test_damaged_and_foreign_tables_do_not_end_a_run(tmp_path: Path) -> None:
    plan = recipe(stage(6), validation=Validation(every_pairs=4, max_frames=2))
    _run(plan, tmp_path, after(3), validates=True)
    with (tmp_path / CURVE).open("ab") as file:
        file.write(b"\0\0\xff,,\r\n12")
    (tmp_path / VALIDATION).write_text("day,sales\n1,2\n")
    outcome = _run(plan, tmp_path, validates=True)
    assert outcome.finished
    assert outcome.notes == ("validation.csv was not a curve of this program and is validation.csv.old now",)
    assert [row["pairs"] for row in read_rows(tmp_path / VALIDATION)] == ["4", "4", "6", "6"]
    assert [row["pairs"] for row in read_rows(tmp_path / CURVE)][-1] == "6"


def test_a_checkpoint_just_before_a_validation_does_not_double_its_rows(tmp_path: Path) -> None:
    """The crash came between the rows and the checkpoint that knows of them."""
    plan = recipe(stage(6), validation=Validation(every_pairs=4, max_frames=2))
    _run(plan, tmp_path, after(3), validates=True)
    kept = read_checkpoint(tmp_path / LAST)
    kept.position.validations.clear()
    write_checkpoint(tmp_path / LAST, to_bytes(kept))
    _run(plan, tmp_path, validates=True)
    rows = [(row["pairs"], row["sequence"]) for row in read_rows(tmp_path / VALIDATION)]
    assert len(rows) == len(set(rows))


@pytest.mark.parametrize(
    "error",
    [
        torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 20.00 GiB."),
        RuntimeError("[enforce fail at alloc_cpu.cpp:114] data. DefaultCPUAllocator: can't allocate memory: you tried"),
        MemoryError(),
    ],
)
def test_no_memory_is_one_line_and_keeps_the_checkpoint(
    folder: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    before = (folder / LAST).read_bytes()

    def fails(*arguments: object) -> None:
        raise error

    monkeypatch.setattr("tracker.training.step.losses", fails)
    expected = (
        r"^out of memory at stage 1 \(batch 2, search 223 px\): make the batch smaller; the last checkpoint is kept$"
    )
    with pytest.raises(TrainingError, match=expected):
        _run(PLAN, folder)
    assert (folder / LAST).read_bytes() == before


def test_another_error_of_a_step_stays_what_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*arguments: object) -> None:
        raise RuntimeError("a fault of the program")

    monkeypatch.setattr("tracker.training.step.losses", fails)
    with pytest.raises(RuntimeError, match="a fault of the program"):
        _run(PLAN, tmp_path)
