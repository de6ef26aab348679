"""Shapes, sizes and cost of the network, and that its inference forms say the same."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from tests.tracker.keys import official_shapes
from tracker.siamapnpp.fold import fold
from tracker.siamapnpp.network import SIZES, SiamAPNpp, correlate
from tracker.weights.layout import DEAD, expected_shapes
from tracker.weights.store import load


def _calibrated(size: str, seed: int = 0) -> SiamAPNpp:
    """Random weights whose BatchNorm statistics fit one random batch, with every attention switched on."""
    torch.manual_seed(seed)
    network = SiamAPNpp(SIZES[size])
    for name, parameter in network.named_parameters():
        if "gamma" in name:
            nn.init.constant_(parameter, 0.3)
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.momentum = None
    with torch.no_grad():
        network.train()(torch.rand(2, 3, 127, 127) * 255, torch.rand(2, 3, 287, 287) * 255)
    return network.eval()


@pytest.mark.parametrize("size", SIZES)
def test_shapes(size: str) -> None:
    network = SiamAPNpp(SIZES[size]).eval()
    c4, c5 = SIZES[size].backbone[3:]
    with torch.no_grad():
        z4, z5 = network.backbone(torch.zeros(1, 3, 127, 127))
        x4, x5 = network.backbone(torch.zeros(1, 3, 287, 287))
        maps = network(torch.zeros(2, 3, 127, 127), torch.zeros(2, 3, 287, 287))
        small = network(torch.zeros(1, 3, 127, 127), torch.zeros(1, 3, 223, 223))
    assert (z4.shape, z5.shape) == ((1, c4, 8, 8), (1, c5, 6, 6))
    assert (x4.shape, x5.shape) == ((1, c4, 28, 28), (1, c5, 26, 26))
    assert [tuple(m.shape) for m in maps] == [(2, n, 21, 21) for n in (4, 2, 2, 1, 4)]
    assert {m.shape[-1] for m in small} == {13}


def test_full_has_the_papers_parameters() -> None:
    assert sum(p.numel() for p in SiamAPNpp(SIZES["full"]).parameters()) == 12_161_939
    assert sum(p.numel() for p in SiamAPNpp(SIZES["s"]).parameters()) == 3_060_435


def test_state_dict_names_are_the_official_ones() -> None:
    official = official_shapes()
    assert len(official) == 134
    assert sum(torch.Size(s).numel() for s in official.values()) == 15_380_819
    assert expected_shapes(SIZES["full"]) == {k: s for k, s in official.items() if not k.startswith(DEAD)}


def test_search_branch_costs_9_21_gmac() -> None:
    network = SiamAPNpp(SIZES["full"]).eval()
    macs = 0

    def count(module: nn.Module, _: object, out: torch.Tensor) -> None:
        nonlocal macs
        assert isinstance(module, (nn.Conv2d, nn.ConvTranspose2d))
        k = module.kernel_size[0] * module.kernel_size[1]
        macs += out[0].numel() * k * module.in_channels // module.groups

    for module in network.modules():
        if isinstance(module, (nn.Conv2d, nn.ConvTranspose2d)):
            module.register_forward_hook(count)
    with torch.no_grad():
        template = network.template(torch.zeros(1, 3, 127, 127))
        macs = 0
        network.search(template, torch.zeros(1, 3, 287, 287))
    cells = 21 * 21
    correlations = 384 * cells * 64 + 2 * 256 * cells * 36
    attention = cells * cells * (32 + 256)
    assert (macs + correlations + attention) / 1e9 == pytest.approx(9.21, rel=0.01)


def test_correlation_is_per_sample_and_per_channel() -> None:
    torch.manual_seed(0)
    x, k = torch.rand(2, 3, 9, 9), torch.rand(2, 3, 4, 4)
    out = correlate(x, k)
    assert out.shape == (2, 3, 6, 6)
    assert out[1, 2, 5, 1] == pytest.approx(float((x[1, 2, 5:9, 1:5] * k[1, 2]).sum()), rel=1e-5)


@pytest.mark.parametrize("size", SIZES)
def test_folded_equals_unfolded(size: str) -> None:
    network = _calibrated(size)
    z, x = torch.rand(1, 3, 127, 127) * 255, torch.rand(1, 3, 287, 287) * 255
    with torch.no_grad():
        plain, folded = network(z, x), fold(network)(z, x)
    assert not any(isinstance(m, (nn.BatchNorm2d, nn.ConvTranspose2d)) for m in fold(network).modules())
    for a, b in zip(plain, folded, strict=True):
        assert float(a.std()) > 0
        assert float((a - b).abs().max()) < 1e-3


def test_folding_the_embedded_weights_changes_nothing() -> None:
    network = load("s").network()
    torch.manual_seed(1)
    z, x = torch.rand(1, 3, 127, 127) * 255, torch.rand(1, 3, 287, 287) * 255
    with torch.no_grad():
        plain, folded = network(z, x), fold(network)(z, x)
    assert max(float((a - b).abs().max()) for a, b in zip(plain, folded, strict=True)) < 1e-3


def test_the_embedded_full_is_the_same_function_as_s() -> None:
    torch.manual_seed(2)
    z, x = torch.rand(1, 3, 127, 127) * 255, torch.rand(1, 3, 287, 287) * 255
    if "exact widening" not in str(load("full").card.get("made_from")):
        pytest.skip("`full` has been trained beyond the widened `s`")
    with torch.no_grad():
        small, wide = load("s").network()(z, x), load("full").network()(z, x)
    assert max(float((a - b).abs().max()) for a, b in zip(small, wide, strict=True)) < 2e-3
