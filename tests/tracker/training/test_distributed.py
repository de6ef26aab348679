"""Two processes that train one network do what one does with the whole batch."""

from __future__ import annotations

import os
from pathlib import Path
from unittest import mock

import pytest
import torch
import torch.multiprocessing as mp
from torch import nn

from tests.tracker.training.blobs import Blobs, Clock, after, footage, never, recipe, stage, tiny_network
from tracker.training.checkpoint import LAST, read_checkpoint
from tracker.training.curves import CURVE, Curves, read_rows
from tracker.training.distributed import World, joined, world_of_environment
from tracker.training.errors import TrainingError
from tracker.training.loop import Trainer
from tracker.training.recipe import Recipe, Stage, Validation

CPU = torch.device("cpu")


def _plan() -> Recipe:
    return recipe(stage(24, batch=4), validation=Validation(every_pairs=12, max_frames=2))


def _network() -> nn.Module:
    """BatchNorm in eval: it is the one thing that looks at the rows of its own process alone."""
    network = tiny_network()
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.momentum = 0.0
            module.train = lambda mode=True, m=module: nn.Module.train(m, False)  # type: ignore[method-assign]
    return network


def _timed() -> Recipe:
    return recipe(
        Stage(minutes=0.5, batch=4, lr=2e-3, warmup_pairs=0), validation=Validation(every_pairs=4, max_frames=2)
    )


def _train(
    folder: Path, world: World, fixed_norm: bool, stop_after: int | None = None, plan: Recipe | None = None
) -> nn.Module:
    torch.set_num_threads(1)
    network = _network() if fixed_norm else tiny_network()
    trainer = Trainer(
        plan or _plan(),
        network,
        lambda index: Blobs(index, 4, world.rank, world.size, poison=frozenset({4})),
        folder,
        device=CPU,
        world=world,
        footage=[footage(frames=3)] if world.leads else [],
        resume=True,
    )
    # The clocks differ, and one process alone is asked to stop: all must agree.
    stop = never if stop_after is None or world.leads else after(stop_after)
    with mock.patch.object(Curves, "draw", return_value=None):  # looked at elsewhere; importing matplotlib takes long
        trainer.run(stop, Clock(5.0 + world.rank), lambda _: None)
    return network


def _process(rank: int, size: int, folder: Path) -> None:
    os.environ.update(RANK=str(rank), WORLD_SIZE=str(size), LOCAL_RANK=str(rank))
    with joined(use_cuda=False, init_method=f"file://{folder}/meet") as world:
        network = _train(folder / "fixed", world, fixed_norm=True)
        torch.save(network.state_dict(), folder / f"{rank}.pt")
        network = _train(folder / "timed", world, fixed_norm=False, plan=_timed())
        torch.save(network.state_dict(), folder / f"timed-{rank}.pt")
        _train(folder / "norm", world, fixed_norm=False, stop_after=2)
        world.wait()
        stopped_at = read_checkpoint(folder / "norm" / LAST).position.step
        world.wait()
        if stopped_at != 2:
            raise AssertionError(f"stopped at step {stopped_at}")
        _train(folder / "norm", world, fixed_norm=False)


def _left_alone(rank: int, size: int, folder: Path) -> None:
    os.environ.update(RANK=str(rank), WORLD_SIZE=str(size), LOCAL_RANK=str(rank))
    with joined(use_cuda=False, init_method=f"file://{folder}/meet") as world:
        if world.led(lambda: b"given") != b"given":
            raise AssertionError("process 0's choice did not arrive")
        assert world.led(lambda: None) is None

        def refuses() -> bytes:
            raise TrainingError("no such folder")

        with pytest.raises(TrainingError, match="^no such folder$" if world.leads else "^$"):
            world.led(refuses)
        world.wait()
        if world.leads:
            return
        with pytest.raises(
            TrainingError, match=r"another process of this run ended \(.+\); its message says why; go on"
        ):
            world.wait()
        if not world.lost(RuntimeError("[gloo/transport/tcp/pair.cc:534] Connection closed by peer")):
            raise AssertionError("the error of a backward pass is not told as that of another process")
    (folder / "told").touch()


