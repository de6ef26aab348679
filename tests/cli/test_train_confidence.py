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
from uavfollow.training.confidence import Collected


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


def made_up(*_: object) -> Collected:
    """Samples of `b` and `c` without a network: the first feature (`head_1`) decides, the score knows nothing."""
    rng, samples = np.random.default_rng(0), []
    for k in range(80):
        values = rng.uniform(size=len(FEATURES))
        samples.append(Sample("bc"[k % 2], SampleKind.TRACK, values, 0.5, bool(values[0] > 0.5)))
    return Collected(samples, ("d: no frame with a usable target and a picture after it",), 91)


def too_early(*_: object) -> Collected:
    raise AssertionError("the work began before everything was checked")


def test_a_fit_with_the_network_as_json_and_into_another_card(cli, two: Path, tmp_path: Path) -> None:
    card = tmp_path / "card.json"
    result = cli("train", "confidence", "s", two, "--max-frames", 5, "--threads", 1, "--out", card, "--json")
    assert result.code == 0, result.err
    told = json.loads(result.out)
    assert json.loads(card.read_text())["confidence"] == told["confidence"]
    fit = told["confidence"]["fit"]
    assert fit["sequences"] == ["b", "c"]
    assert fit["samples"] == 2 * (4 + 2), "four frames after the first, and one probe of each kind"
    assert (fit["frames"], fit["collected"]) == (10, "at most 5 frames, seed 1")


def test_a_fit_is_told_and_written_into_the_card(cli, two: Path, own: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("uavfollow.training.confidence._collected", made_up)
    result = cli("train", "confidence", own, two, "--write")
    assert result.code == 0, result.err
    told = result.out.splitlines()
    assert "80 samples from 91 frames of 2 sequences (all frames, seed 1)" in told[0]
    assert [line.split("  ROC AUC")[0].strip() for line in told[1:3]] == ["while following", "tracker's score"]
    assert "ROC AUC 0.9" in told[1]
    assert "ROC AUC 0.500  ECE 0.0" in told[2]
    reasons = told[told.index("reason, ROC AUC without it, weights per deviation:") + 1 :]
    assert [line.split()[0] for line in reasons][0::5] == ["low_peak", "-"], "what carries most comes first"
    assert "  head_1 +" in reasons[0]
    assert len(reasons) == 6
    names = [part.split()[0] for line in reasons for part in line.rsplit("  ", 1)[1].split(", ") if part != "none"]
    assert len(set(names)) == len(names) > 1, "each weight once"
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


def test_what_cannot_be_fitted_is_refused_in_one_line(
    cli, two: Path, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("uavfollow.training.confidence._collected", too_early)
    none = cli("train", "confidence", "s")
    assert (none.code, none.out) == (2, "")
    assert "give sequence folders, or --recipe" in none.err
    twice = cli("train", "confidence", "s", data / "val/b", "--recipe", data / "tiny.yaml", "--data", data)
    assert twice.code == 2
    assert "sequences given twice: b" in twice.err
    single = cli("train", "confidence", "s", data / "val/b")
    assert single.code == 2
    assert single.err.splitlines()[-1].startswith("uavfollow: error: confidence: b alone cannot be judged")


def test_a_card_that_could_not_be_written_is_refused_before_the_work(
    cli, two: Path, own: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("uavfollow.training.confidence._collected", too_early)
    before = {path: path.read_bytes() for path in (own, card_path(own))}
    bare = tmp_path / "bare.safetensors"
    shutil.copy(own, bare)
    for model, out, why in (
        (own, tmp_path, f"is a folder; name the card in it, for example {tmp_path / 'card.json'}"),
        (own, tmp_path / "new", "is not the name of a card; let it end in .json"),
        (own, own, "is not the name of a card"),
        (own, tmp_path / "no/card.json", f"there is no folder {tmp_path / 'no'}"),
        (own, own / "card.json", f"there is no folder {own}"),
        (own, Path("/proc/card.json"), "/proc/card.json: cannot be written"),  # not even for root
        (bare, tmp_path / "card.json", f"{bare}: has no card to write into"),
    ):
        result = cli("train", "confidence", model, two, "--out", out)
        assert (result.code, result.out) == (2, ""), result.err
        assert why in result.err, out
    assert {path: path.read_bytes() for path in before} == before
    assert {path.name for path in tmp_path.iterdir()} == {"own.safetensors", "own.json", "bare.safetensors"}


def test_the_card_of_other_weights_is_never_written_over(
    cli, two: Path, own: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("uavfollow.training.confidence._collected", too_early)
    (tmp_path / "other.safetensors").write_bytes(b"other")
    beside = cli("train", "confidence", own, two, "--out", tmp_path / "other.json")
    assert beside.code == 2
    assert f"{tmp_path / 'other.safetensors'} is of other weights (sha256 " in beside.err
    assert not (tmp_path / "other.json").exists()
    card = {**json.loads(card_path(own).read_text()), "sha256": "0" * 64}
    (tmp_path / "lone.json").write_text(json.dumps(card))
    lone = cli("train", "confidence", own, two, "--out", tmp_path / "lone.json")
    assert lone.code == 2
    assert f"{tmp_path / 'lone.json'} is of other weights (sha256 000000000000..." in lone.err
    assert json.loads((tmp_path / "lone.json").read_text()) == card
    (tmp_path / "notes.json").write_text("[]")
    assert cli("train", "confidence", own, two, "--out", tmp_path / "notes.json").code == 2
    with own.open("ab") as file:
        file.write(b"\0")
    damaged = cli("train", "confidence", own, two, "--write")
    assert damaged.code == 2
    assert f"{own}: does not match the sha256 of its card" in damaged.err


def test_weights_that_changed_meanwhile_get_no_fit_and_the_fit_is_told(
    cli, two: Path, own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A retraining into the same files, with a card that fits its weights, ends while the confidence is fitted."""
    card = json.loads(card_path(own).read_text())

    def retrained(*_: object) -> Collected:
        shutil.copy(find("full"), own)
        shutil.copy(card_path(find("full")), card_path(own))
        return made_up()

    monkeypatch.setattr("uavfollow.training.confidence._collected", retrained)
    result = cli("train", "confidence", own, two, "--write")
    assert result.code == 2
    other = json.loads(card_path(find("full")).read_text())
    assert f"sha256 of the fit {card['sha256'][:12]}..., now {other['sha256'][:12]}..." in result.err
    assert json.loads(card_path(own).read_text()) == other
    assert "80 samples from 91 frames" in result.out, "the work is not lost"


def test_a_fit_may_be_written_over_the_same_weights_card(
    cli, two: Path, own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("uavfollow.training.confidence._collected", made_up)
    result = cli("train", "confidence", own, two, "--out", card_path(own))
    assert result.code == 0, result.err
    assert json.loads(card_path(own).read_text())["confidence"]["fit"]["frames"] == 91


def test_a_broken_block_names_the_card(own: Path) -> None:
    card = json.loads(card_path(own).read_text())
    card_path(own).write_text(json.dumps({**card, "confidence": {"names": []}}))
    with pytest.raises(ValueError, match=r"own\.json: confidence: the block lacks mean"):
        load(str(own)).confidence()
