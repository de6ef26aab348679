"""`uavfollow train confidence` on the drawn clip: figures, cards, errors."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from tracker.confidence.features import FEATURES
from tracker.training.confidence.fit import FITTED
from tracker.training.confidence.samples import Sample, SampleKind
from tracker.weights.card import card_path
from tracker.weights.store import find, load


@pytest.fixture(scope="module")
def two(data: Path) -> Path:
    """The clip twice: one sequence is judged by the other."""
    root = data / "two"
    for name in ("b", "c"):
        (root / name).mkdir(parents=True)
        (root / name / "img").symlink_to((data / "val/b/img").resolve())
        shutil.copy(data / "val/b/groundtruth_rect.txt", root / name)
    return root


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A copy of the embedded weights with their card, to write into."""
    path = tmp_path / "own.safetensors"
    shutil.copy(find("s"), path)
    shutil.copy(card_path(find("s")), card_path(path))
    return path


def made_up(*_: object) -> tuple[list[Sample], tuple[str, ...]]:
    """Samples of `b` and `c` without a network."""
    rng, samples = np.random.default_rng(0), []
    for k in range(80):
        values = rng.uniform(size=len(FEATURES))
        samples.append(Sample("bc"[k % 2], SampleKind.TRACK, values, 0.5, bool(values[0] > 0.5)))
    return samples, ("d: no frame with a usable target and a picture after it",)


def test_a_fit_with_the_network_as_json_and_into_another_card(cli, two: Path, tmp_path: Path) -> None:
    card = tmp_path / "card.json"
    result = cli("train", "confidence", "s", two, "--max-frames", 6, "--threads", 1, "--out", card, "--json")
    assert result.code == 0, result.err
    told = json.loads(result.out)
    assert json.loads(card.read_text())["confidence"] == told["confidence"]
    fit = told["confidence"]["fit"]
    assert fit["sequences"] == ["b", "c"]
    assert fit["samples"] == 2 * (5 + 2), "five frames after the first, and one probe of each kind"


def test_a_fit_is_told_and_written_into_the_card(cli, two: Path, own: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("uavfollow.training.confidence._collected", made_up)
    result = cli("train", "confidence", own, two, "--write")
    assert result.code == 0, result.err
    for part in ("80 samples of 2 sequences", "while following   ROC AUC 0.9", "without low_peak: ROC AUC 0."):
        assert part in result.out
    assert result.out.splitlines()[-1].startswith("  ")
    assert "not used: d: no frame" in result.err
    assert f"wrote {card_path(own)}" in result.err
    written = load(str(own)).confidence()
    assert written is not None
    assert written.names == FITTED


def test_sequences_beside_a_recipe_are_fitted_on_and_not_judged(
    cli, two: Path, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("uavfollow.training.confidence._collected", made_up)
    more = ("--recipe", data / "tiny.yaml", "--data", data)
    told = json.loads(cli("train", "confidence", "s", two / "c", *more, "--json").out)
    assert told["confidence"]["fit"]["sequences"] == ["b", "c"]
    assert told["confidence"]["fit"]["cross_validated"]["track"]["samples"] == 40
    assert told["without_additional"] is None, "one sequence cannot be judged by another"
    both = cli("train", "confidence", "s", two, "--json")
    assert json.loads(both.out)["confidence"]["fit"]["cross_validated"]["track"]["samples"] == 80


def test_what_cannot_be_fitted_is_refused_in_one_line(cli, two: Path, data: Path, tmp_path: Path) -> None:
    none = cli("train", "confidence", "s")
    assert (none.code, none.out) == (2, "")
    assert "give sequence folders, or --recipe" in none.err
    nowhere = cli("train", "confidence", "s", two, "--out", tmp_path / "no/card.json")
    assert nowhere.code == 2
    assert f"there is no folder {tmp_path / 'no'}" in nowhere.err
    twice = cli("train", "confidence", "s", data / "val/b", "--recipe", data / "tiny.yaml", "--data", data)
    assert twice.code == 2
    assert "sequences given twice: b" in twice.err
    single = cli("train", "confidence", "s", data / "val/b", "--max-frames", 2, "--threads", 1)
    assert single.code == 2
    assert single.err.splitlines()[-1].startswith("uavfollow: error: confidence: ")


def test_a_broken_block_names_the_card(own: Path) -> None:
    card = json.loads(card_path(own).read_text())
    card_path(own).write_text(json.dumps({**card, "confidence": {"names": []}}))
    with pytest.raises(ValueError, match=r"own\.json: confidence: the block lacks mean"):
        load(str(own)).confidence()
