"""`full` from `s`: the same function."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from tracker.siamapnpp.network import SIZES, Maps, SiamAPNpp
from tracker.training.errors import TrainingError
from tracker.training.widen import widen
from tracker.weights.store import load

NARROW, WIDE = SIZES["s"], SIZES["full"]


def _crops(seed: int) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(1, 3, 127, 127, generator=generator) * 255, torch.rand(1, 3, 143, 143, generator=generator) * 255


def _network(tensors: dict[str, Tensor]) -> SiamAPNpp:
    network = SiamAPNpp(WIDE).eval()
    assert not network.load_state_dict(tensors, strict=False).unexpected_keys
    return network


def _worst(one: Maps, two: Maps) -> float:
    return max(float((a - b).abs().max()) for a, b in zip(one, two, strict=True))


def test_embedded_s_widened_is_embedded_full() -> None:
    """True until one of the two is trained further; the embedded `full` was made in this way."""
    found, wanted = widen(load("s").tensors), load("full")
    if "widen" not in str(wanted.card.get("made_from", "")).lower():
        pytest.skip("the embedded full has been trained on since it was widened")
    assert set(found) == set(wanted.tensors)
    for name, tensor in wanted.tensors.items():
        assert (found[name] - tensor).abs().max() <= 1e-3 * tensor.abs().max(), name


@pytest.mark.parametrize("uneven", [0.0, 0.5])
def test_maps_stay_the_same(uneven: float) -> None:
    narrow = load("s")
    tensors = {k: v + 0.1 if "gamma" in k else v for k, v in narrow.tensors.items()}  # every branch takes part
    network = SiamAPNpp(NARROW).eval()
    network.load_state_dict(tensors, strict=False)
    with torch.no_grad():
        wanted, found = network(*_crops(1)), _network(widen(tensors, uneven, seed=2))(*_crops(1))
    assert max(float(m.abs().max()) for m in wanted) > 0.5
    assert _worst(wanted, found) < 1e-3


def test_uneven_shares_let_the_copies_part() -> None:
    """Exact halves have equal gradients in both copies: such a network would stay an `s` for ever."""
    differences = []
    for uneven in (0.0, 0.1):
        network = _network(widen(load("s").tensors, uneven, seed=3))
        sum((m**2).mean() for m in network(*_crops(2))).backward()
        gradient = network.new.conv1[0].weight.grad
        assert gradient is not None
        differences.append(float((gradient[:128] - gradient[128:]).norm() / gradient.norm()))
    assert differences[0] < 1e-5
    assert differences[1] > 1e-2


def test_uneven_shares_are_seeded_and_keep_signs() -> None:
    tensors = load("s").tensors
    one, again, other = (widen(tensors, 0.5, seed) for seed in (1, 1, 2))
    name = "new.conv4.0.weight"
    assert torch.equal(one[name], again[name])
    assert not torch.equal(one[name], other[name])
    assert (one[name][:128, :128] * tensors[name] >= 0).all()


def test_only_an_s_can_be_widened() -> None:
    with pytest.raises(TrainingError, match="only weights of size s"):
        widen(load("full").tensors)
    with pytest.raises(TrainingError, match="missing"):
        widen({k: v for k, v in load("s").tensors.items() if k != "new.cls1.bias"})
    with pytest.raises(ValueError, match="uneven"):
        widen(load("s").tensors, 0.6)
