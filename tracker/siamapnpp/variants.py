"""The steps of the paper's component study: from the baseline SiamAPN to SiamAPN++, with one way to call them all.

What the paper calls them, and what is in them here:

siamapn   Baseline. Anchors from layer4 alone; layer5's correlation concatenated with the anchors' feature.
apn_df    Baseline + APN-DF: the anchors of SiamAPN++ from both levels. The head is the baseline's.
self_aan  ... + self-AAN: spatial and channel attention and conv4 on layer5's correlation, before the concatenation.
aan       ... + AAN: SiamAPN++ itself, where cross-attention replaces the concatenation.

The paper tells the steps, not their code: only the baseline and `aan` exist as official code, so what lies between is
our reading. Two things change with the last step besides the cross-attention, because the official `aan` has them: four
instead of two convolutions in the regression tower, and padded convolutions before layer5's correlation. Deviations
from the official baseline: anchors are in units of 71 px everywhere (it has 143), so that labels and decoding are the
same for all; and channels follow the network's size.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from tracker.siamapnpp.network import (
    GROUP_CHANNELS,
    AnchorProposal,
    Backbone,
    ChannelAttention,
    Maps,
    NetworkSize,
    SiamAPNpp,
    SpatialAttention,
    Template,
    correlate,
)

INIT_STD = 0.01  # official, for all convolutions but those that keep PyTorch's default


def _conv_bn_relu(inp: int, out: int, padding: int) -> nn.Sequential:
    return nn.Sequential(nn.Conv2d(inp, out, 3, padding=padding), nn.BatchNorm2d(out), nn.ReLU(inplace=True))


def _conv_gn_relu(inp: int, out: int) -> list[nn.Module]:
    norm = nn.GroupNorm(out // GROUP_CHANNELS, out)
    return [nn.Conv2d(inp, out, 3, padding=1), norm, nn.ReLU(inplace=True)]


def _initialise(module: nn.Module) -> None:
    for part in module.modules():
        if isinstance(part, (nn.Conv2d, nn.ConvTranspose2d)):
            nn.init.normal_(part.weight, std=INIT_STD)
            if part.bias is not None:
                nn.init.zeros_(part.bias)


class SingleLevelProposal(nn.Module):
    """The baseline's APN: anchors from layer4 alone, whose correlation is also the feature that the head fuses."""

    def __init__(self, c4: int, head: int) -> None:
        super().__init__()
        self.conv3 = _conv_bn_relu(c4, c4, padding=0)
        self.conv5 = _conv_bn_relu(c4, c4, padding=0)
        self.conv_shape = _conv_bn_relu(c4, head, padding=1)
        self.anchor = nn.Conv2d(head, 4, 3, padding=1)
        for block in (self.conv3, self.conv5, self.conv_shape):
            _initialise(block)

    def forward(self, phi4: Tensor, kernel: Tensor) -> tuple[Tensor, Tensor]:
        """Anchor map (B, 4, M, M) and correlation (B, C4, M, M); `kernel` is behind conv5."""
        response = correlate(self.conv3(phi4), kernel)
        return self.anchor(self.conv_shape(response)), response


