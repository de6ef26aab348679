"""Groups of the optimisers."""

from __future__ import annotations

import pytest
import torch

from tracker.siamapnpp.network import SIZES, SiamAPNpp
from tracker.training.errors import TrainingError
from tracker.training.frozen import freeze
from tracker.training.optimise import make_optimiser, set_rate
from tracker.training.recipe import Optimiser


@pytest.fixture
def network() -> SiamAPNpp:
    torch.manual_seed(1)
    return SiamAPNpp(SIZES["s"])


def _settings(network: SiamAPNpp, optimiser: torch.optim.Optimizer) -> dict[str, tuple[float, float]]:
    """Rate and decay by parameter name."""
    names = {id(p): n for n, p in network.named_parameters()}
    return {names[id(p)]: (g["lr"], g["weight_decay"]) for g in optimiser.param_groups for p in g["params"]}


def test_adamw_groups(network: SiamAPNpp) -> None:
    freeze(network, 2)
    optimiser = make_optimiser(network, Optimiser(backbone_factor=0.5, weight_decay=0.02), 1e-3)
    assert isinstance(optimiser, torch.optim.AdamW)
    found = _settings(network, optimiser)
    assert set(found) == {n for n, p in network.named_parameters() if p.requires_grad}
    assert found["backbone.layer3.0.weight"] == (5e-4, 0.02)
    assert found["backbone.layer3.1.weight"] == (5e-4, 0.0)
    assert found["new.cls1.weight"] == (1e-3, 0.02)
    assert found["new.cls1.bias"] == found["new.point.gamma"] == found["new.convcls.1.weight"] == (1e-3, 0.0)
    assert {g["betas"] for g in optimiser.param_groups} == {(0.9, 0.98)}


def test_sgd_as_the_paper_decays_everything(network: SiamAPNpp) -> None:
    kind = Optimiser(kind="sgd", backbone_factor=0.1, weight_decay=1e-4, decay_all=True, momentum=0.9)
    optimiser = make_optimiser(network, kind, 0.005)
    assert isinstance(optimiser, torch.optim.SGD)
    found = _settings(network, optimiser)
    assert found["backbone.layer5.1.bias"] == pytest.approx((0.0005, 1e-4))
    assert found["new.cls3.bias"] == pytest.approx((0.005, 1e-4))
    assert {g["momentum"] for g in optimiser.param_groups} == {0.9}


def test_set_rate_keeps_the_factors_also_after_loading(network: SiamAPNpp) -> None:
    optimiser = make_optimiser(network, Optimiser(backbone_factor=0.25), 1e-3)
    again = make_optimiser(network, Optimiser(backbone_factor=0.25), 1e-3)
    again.load_state_dict(optimiser.state_dict())
    for each in (optimiser, again):
        set_rate(each, 4e-4)
        found = _settings(network, each)
        assert found["backbone.layer1.0.weight"][0] == pytest.approx(1e-4)
        assert found["new.conv1.0.weight"][0] == pytest.approx(4e-4)


def test_frozen_backbone_has_no_group(network: SiamAPNpp) -> None:
    freeze(network, 5)
    optimiser = make_optimiser(network, Optimiser(), 1e-3)
    assert [g["name"] for g in optimiser.param_groups] == ["heads, decay", "heads, no decay"]


def test_nothing_to_train_is_an_error(network: SiamAPNpp) -> None:
    with pytest.raises(TrainingError, match="freeze fewer"):
        make_optimiser(network.requires_grad_(False), Optimiser(), 1e-3)
