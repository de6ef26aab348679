"""The average of the weights."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from tracker.training.average import UPDATES, Average
from tracker.training.errors import TrainingError
from tracker.weights.layout import strip


def _network(value: float) -> nn.Sequential:
    network = nn.Sequential(nn.Conv2d(2, 3, 1), nn.BatchNorm2d(3))
    with torch.no_grad():
        for tensor in network.state_dict().values():
            tensor.fill_(value)
    return network


def _set(network: nn.Module, value: float) -> None:
    with torch.no_grad():
        for tensor in network.state_dict().values():
            tensor.fill_(value)


def test_it_follows_the_formula_statistics_too_and_copies_counters() -> None:
    network = _network(1.0)
    average, wanted = Average(network, 0.9), 1.0
    for step in range(1, 301):
        value = float(step % 7)
        _set(network, value)
        average.update(network)
        decay = min(0.9, step / (step + 25))
        wanted = decay * wanted + (1 - decay) * value
    found = average.tensors()
    assert set(found) == set(network.state_dict())
    for name, tensor in found.items():
        if name.endswith("num_batches_tracked"):
            assert tensor.item() == 300 % 7
        else:
            assert tensor.flatten().tolist() == pytest.approx([wanted] * tensor.numel(), rel=1e-4), name
    assert _all_equal(network, 300 % 7), "the network itself is not touched"


def _all_equal(network: nn.Module, value: float) -> bool:
    return all(bool((v == value).all()) for v in network.state_dict().values())


def test_the_start_is_soon_forgotten() -> None:
    """With a decay of 0.998 alone a tenth of random first weights would still be there after 1150 steps."""
    network = _network(1.0)
    average = Average(network, 0.998)
    _set(network, 0.0)
    for _ in range(50):
        average.update(network)
    assert average.tensors()["0.weight"].max() < 1e-6


@pytest.mark.parametrize("decay", [None, 0.0])
def test_without_decay_it_is_the_weights(decay: float | None) -> None:
    network = _network(1.0)
    average = Average(network, decay)
    _set(network, 4.0)
    average.update(network)
    assert all((v == 4.0).all() for v in average.tensors().values())


def test_it_is_fp32_and_independent() -> None:
    network = _network(1.0).bfloat16()
    average = Average(network, 0.9)
    _set(network, 2.0)
    assert average.tensors()["0.weight"].dtype is torch.float32
    assert (average.tensors()["0.weight"] == 1.0).all()
    average.update(network)
    assert average.tensors()["0.weight"].mean().item() == pytest.approx(1 + 25 / 26, rel=1e-5)


def test_it_resumes_identically() -> None:
    network = _network(1.0)
    average = Average(network, 0.95)
    for value in (3.0, 5.0):
        _set(network, value)
        average.update(network)
    resumed = Average(_network(0.0), 0.95)
    resumed.load_state_dict({k: v.clone() for k, v in average.state_dict().items()})
    _set(network, -2.0)
    for each in (average, resumed):
        each.update(network)
    assert resumed.updates == average.updates == 3
    for name, tensor in average.tensors().items():
        assert torch.equal(tensor, resumed.tensors()[name])


def test_its_state_can_be_loaded_and_saved_as_weights() -> None:
    network = _network(1.0)
    state = Average(network, 0.9).state_dict()
    other = _network(0.0)
    assert other.load_state_dict(state, strict=False).unexpected_keys == [UPDATES]
    assert _all_equal(other, 1.0)
    assert UPDATES not in strip(state)


def test_the_state_of_another_network_is_refused() -> None:
    average = Average(_network(1.0), 0.9)
    with pytest.raises(TrainingError, match=r"another network.*0\.weight"):
        average.load_state_dict({**average.state_dict(), "0.weight": torch.zeros(1)})
    with pytest.raises(TrainingError, match="another network"):
        average.load_state_dict(Average(nn.Linear(2, 2), 0.9).state_dict())