class ConcatHead(nn.Module):
    """The baseline's head: un-padded convolutions, correlation, fusion by concatenation, towers of two.

    `offset_channels`: of the anchors' feature. `attention`: self-AAN and conv4 behind the correlation.
    """

    def __init__(self, c5: int, head: int, offset_channels: int, attention: bool) -> None:
        super().__init__()
        self.conv1 = _conv_bn_relu(c5, head, padding=0)
        self.conv2 = _conv_bn_relu(c5, head, padding=0)
        self.resize = nn.Sequential(*_conv_gn_relu(head, head), nn.Conv2d(head, head, 3))
        self.conv_offset = nn.Sequential(*_conv_gn_relu(offset_channels, head), nn.Conv2d(head, head, 3))
        self.add = nn.ConvTranspose2d(2 * head, head, 3)
        self.convloc = nn.Sequential(
            *_conv_gn_relu(head, head), *_conv_gn_relu(head, head), nn.Conv2d(head, 4, 3, padding=1)
        )
        self.convcls = nn.Sequential(*_conv_gn_relu(head, head), *_conv_gn_relu(head, head))
        self.cls1 = nn.Conv2d(head, 2, 3, padding=1)
        self.cls2 = nn.Conv2d(head, 2, 3, padding=1)
        self.cls3 = nn.Conv2d(head, 1, 3, padding=1)
        _initialise(self)
        # Made last: in SiamAPN++ the attentions and conv4 keep PyTorch's initialisation.
        self.attention = _self_attention(head) if attention else nn.Identity()

    def forward(self, phi5: Tensor, kernel: Tensor, proposal: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """cls1, cls2, cls3, loc; `kernel` is behind conv2, `proposal` the anchors' feature."""
        response = self.attention(correlate(self.conv1(phi5), kernel))
        both = torch.cat((self.resize(response), self.conv_offset(proposal)), dim=1)
        fused = self.add(F.relu(both))
        classes = self.convcls(fused)
        return self.cls1(classes), self.cls2(classes), self.cls3(classes), self.convloc(fused)


def _self_attention(head: int) -> nn.Sequential:
    return nn.Sequential(SpatialAttention(head), ChannelAttention(head), *_conv_bn_relu(head, head, padding=1))


class SiamAPN(nn.Module):
    """Variant `siamapn`. Same calls and maps as `SiamAPNpp`."""

    def __init__(self, size: NetworkSize) -> None:
        super().__init__()
        c4, c5 = size.backbone[3], size.backbone[4]
        self.backbone = Backbone(size.backbone)
        self.grader = SingleLevelProposal(c4, size.head)
        self.new = ConcatHead(c5, size.head, offset_channels=c4, attention=False)

    def template(self, exemplar: Tensor) -> Template:
        """(B, 3, 127, 127) to kernels; there is none of the grader's on layer5."""
        phi4, phi5 = self.backbone(exemplar)
        return Template(self.grader.conv5(phi4), phi5[:, :0], self.new.conv2(phi5))

    def search(self, template: Template, image: Tensor) -> Maps:
        """(B, 3, S, S) to the response maps."""
        phi4, phi5 = self.backbone(image)
        anchor, proposal = self.grader(phi4, template.phi4)
        return Maps(anchor, *self.new(phi5, template.head_phi5, proposal))

    def forward(self, exemplar: Tensor, image: Tensor) -> Maps:
        """Both branches at once."""
        return self.search(self.template(exemplar), image)


class SiamAPNdf(nn.Module):
    """Variants `apn_df` and, with attention, `self_aan`. Same calls and maps as `SiamAPNpp`."""

    def __init__(self, size: NetworkSize, attention: bool) -> None:
        super().__init__()
        c4, c5 = size.backbone[3], size.backbone[4]
        self.backbone = Backbone(size.backbone)
        self.grader = AnchorProposal(c4, c5, size.head)
        for block in (self.grader.conv3, self.grader.conv5, self.grader.conv6, self.grader.conv_shape):
            _initialise(block)
        self.new = ConcatHead(c5, size.head, offset_channels=size.head, attention=attention)

    def template(self, exemplar: Tensor) -> Template:
        """(B, 3, 127, 127) to kernels."""
        phi4, phi5 = self.backbone(exemplar)
        return Template(phi4, self.grader.conv6(phi5), self.new.conv2(phi5))

    def search(self, template: Template, image: Tensor) -> Maps:
        """(B, 3, S, S) to the response maps."""
        phi4, phi5 = self.backbone(image)
        anchor, proposal = self.grader(phi4, phi5, template)
        return Maps(anchor, *self.new(phi5, template.head_phi5, proposal))

    def forward(self, exemplar: Tensor, image: Tensor) -> Maps:
        """Both branches at once."""
        return self.search(self.template(exemplar), image)


VARIANTS: dict[str, Callable[[NetworkSize], nn.Module]] = {
    "siamapn": SiamAPN,
    "apn_df": lambda size: SiamAPNdf(size, attention=False),
    "self_aan": lambda size: SiamAPNdf(size, attention=True),
    "aan": SiamAPNpp,
}


def make_network(size: NetworkSize, variant: str = "aan") -> nn.Module:
    """A network with the official random initialisation (of the global generator) and `template`, `search`, `forward`.

    All variants give the same maps for a crop. Raises ValueError for an unknown variant.
    """
    if variant not in VARIANTS:
        raise ValueError(f"variant {variant!r}: known are {', '.join(VARIANTS)}")
    return VARIANTS[variant](size)
