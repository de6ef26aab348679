"""Weights: the embedded ones, official checkpoints on synthetic files, and everything that can be wrong with a file."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from tests.tracker.keys import synthetic_state
from tracker.siamapnpp.network import SIZES
from tracker.siamapnpp.settings import CentreTerm
from tracker.weights import layout
from tracker.weights.card import sha256_of
from tracker.weights.checkpoint import import_checkpoint, read_checkpoint
from tracker.weights.errors import WeightsError
from tracker.weights.store import load


@pytest.mark.parametrize("size", SIZES)
def test_embedded_weights_load_with_their_card(size: str) -> None:
    weights = load(size)
    assert weights.size == size == weights.card["size"]
    assert weights.card["sha256"] == sha256_of(weights.path)
    assert weights.settings().centre_term is CentreTerm.SIGMOID
    assert sum(p.numel() for p in weights.network().parameters()) == weights.card["parameters"]


def _official(path: Path, state: dict[str, torch.Tensor], prefix: str = "module.") -> Path:
    state = {prefix + k: v for k, v in state.items()}
    state[f"{prefix}backbone.layer1.1.num_batches_tracked"] = torch.tensor(7)
    torch.save({"epoch": 25, "state_dict": state, "optimizer": {"state": {}, "param_groups": [{"lr": 0.1}]}}, path)
    return path


@pytest.mark.parametrize("prefix", ["module.", ""])
def test_an_official_checkpoint_is_imported(tmp_path: Path, prefix: str) -> None:
    state = synthetic_state()
    card = import_checkpoint(_official(tmp_path / "model.pth", state, prefix), tmp_path / "model.safetensors")
    assert (card["tensors"], card["parameters"], card["size"]) == (128, 12_161_939, "full")
    weights = load(str(tmp_path / "model.safetensors"))
    assert weights.settings().centre_term is CentreTerm.LOGIT
    network = weights.network().state_dict()
    assert len(weights.tensors) == 128
    for key, value in state.items():
        if not key.startswith(layout.DEAD):
            assert torch.allclose(network[key], value, atol=1e-3), key


def test_a_bare_state_dict_without_the_dead_convolution_is_enough(tmp_path: Path) -> None:
    state = {k: v for k, v in synthetic_state().items() if not k.startswith(layout.DEAD)}
    torch.save(state, tmp_path / "bare.pth")
    assert len(read_checkpoint(tmp_path / "bare.pth")) == 128


def test_one_error_lists_missing_unexpected_and_misshaped(tmp_path: Path) -> None:
    state = synthetic_state()
    del state["new.cls3.bias"]
    state["new.cls4.weight"] = torch.zeros(1)
    state["grader.anchor.weight"] = torch.zeros(4, 256, 1, 1)
    state["new.cls1.bias"][0] = float("nan")
    with pytest.raises(WeightsError) as caught:
        read_checkpoint(_official(tmp_path / "bad.pth", state))
    message = str(caught.value)
    for part in (
        "1 missing: new.cls3.bias",
        "1 unexpected: new.cls4.weight",
        "1 mis-shaped: grader.anchor.weight is 4x256x1x1, not 4x256x3x3",
        "1 not finite: new.cls1.bias",
        "bad.pth",
    ):
        assert part in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (lambda s: s.pop("backbone.layer3.1.running_var"), "1 missing: backbone.layer3.1.running_var"),
        (lambda s: s.update({"extra.weight": torch.zeros(2)}), "1 unexpected: extra.weight"),
        (lambda s: s.update({"new.point.gamma": torch.zeros(2)}), "1 mis-shaped: new.point.gamma is 2, not 1"),
    ],
)
def test_each_fault_alone_is_found(tmp_path: Path, change: object, part: str) -> None:
    state = synthetic_state()
    change(state)  # type: ignore[operator]
    with pytest.raises(WeightsError) as caught:
        read_checkpoint(_official(tmp_path / "bad.pth", state))
    assert part in str(caught.value)


class _Bomb:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return Path.touch, (Path(_Bomb.target),)  # type: ignore[return-value]

    target = ""


@pytest.mark.parametrize("kind", ["torch", "pickle"])
def test_code_in_a_checkpoint_is_never_run(tmp_path: Path, kind: str) -> None:
    _Bomb.target = str(tmp_path / "exploded")
    path = tmp_path / "bomb.pth"
    if kind == "torch":
        torch.save({"state_dict": {}, "x": _Bomb()}, path)
    else:
        path.write_bytes(pickle.dumps({"state_dict": {}, "x": _Bomb()}))
    with pytest.raises(WeightsError, match="nothing was run"):
        read_checkpoint(path)
    assert not (tmp_path / "exploded").exists()


@pytest.mark.parametrize("content", [b"", b"hello", b"PK\x03\x04" + b"\0" * 100, bytes(range(256)) * 40])
def test_foreign_files_are_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    for name in ("x.pth", "x.safetensors"):
        (tmp_path / name).write_bytes(content)
    with pytest.raises(WeightsError) as first:
        read_checkpoint(tmp_path / "x.pth")
    with pytest.raises(WeightsError) as second:
        load(str(tmp_path / "x.safetensors"))
    assert "\n" not in str(first.value) + str(second.value)


def test_other_failures_say_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match="no such weights file"):
        load(str(tmp_path / "absent.safetensors"))
    _official(tmp_path / "a.pth", synthetic_state())
    with pytest.raises(WeightsError, match="weights import"):
        load(str(tmp_path / "a.pth"))
    save_file({"conv.weight": torch.zeros(3, 3)}, tmp_path / "foreign.safetensors")
    with pytest.raises(WeightsError, match="not SiamAPN"):
        load(str(tmp_path / "foreign.safetensors"))
    torch.save([1, 2], tmp_path / "list.pth")
    with pytest.raises(WeightsError, match="state_dict"):
        read_checkpoint(tmp_path / "list.pth")


def test_damage_after_the_card_was_written_is_found(tmp_path: Path) -> None:
    source = load("s").path
    copy = tmp_path / source.name
    data = bytearray(source.read_bytes())
    data[-1000] ^= 1
    copy.write_bytes(bytes(data))
    card = copy.with_suffix(".json")
    card.write_text(source.with_suffix(".json").read_text())
    with pytest.raises(WeightsError, match="sha256"):
        load(str(copy))
    card.write_text("{ not json")
    with pytest.raises(WeightsError, match="card cannot be read"):
        load(str(copy))
    card.write_text(json.dumps({"name": "x"}))
    with pytest.raises(WeightsError, match="lacks architecture"):
        load(str(copy))


def test_import_never_overwrites(tmp_path: Path) -> None:
    (tmp_path / "m.safetensors").write_bytes(b"mine")
    with pytest.raises(WeightsError, match="exists already"):
        import_checkpoint(_official(tmp_path / "m.pth", synthetic_state()), tmp_path / "m.safetensors")
    assert (tmp_path / "m.safetensors").read_bytes() == b"mine"
