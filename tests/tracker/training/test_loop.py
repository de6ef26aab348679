"""The training loop: it learns, it resumes to the bit, and bad batches leave no trace."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import nn

from tests.tracker.training.blobs import Blobs, Clock, after, footage, never, recipe, stage, tiny_network
from tracker.siamapnpp.settings import CentreTerm
from tracker.training.checkpoint import BEST, LAST, Position, read_checkpoint, read_recipe
from tracker.training.curves import CURVE, VALIDATION, Curves, read_rows
from tracker.training.distributed import World
from tracker.training.errors import TrainingError
from tracker.training.export import WEIGHTS, Made, describe_start, export
from tracker.training.loop import MAX_SKIPPED_IN_A_ROW, Trainer
from tracker.training.progress import Outcome, Progress
from tracker.training.recipe import Optimiser, Recipe, Stage, Validation
from tracker.training.step import autocast_dtype
from tracker.training.types import Batches, Footage
from tracker.training.validate import SequenceScore, Validated
from tracker.weights.card import card_path
from tracker.weights.store import load

CPU = torch.device("cpu")


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


@pytest.fixture
def no_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawing takes longer than the steps of most tests."""
    monkeypatch.setattr(Curves, "draw", lambda self: None)


def _blobs(poison: frozenset[int] = frozenset(), rows: int = 2) -> Callable[[int], Batches]:
    return lambda index: Blobs(index, rows, poison=poison)


def _run(
    plan: Recipe,
    folder: Path,
    should_stop: Callable[[], bool] = never,
    batches_for: Callable[[int], Batches] | None = None,
    items: list[Footage] | None = None,
    clock: Callable[[], float] | None = None,
    reports: list[Progress] | None = None,
) -> tuple[Outcome, nn.Module]:
    folder.mkdir(exist_ok=True)
    network = tiny_network()
    trainer = Trainer(
        plan, network, batches_for or _blobs(), folder, device=CPU, world=World(), footage=items or (), resume=True
    )
    seen = reports if reports is not None else []
    return trainer.run(should_stop, clock or Clock(0.5), seen.append), network


def _same(a: dict[str, torch.Tensor], b: dict[str, torch.Tensor]) -> bool:
    return a.keys() == b.keys() and all(torch.equal(v, b[k]) for k, v in a.items())


def test_the_loss_falls_and_the_run_leaves_what_it_promises(tmp_path: Path) -> None:
    plan = recipe(stage(80, lr=4e-3), validation=Validation(every_pairs=40, max_frames=3))
    reports: list[Progress] = []
    outcome, _ = _run(plan, tmp_path, items=[footage(frames=4)], clock=Clock(2.0), reports=reports)
    totals = [float(row["total"]) for row in read_rows(tmp_path / CURVE)]
    assert sum(totals[-4:]) < 0.75 * sum(totals[:4])
    assert outcome.finished
    assert (outcome.pairs, outcome.skipped_steps) == (80, 0)
    assert outcome.unused.lines() == ["1 unreadable image: blob_1.png"]
    assert [v.pairs for v in outcome.validations] == [40, 80]
    assert [r["pairs"] for r in read_rows(tmp_path / VALIDATION)] == ["40", "40", "80", "80"]
    names = {p.name for p in tmp_path.iterdir()}
    assert {LAST, BEST, "recipe.json", CURVE, VALIDATION, "curves.png", "weights.safetensors"} <= names
    assert not [n for n in names if n.endswith(".part")]
    assert all(path.is_file() for path in outcome.files)
    assert read_recipe(tmp_path) == plan
    assert reports[-1].pairs == reports[-1].pairs_planned == 80
    assert any(r.note == "validating" for r in reports)
    assert {"total", "cls1", "iou"} <= set(reports[0].losses)
    speed = reports[-1].pairs_per_s
    assert speed is not None
    assert speed > 0
    assert reports[-1].remaining_s == 0


RESUMED = recipe(stage(8), stage(8, frozen_layers=1, lr=1e-3, warmup_pairs=4))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, nn.Module]:
    """The run of RESUMED in one go: its folder and network."""
    folder = tmp_path_factory.mktemp("whole")
    return folder, _run(RESUMED, folder)[1]


@pytest.mark.usefixtures("no_picture")
@pytest.mark.parametrize("done", [2, 4, 6])
def test_a_stopped_run_goes_on_to_the_bit(tmp_path: Path, whole: tuple[Path, nn.Module], done: int) -> None:
    """Stops in the first stage, between the two, and in the second, whose optimiser and frozen layers are others."""
    folder, network = whole
    stopped, _ = _run(RESUMED, tmp_path, after(done))
    assert (stopped.finished, stopped.pairs) == (False, 2 * done)
    drawn: list[Blobs] = []

    def batches_for(index: int) -> Batches:
        drawn.append(Blobs(index))
        return drawn[-1]

    resumed, again = _run(RESUMED, tmp_path, batches_for=batches_for)
    expected = [(0, step) for step in range(done, 4)] + [(1, step) for step in range(max(0, done - 4), 4)]
    assert [(b.stage_index, step) for b in drawn for step in b.drawn] == expected
    assert (resumed.finished, resumed.pairs) == (True, 16)
    assert _same(network.state_dict(), again.state_dict())
    first, second = (read_checkpoint(path / LAST) for path in (folder, tmp_path))
    assert _same(first.average, second.average)
    assert (folder / "weights.safetensors").read_bytes() == (tmp_path / "weights.safetensors").read_bytes()