def test_process_0_alone_says_why_and_one_left_alone_says_so(tmp_path: Path) -> None:
    mp.spawn(_left_alone, (2, tmp_path), nprocs=2)
    assert (tmp_path / "told").exists()
    assert not World().lost(RuntimeError("Connection closed by peer"))


def _losses(folder: Path) -> list[float]:
    return [float(row["total"]) for row in read_rows(folder / CURVE)]


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, nn.Module]:
    """Folders of one process and of two, with a run whose BatchNorm is fixed and one whose is not; a fixed network."""
    one, two = (tmp_path_factory.mktemp(name) for name in ("one", "two"))
    for folder in (one, two):
        (folder / "fixed").mkdir()
        (folder / "norm").mkdir()
        (folder / "timed").mkdir()
    mp.spawn(_process, (2, two), nprocs=2)
    network = _train(one / "fixed", World(), fixed_norm=True)
    _train(one / "norm", World(), fixed_norm=False)
    return one, two, network


def test_two_processes_have_the_loss_curve_of_one(folders: tuple[Path, Path, nn.Module]) -> None:
    """Stricter than the curve: without batch statistics the weights themselves are the same within rounding."""
    one, two, alone = folders
    losses = _losses(one / "fixed")
    assert len(losses) == 5  # a row a step; the step with the NaN has none
    assert _losses(two / "fixed") == pytest.approx(losses, rel=2e-3)
    states = [torch.load(two / f"{rank}.pt", weights_only=True) for rank in (0, 1)]
    for key, value in alone.state_dict().items():
        assert torch.equal(states[0][key], states[1][key]), key
        assert torch.allclose(states[0][key].float(), value.float(), atol=5e-4), key
    assert read_checkpoint(two / "fixed" / LAST).position.skipped_steps == 1


def test_batch_statistics_are_of_own_rows(folders: tuple[Path, Path, nn.Module]) -> None:
    """BatchNorm normalises by 2 rows instead of 4. This run was stopped by one process's wish and resumed by both."""
    one, two, _ = folders
    assert len(_losses(two / "norm")) == 5
    assert _losses(two / "norm") == pytest.approx(_losses(one / "norm"), rel=0.15)


def test_processes_whose_clocks_differ_agree_on_rate_and_end(folders: tuple[Path, Path, nn.Module]) -> None:
    states = [torch.load(folders[1] / f"timed-{rank}.pt", weights_only=True) for rank in (0, 1)]
    learned = [key for key in states[0] if ".running_" not in key]
    assert all(torch.equal(states[0][key], states[1][key]) for key in learned)
    assert len(_losses(folders[1] / "timed")) >= 2


def test_alone_nothing_is_communicated() -> None:
    world = World()
    value = torch.ones(2)
    assert world.leads
    assert world.highest([1, 0.5]) == [1.0, 0.5]
    assert world.mean(value) is value
    assert world.share(b"x") == b"x"
    network = tiny_network()
    assert world.wrap(network) is network
    world.wait()


def test_the_world_of_torchrun(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("RANK", "WORLD_SIZE", "LOCAL_RANK"):
        monkeypatch.delenv(name, raising=False)
    assert world_of_environment() == World()
    monkeypatch.setenv("WORLD_SIZE", "4")
    with pytest.raises(TrainingError, match="RANK"):
        world_of_environment()
    monkeypatch.setenv("RANK", "3")
    monkeypatch.setenv("LOCAL_RANK", "1")
    assert world_of_environment() == World(3, 4, 1)
    monkeypatch.setenv("RANK", "4")
    with pytest.raises(TrainingError, match="does not fit"):
        world_of_environment()
