"""The variants of the component study: the same calls, the same maps, the parameters that they should have."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from tracker.engines.torch_engine import Precision, TorchEngine
from tracker.siamapnpp.network import SIZES, NetworkSize, SiamAPNpp
from tracker.siamapnpp.variants import VARIANTS, make_network
from tracker.training.recipe import Variant


def _conv(inp: int, out: int, side: int = 3) -> int:
    return inp * out * side**2 + out


def _block(inp: int, out: int) -> int:
    """Convolution with a norm's two vectors."""
    return _conv(inp, out) + 2 * out


def _backbone(widths: tuple[int, ...]) -> int:
    w1, w2, w3, w4, w5 = widths
    convs = _conv(3, w1, 11) + _conv(w1, w2, 5) + _conv(w2, w3) + _conv(w3, w4) + _conv(w4, w5)
    return convs + 2 * sum(widths)


def _concat_head(size: NetworkSize, offset: int) -> int:
    c, c5 = size.head, size.backbone[4]
    branches = _block(c, c) + _conv(c, c) + _block(offset, c) + _conv(c, c)
    towers = 4 * _block(c, c) + _conv(c, 4) + _conv(c, 2) + _conv(c, 2) + _conv(c, 1)
    return 2 * _block(c5, c) + branches + _conv(2 * c, c) + towers


def _apn_df(size: NetworkSize) -> int:
    c, c4, c5 = size.head, size.backbone[3], size.backbone[4]
    fusion = _conv(2 * c, c, 1) + 2 * c * (c // 6) + 2
    return _block(c4, c) + 2 * _block(c5, c) + fusion + _block(c, c) + _conv(c, 4)


def _expected(size: NetworkSize, variant: str) -> int:
    c, c4 = size.head, size.backbone[3]
    if variant == "siamapn":
        apn = 2 * _block(c4, c4) + _block(c4, c) + _conv(c, 4)
        return _backbone(size.backbone) + apn + _concat_head(size, c4)
    plain = _backbone(size.backbone) + _apn_df(size) + _concat_head(size, c)
    spatial = 2 * _conv(c, c // 8, 1) + _conv(c, c, 1) + 1
    channel = 2 * c * (c // 6) + 1
    return plain + (spatial + channel + _block(c, c) if variant == "self_aan" else 0)


TINY = NetworkSize((8, 8, 16, 24, 32), 48)  # all widths differ: none can stand for another


@pytest.mark.parametrize("size", SIZES)
def test_parameters(size: str) -> None:
    with torch.device("meta"):
        counts = {v: sum(p.numel() for p in make_network(SIZES[size], v).parameters()) for v in VARIANTS}
    for variant in ("siamapn", "apn_df", "self_aan"):
        assert counts[variant] == _expected(SIZES[size], variant)
    assert counts["aan"] == {"full": 12_161_939, "s": 3_060_435}[size]
    if size == "full":
        assert [counts[v] for v in ("siamapn", "apn_df", "self_aan")] == [14_701_645, 13_674_831, 14_369_169]


def test_the_recipes_variants_are_these() -> None:
    assert set(VARIANTS) == {v.value for v in Variant}
    assert isinstance(make_network(SIZES["s"], Variant.AAN), SiamAPNpp)
    with pytest.raises(ValueError, match="siamapn, apn_df, self_aan, aan"):
        make_network(SIZES["s"], "siamrpn")


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize(("search_px", "cells"), [(287, 21), (223, 13)])
def test_maps(variant: str, search_px: int, cells: int) -> None:
    torch.manual_seed(1)
    network = make_network(TINY, variant).eval()
    exemplar, search = torch.rand(2, 3, 127, 127) * 255, torch.rand(2, 3, search_px, search_px) * 255
    with torch.no_grad():
        maps = network(exemplar, search)
        again = network.search(network.template(exemplar), search)  # type: ignore[operator]
    assert [tuple(m.shape) for m in maps] == [(2, n, cells, cells) for n in (4, 2, 2, 1, 4)]
    assert all(torch.equal(a, b) for a, b in zip(maps, again, strict=True))


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_parameter_learns(variant: str) -> None:
    """Also what several processes need: a parameter without a gradient stops them."""
    torch.manual_seed(2)
    network = make_network(TINY, variant).train()
    for name, parameter in network.named_parameters():
        if "gamma" in name:
            nn.init.constant_(parameter, 0.5)
    maps = network(torch.rand(2, 3, 127, 127) * 255, torch.rand(2, 3, 143, 143) * 255)
    sum((m - 1).square().mean() for m in maps).backward()
    assert not [n for n, p in network.named_parameters() if p.grad is None]
    # A bias before a norm has none that counts; every matrix has.
    assert not [n for n, p in network.named_parameters() if p.ndim > 1 and not p.grad.any()]


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_exemplar_matters(variant: str) -> None:
    torch.manual_seed(3)
    network = make_network(TINY, variant).train()
    search = torch.rand(2, 3, 143, 143) * 255
    with torch.no_grad():
        one = network(torch.rand(2, 3, 127, 127) * 255, search)
        two = network(torch.rand(2, 3, 127, 127) * 255, search)
    assert all((a - b).abs().max() > 1e-4 * a.abs().max() for a, b in zip(one, two, strict=True))


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_engine_runs_it(variant: str) -> None:
    """Folding and the tracker's engine work for variants too: they are validated as the real one is."""
    torch.manual_seed(4)
    network = make_network(TINY, variant).eval()
    generator = torch.Generator().manual_seed(5)
    exemplar, search = (torch.randint(0, 256, (s, s, 3), generator=generator, dtype=torch.uint8) for s in (127, 143))
    engine = TorchEngine(network, Precision.FP32, "cpu")  # type: ignore[arg-type]
    engine.set_exemplar(exemplar.numpy())
    found = engine.search(search.numpy())
    with torch.no_grad():
        wanted = network(*(c.permute(2, 0, 1)[None].float() for c in (exemplar, search)))
    for name in wanted._fields:
        a, b = torch.from_numpy(getattr(found, name)), getattr(wanted, name)[0]
        assert (a - b).abs().max() < 1e-3 * (1 + b.abs().max())
