from __future__ import annotations

import numpy as np
import pytest
import torch

from tracker.messages import ImageU8
from tracker.siamapnpp.network import NetworkSize, SiamAPNpp, correlate
from tracker.siamapnpp.variants import make_network
from tracker.training.feature_maps import CAPTION_PX, COLUMNS, GAP_PX, draw_maps, energies

SIDE = 223
TINY = NetworkSize((8, 8, 8, 8, 8), 32)
FULL = ("response", "after spatial attention", "after channel attention", "APN-DF: R_A", "after cross-AAN")
CELLS = 13


@pytest.fixture
def network() -> SiamAPNpp:
    """Attention that does something, as after training."""
    torch.manual_seed(2)
    made = SiamAPNpp(TINY)
    with torch.no_grad():
        for name, value in made.named_parameters():
            if "gamma" in name:
                value.fill_(0.5)
    return made.train()


def crop(side: int, seed: int) -> ImageU8:
    return np.random.default_rng(seed).integers(0, 256, (side, side, 3), dtype=np.uint8)


def test_the_sheet_shows_a_panel_for_each_stage(network: SiamAPNpp) -> None:
    search = crop(SIDE, 1)
    before = {name: value.clone() for name, value in network.state_dict().items()}
    sheet = draw_maps(network, crop(127, 0), search)
    height, width = SIDE + CAPTION_PX, SIDE
    rows = -(-(len(FULL) + 2) // COLUMNS)
    assert sheet.dtype == np.uint8
    assert sheet.shape == (rows * (height + GAP_PX) - GAP_PX, COLUMNS * (width + GAP_PX) - GAP_PX, 3)
    panels = []
    for i in range(len(FULL) + 2):
        y, x = i // COLUMNS * (height + GAP_PX) + CAPTION_PX, i % COLUMNS * (width + GAP_PX)
        panels.append(sheet[y : y + SIDE, x : x + SIDE].astype(int))
    for i, panel in enumerate(panels):
        assert all(np.abs(panel - other).mean() > 1.0 for other in panels[:i])
    middle = np.s_[(SIDE - 8 * CELLS) // 2 : (SIDE + 8 * CELLS) // 2]
    for panel in panels[1:]:  # heat lies on the cells only
        assert np.array_equal(panel[:50], (search[:50] * 0.45).astype(np.uint8))
        assert np.abs(panel[middle, middle] - search[middle, middle]).mean() > 20

    assert network.training
    assert not any(module._forward_hooks for module in network.modules())
    assert all(torch.equal(value, before[name]) for name, value in network.state_dict().items())


def test_the_energies_are_those_of_the_stages(network: SiamAPNpp) -> None:
    exemplar, search = crop(127, 0), crop(SIDE, 1)
    found = energies(network, exemplar, search)
    assert list(found) == list(FULL)
    assert all(energy.shape == (CELLS, CELLS) for energy in found.values())
    network.eval()
    z, x = (torch.from_numpy(v).permute(2, 0, 1)[None].float() for v in (exemplar, search))
    with torch.no_grad():
        template = network.template(z)
        phi4, phi5 = network.backbone(x)
        response = correlate(network.new.conv1(phi5), template.head_phi5)
        spatial = network.new.point(response)
        _, proposal = network.grader(phi4, phi5, template)
        channel = network.new.conv4(network.new.channel(spatial))
        fused = network.new.adcat(channel, proposal)
    for energy, feature in zip(found.values(), (response, spatial, channel, proposal, fused), strict=True):
        assert energy == pytest.approx(feature[0].abs().mean(0).numpy(), rel=1e-4, abs=1e-6)


def test_the_other_variants_show_what_they_have() -> None:
    heads = {"siamapn": 1, "apn_df": 1, "self_aan": 3}
    for variant, count in heads.items():
        found = energies(make_network(TINY, variant), crop(127, 0), crop(SIDE, 1))
        assert sorted(found) == sorted([*list(FULL)[:count], FULL[3], "after concatenation"])
        assert found["response"].shape == (CELLS, CELLS)


def test_stages_that_a_network_lacks_have_no_panel(network: SiamAPNpp) -> None:
    class Plain(torch.nn.Module):
        """The same without names that the stages know."""

        def __init__(self) -> None:
            super().__init__()
            self.inner = network

        def forward(self, exemplar: torch.Tensor, search: torch.Tensor) -> object:
            return self.inner(exemplar, search)

    assert draw_maps(Plain(), crop(127, 0), crop(SIDE, 1)).shape[0] == SIDE + CAPTION_PX


def test_crops_of_another_shape_are_refused(network: SiamAPNpp) -> None:
    for exemplar, search in ((crop(128, 0), crop(SIDE, 1)), (crop(127, 0), crop(SIDE, 1)[:-8])):
        with pytest.raises(ValueError, match="crops must be"):
            draw_maps(network, exemplar, search)
