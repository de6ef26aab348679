"""The smoke recipe, shortened: training on drawn pictures learns, resumes to the bit, and its result tracks."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
import torch
import yaml
from safetensors.torch import load_file

from tracker.training.curves import CURVE, read_rows
from tracker.training.recipe_file import recipe_text
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


def test_the_losses_that_need_no_anchor_fall(whole: Path) -> None:
    rows = read_rows(whole / CURVE)
    assert int(rows[-1]["pairs"]) == PAIRS
    for name in ("cls2", "anchor"):  # those of the boxes begin when the first anchors fit
        values = [float(row[name]) for row in rows]
        assert values[-1] < 0.8 * values[0], (name, values)


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
