"""Frozen layers compute what they did, never move, and leave the state dict as it is."""

from __future__ import annotations

import copy

import pytest
import torch
from torch import Tensor, nn

from tracker.siamapnpp.fold import fold
from tracker.siamapnpp.network import NetworkSize, SiamAPNpp
from tracker.siamapnpp.variants import VARIANTS, make_network
from tracker.training.errors import TrainingError
from tracker.training.frozen import FrozenLayer, freeze
from tracker.weights.store import load


@pytest.fixture(scope="module")
def images() -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(1)
    return (
        torch.rand(2, 3, 127, 127, generator=generator) * 255,
        torch.rand(2, 3, 143, 143, generator=generator) * 255,
    )


TINY = NetworkSize((8, 8, 16, 24, 32), 16)


def _random(seed: int) -> SiamAPNpp:
    """Random weights and BatchNorm statistics that matter."""
    torch.manual_seed(seed)
    network = SiamAPNpp(TINY)
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            nn.init.uniform_(module.running_mean, -1, 1)  # type: ignore[arg-type]
            nn.init.uniform_(module.running_var, 100, 200)  # type: ignore[arg-type]
    return network


def _state(network: nn.Module) -> dict[str, Tensor]:
    return {k: v.clone() for k, v in network.state_dict().items()}


@pytest.mark.parametrize("layers", [2, 5])
def test_maps_and_state_stay_the_same(images: tuple[Tensor, Tensor], layers: int) -> None:
    network = load("s").network()
    before, names = _state(network), [n for n, _ in network.named_parameters()]
    with torch.no_grad():
        wanted = network(*images)
        freeze(network, layers)
        found = network(*images)
    for a, b in zip(wanted, found, strict=True):
        assert (a - b).abs().max() < 1e-3
    after = network.state_dict()
    assert list(after) == list(before)
    assert all(torch.equal(after[k], before[k]) for k in before)
    assert [n for n, _ in network.named_parameters()] == names


@pytest.mark.parametrize("layers", [0, 1, 2, 5])
def test_only_what_is_not_frozen_learns(images: tuple[Tensor, Tensor], layers: int) -> None:
    network = _random(2)
    freeze(network, layers)
    network.train()
    before = _state(network)
    learned = [p for p in network.parameters() if p.requires_grad]
    sum((m**2).mean() for m in network(*images)).backward()
    torch.optim.SGD(learned, lr=0.1).step()
    frozen = tuple(f"backbone.layer{n}." for n in range(1, layers + 1))
    moved = {k for k, v in network.state_dict().items() if not torch.equal(v, before[k])}
    assert not [k for k in moved if k.startswith(frozen)]
    for number in range(layers + 1, 6):
        assert f"backbone.layer{number}.0.weight" in moved
        assert f"backbone.layer{number}.1.running_mean" in moved
    for name, parameter in network.named_parameters():
        assert parameter.requires_grad == (not name.startswith(frozen)), name


def test_train_does_not_switch_frozen_batchnorm() -> None:
    network = _random(3)
    freeze(network, 2)
    for mode in (True, False, True):
        network.train(mode)
        assert not any(m.training for n in (1, 2) for m in network.backbone.get_submodule(f"layer{n}").modules())
        assert network.backbone.layer3.training is mode


def _differ(one: tuple[Tensor, Tensor], two: tuple[Tensor, Tensor]) -> float:
    """Largest difference of two backbones' features beside their size. (The heads of a young network hide it.)"""
    return max(float((a - b).abs().max() / b.abs().max()) for a, b in zip(one, two, strict=True))


def test_loading_a_state_dict_folds_anew(images: tuple[Tensor, Tensor]) -> None:
    network, other = _random(4), _random(5).eval()
    freeze(network, 2)
    network.eval()
    with torch.no_grad():
        before = network.backbone(images[1])
        network.load_state_dict(other.state_dict())
        found, wanted = network.backbone(images[1]), other.backbone(images[1])
    assert _differ(found, wanted) < 1e-4
    assert _differ(before, wanted) > 1e-2


def test_it_can_be_changed_and_undone(images: tuple[Tensor, Tensor]) -> None:
    network = _random(6)
    parameters = list(network.parameters())
    for layers in (2, 5, 1, 0):
        freeze(network, layers)
        frozen = [isinstance(network.backbone.get_submodule(f"layer{n}"), FrozenLayer) for n in range(1, 6)]
        assert frozen == [n <= layers for n in range(1, 6)]
    network.train()
    assert all(a is b for a, b in zip(parameters, network.parameters(), strict=True))
    assert all(p.requires_grad for p in parameters)
    assert all(m.training for m in network.modules())
    before = network.backbone.layer1[1].running_mean.clone()
    network(*images)
    assert not torch.equal(network.backbone.layer1[1].running_mean, before)


def test_refreezing_uses_the_parameters_of_now(images: tuple[Tensor, Tensor]) -> None:
    network = _random(7)
    freeze(network, 2)
    with torch.no_grad():
        network.backbone.layer1[0].weight.mul_(1.5)
    freeze(network, 2)
    plain = copy.deepcopy(network)
    freeze(plain, 0)
    with torch.no_grad():
        assert _differ(network.eval().backbone(images[1]), plain.eval().backbone(images[1])) < 1e-4


def test_copies_are_independent_and_can_be_folded(images: tuple[Tensor, Tensor]) -> None:
    """Validation copies the network, loads the averaged weights into the copy and folds it for the engine."""
    network, other = _random(8), _random(9).eval()
    freeze(network, 2)
    twin = copy.deepcopy(network).eval()
    twin.load_state_dict(other.state_dict())
    freeze(other, 2)
    with torch.no_grad():
        mine, theirs = network.eval().backbone(images[1]), other.backbone(images[1])
        assert _differ(twin.backbone(images[1]), theirs) < 1e-4
        assert _differ(fold(twin).backbone(images[1]), theirs) < 1e-4
    assert _differ(mine, theirs) > 1e-2


def test_channels_last_and_autocast(images: tuple[Tensor, Tensor]) -> None:
    network = load("s").network()
    freeze(network, 2)
    with torch.no_grad():
        wanted = network(*images)
        network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        with torch.autocast("cpu", torch.bfloat16):
            found = network(*(i.contiguous(memory_format=torch.channels_last) for i in images))
    assert network.backbone.layer1.folded_weight.is_contiguous(memory_format=torch.channels_last)  # type: ignore[union-attr,operator]
    assert torch.corrcoef(torch.stack((wanted.cls1.flatten(), found.cls1.float().flatten())))[0, 1] > 0.99


@pytest.mark.parametrize("variant", VARIANTS)
def test_all_variants_can_be_frozen(variant: str) -> None:
    torch.manual_seed(10)
    network = make_network(TINY, variant)
    freeze(network, 5)
    assert not any(p.requires_grad for p in network.get_submodule("backbone").parameters())


@pytest.mark.parametrize("layers", [-1, 6])
def test_a_wrong_number_is_refused(layers: int) -> None:
    with pytest.raises(TrainingError, match=f"frozen_layers {layers}.*0 to 5"):
        freeze(_random(11), layers)
