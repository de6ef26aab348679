"""The smoke recipe, shortened: training on drawn pictures learns, resumes to the bit, and its result tracks."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
import torch
import yaml
from safetensors.torch import load_file
from torch import nn

from tracker.training.curves import CURVE, read_rows
from tracker.training.losses import losses
from tracker.training.pairs import HostBatches
from tracker.training.recipe import Recipe
from tracker.training.recipe_file import load_recipe, recipe_text
from tracker.training.start import start_network
from tracker.training.targets import draws_for, labels
from tracker.weights.store import load
from uavfollow.training.material import open_sources
from uavfollow.training.progress import TrainProgress

PAIRS = 96


@pytest.fixture(scope="module")
def recipe(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built-in recipe with fewer pictures and pairs."""
    values = yaml.safe_load(recipe_text("smoke"))
    values["sources"][0] |= {"sequences": 2, "frames": 8}
    values["validation"]["sources"][0] |= {"frames": 6}
    values["stages"][0] |= {"pairs": PAIRS, "lr": 0.002, "warmup_pairs": 16}
    path = tmp_path_factory.mktemp("smoke") / "short.yaml"
    path.write_text(yaml.safe_dump(values))
    return path


@pytest.fixture(scope="module")
def whole(recipe: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run in one go."""
    from uavfollow.__main__ import main

    torch.set_num_threads(1)
    out = tmp_path_factory.mktemp("run") / "whole"
    assert main(["train", "run", str(recipe), "--out", str(out), "--workers", "0", "--threads", "1"]) == 0
    return out


def test_the_losses_fall_on_pairs_that_were_not_trained_on(whole: Path, recipe: Path) -> None:
    assert int(read_rows(whole / CURVE)[-1]["pairs"]) == PAIRS
    plan = load_recipe(recipe)
    batches = HostBatches(open_sources(plan, Path()), plan, 0)
    before, after = start_network(plan), load(str(whole / "weights.safetensors")).network().train()
    for name in ("cls2", "anchor"):  # those of the boxes begin when the first anchors fit
        values = [_loss(network, batches, plan, name) for network in (before, after)]
        assert values[1] < 0.7 * values[0], (name, values)


def _loss(network: nn.Module, batches: HostBatches, plan: Recipe, name: str) -> float:
    """Mean over two batches beyond the run's own."""
    total = 0.0
    for step in (1000, 1001):
        batch = batches.batch(step)
        with torch.no_grad():
            maps = network(batch.exemplar.float(), batch.search.float())
        rows, cells = len(batch.box), maps.cls1.shape[-1] ** 2
        draws = draws_for(plan.seed, 0, step, range(rows), cells)
        targets = labels(maps, batch.box, batch.negative, plan.stages[0].search_px, plan.labels, draws)
        total += float(losses(maps, targets, plan.loss)[1][name]) / 2
    return total


def test_a_run_that_was_killed_halfway_ends_with_the_same_weights(
    whole: Path, recipe: Path, cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "halves"
    command = ("train", "run", recipe, "--out", out, "--workers", 0, "--threads", 1)
    with monkeypatch.context() as patch:
        patch.setattr(
            TrainProgress,
            "show",
            lambda self, progress: progress.pairs >= PAIRS // 2 and os.kill(os.getpid(), signal.SIGTERM),
        )
        assert cli(*command).code == 130
    stopped = int(read_rows(out / CURVE)[-1]["pairs"])
    assert 0 < stopped < PAIRS
    assert cli(*command, "--resume").code == 0
    one, two = load_file(whole / "weights.safetensors"), load_file(out / "weights.safetensors")
    assert one.keys() == two.keys()
    assert all(torch.equal(one[key], two[key]) for key in one)


def test_the_result_tracks(whole: Path, cli, material, tmp_path: Path) -> None:
    result = cli("track", material.folder, "--truth", material.truth, "--model", whole / "weights.safetensors",
                 "--raw", "--no-video", "--max-frames", 5, "--threads", 1, "--out", tmp_path / "tracked")  # fmt: skip
    assert result.code == 0, result.err
    rows = (tmp_path / "tracked" / "track.csv").read_text().splitlines()
    assert len(rows) == 6
    assert "LOCKED" in rows[-1]