@pytest.mark.usefixtures("no_picture")
def test_a_run_that_is_done_changes_nothing_when_resumed(tmp_path: Path) -> None:
    plan = recipe(stage(4))
    _run(plan, tmp_path)
    before = (tmp_path / LAST).read_bytes()
    outcome, _ = _run(plan, tmp_path, items=[])
    assert (outcome.finished, outcome.pairs) == (True, 4)
    assert (tmp_path / LAST).read_bytes() == before


@pytest.mark.usefixtures("no_picture")
def test_a_stage_in_minutes_goes_on_with_its_time_after_a_stop(tmp_path: Path) -> None:
    plan = recipe(Stage(minutes=0.2, batch=2, lr=1e-3, warmup_pairs=0))
    reports: list[Progress] = []
    first, _ = _run(plan, tmp_path, after(3), clock=Clock(1.0), reports=reports)
    assert first.seconds == pytest.approx(7.0)  # two looks a step and one more at the stop
    second, _ = _run(plan, tmp_path, clock=Clock(1.0), reports=reports)
    assert second.finished
    assert second.seconds == pytest.approx(12.0, abs=1.0)
    rates = [r.rate for r in reports]
    assert rates == sorted(rates, reverse=True)
    assert rates[-1] < 0.1e-3 < 0.9e-3 < rates[0]
    assert reports[0].pairs_planned is None
    assert reports[0].remaining_s == pytest.approx(10.0)


@pytest.mark.usefixtures("no_picture")
def test_a_validation_takes_nothing_of_the_minutes_of_a_stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else a validation near the end would cut the learning rate's way down short."""
    clock = Clock(1.0)

    def slow(*arguments: object) -> tuple[SequenceScore, ...]:
        clock.now_s += 60.0
        return (SequenceScore("slow", 2, 0.5, 0.5),)

    monkeypatch.setattr("tracker.training.loop.validate", slow)
    plan = recipe(
        Stage(minutes=0.2, batch=2, lr=1e-3, warmup_pairs=0), validation=Validation(every_pairs=4, max_frames=2)
    )
    reports: list[Progress] = []
    outcome, _ = _run(plan, tmp_path, items=[footage(frames=2)], clock=clock, reports=reports)
    assert outcome.finished
    assert len(outcome.validations) > 1
    assert outcome.seconds > 60.0 * len(outcome.validations)
    assert reports[-1].rate < 0.1e-3


@pytest.mark.usefixtures("no_picture")
def test_a_nan_skips_its_step_and_leaves_no_trace(tmp_path: Path) -> None:
    plan = recipe(stage(8, lr_end=2e-3))
    outcome, network = _run(plan, tmp_path / "nan", batches_for=_blobs(frozenset({1, 3})))
    assert (outcome.finished, outcome.skipped_steps, outcome.pairs) == (True, 2, 8)
    assert all(bool(torch.isfinite(v).all()) for v in network.state_dict().values())
    assert all("nan" not in r["total"] for r in read_rows(tmp_path / "nan" / CURVE))
    # The last step was bad: the state is that after the one before.
    _run(plan, tmp_path / "stop", after(3), batches_for=_blobs(frozenset({1})))
    assert _same(network.state_dict(), read_checkpoint(tmp_path / "stop" / LAST).network)


@pytest.mark.usefixtures("no_picture")
def test_a_loss_above_its_limit_is_skipped(tmp_path: Path) -> None:
    plan = recipe(stage(4), optimiser=Optimiser(max_loss=1.0))
    outcome, network = _run(plan, tmp_path)
    assert outcome.skipped_steps == 2
    assert _same(network.state_dict(), tiny_network().state_dict())


class Always:
    """The same bad batch again and again."""

    def __init__(self) -> None:
        self._batch = Blobs(rows=1, poison=frozenset({0})).batch(0)

    def batch(self, step: int):  # type: ignore[no-untyped-def]
        return self._batch


@pytest.mark.usefixtures("no_picture")
def test_nothing_but_bad_batches_is_an_error_and_keeps_the_checkpoint(tmp_path: Path) -> None:
    plan = recipe(stage(2, batch=1), stage(MAX_SKIPPED_IN_A_ROW + 1, batch=1))
    good = Blobs(rows=1)
    with pytest.raises(TrainingError, match=f"stage 2, step {MAX_SKIPPED_IN_A_ROW}.*50 steps in a row"):
        _run(plan, tmp_path, batches_for=lambda index: Always() if index else good)
    assert read_checkpoint(tmp_path / LAST).position.pairs == 2


@pytest.mark.usefixtures("no_picture")
def test_a_stop_during_validation_is_made_up_for_on_resume(tmp_path: Path) -> None:
    plan = recipe(stage(2), validation=Validation(every_pairs=1000))
    stopped, _ = _run(plan, tmp_path, after(2), items=[footage(frames=4)])
    assert (stopped.finished, stopped.pairs, stopped.validations) == (False, 2, ())
    resumed, _ = _run(plan, tmp_path, items=[footage(frames=4)])
    assert resumed.finished
    assert [v.pairs for v in resumed.validations] == [2]


@pytest.mark.usefixtures("no_picture")
def test_a_checkpoint_of_another_network_or_a_damaged_one(tmp_path: Path) -> None:
    _run(recipe(stage(2)), tmp_path)
    other = nn.Module()
    other.backbone = nn.Linear(2, 2)
    trainer = Trainer(recipe(stage(2)), other, _blobs(), tmp_path, device=CPU, world=World(), resume=True)
    with pytest.raises(TrainingError, match=r"last\.ckpt.*another network"):
        trainer.run(never, Clock(), lambda _: None)
    (tmp_path / LAST).write_bytes((tmp_path / LAST).read_bytes()[:-100])
    with pytest.raises(TrainingError, match=r"last\.ckpt.*damaged"):
        _run(recipe(stage(2)), tmp_path)


@pytest.mark.usefixtures("no_picture")
def test_checkpoints_come_by_the_clock(tmp_path: Path) -> None:
    plan = recipe(stage(12), checkpoint_minutes=0.05)  # 3 s; a step takes 1 s of this clock
    saved: list[int] = []

    class Watching(Blobs):
        def batch(self, step: int):  # type: ignore[no-untyped-def]
            saved.append(read_checkpoint(tmp_path / LAST).position.step if (tmp_path / LAST).exists() else 0)
            return super().batch(step)

    _run(plan, tmp_path, batches_for=lambda index: Watching(index), clock=Clock(0.5))
    assert saved == [0, 0, 0, 3, 3, 3]


@pytest.mark.usefixtures("no_picture")
def test_variants_are_no_models(tmp_path: Path) -> None:
    outcome, _ = _run(recipe(stage(2), variant="apn_df"), tmp_path)
    assert "variant.safetensors" in {p.name for p in outcome.files}
    assert not (tmp_path / "weights.safetensors").exists()
    assert "apn_df" in card_path(tmp_path / "variant.safetensors").read_text()


@pytest.mark.usefixtures("no_picture")
def test_denormals_are_flushed_only_while_it_trains(tmp_path: Path) -> None:
    tiny = torch.tensor([1e-40])
    during: list[float] = []

    class Looking(Blobs):
        def batch(self, step: int):  # type: ignore[no-untyped-def]
            during.append(float(tiny * 1.0))
            return super().batch(step)

    plan = recipe(stage(6), validation=Validation(every_pairs=2))
    _run(plan, tmp_path, batches_for=lambda index: Looking(index), items=[footage(frames=2)])
    assert during == [0.0, 0.0, 0.0]
    assert float(tiny * 1.0) > 0


def test_exported_weights_load_as_a_model_and_say_how_they_were_made(tmp_path: Path) -> None:
    start = load("s")
    plan = recipe(stage(20), start={"model": "s"}, optimiser=Optimiser(kind="sgd"))
    scores = (SequenceScore("a", 9, 0.5, 0.75), SequenceScore("b", 0, None, None))
    position = Position(1, 0, 20, 0.0, 7200.0, 3600.0, 3, 0, validations=[Validated(20, 120.0, scores)])
    made = Made(plan, describe_start(plan.start), position, CPU, 2)
    path, card = export(tmp_path, WEIGHTS, start.network().state_dict(), made)
    weights = load(str(path))
    assert weights.size == "s"
    assert all(torch.equal(v, start.tensors[k]) for k, v in weights.tensors.items())
    assert weights.settings().centre_term is CentreTerm.SIGMOID
    assert start.card["sha256"] in weights.card["made_from"]
    assert weights.card["hours_of_training"] == 1.0
    assert weights.card["data"] == {"simulator": 1.0}
    assert weights.card["validation"]["mean"] == {"sequences": 1, "auc": 0.5, "p20": 0.75}
    assert weights.card["recipe"][1].startswith("20 pairs: batch 2, search 223 px, layers 1-2 frozen, lr 0.002 to 0")
    assert card == card_path(path)


def test_a_start_that_is_not_there_is_told_before_the_run(tmp_path: Path) -> None:
    plan = recipe(stage(2), start={"model": "missing.safetensors"})
    with pytest.raises(TrainingError, match="missing"):
        Trainer(plan, tiny_network(), _blobs(), tmp_path, device=CPU, world=World())


def test_precision() -> None:
    assert autocast_dtype("fp32", CPU) is None
    assert autocast_dtype("bf16", CPU) is torch.bfloat16
    assert autocast_dtype("auto", torch.device("cuda")) is torch.bfloat16
    with pytest.raises(TrainingError, match="fp16"):
        autocast_dtype("fp16", CPU)
