"""The SiamAPN++ network with the official state-dict names, in the paper's width and in half of it.

Two images pass one AlexNet backbone. APN-DF correlates both feature levels and proposes one anchor box per cell;
self- and cross-attention (AAN) refine a second correlation, from which three classification maps and the box
deltas come. Batch first; images are BGR 0..255 without normalisation. Where the paper's equations and the official
code differ, this follows the code, because that is what a checkpoint needs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

GROUP_CHANNELS = 8  # GroupNorm of the towers: 32 groups at the paper's 256 channels
SQUEEZE = 6  # bottleneck of the channel attentions
QUERY_SQUEEZE = 8  # q and k of the spatial attention have an eighth of the channels (the paper draws all of them)


@dataclass(frozen=True, slots=True)
class NetworkSize:
    """Channels of the five backbone stages and of everything behind them."""

    backbone: tuple[int, int, int, int, int]
    head: int


SIZES = {
    "full": NetworkSize((96, 256, 384, 384, 256), 256),
    "s": NetworkSize((48, 128, 192, 192, 128), 128),
}


class Template(NamedTuple):
    """What the search branch needs of the exemplar: the three correlation kernels, computed once."""

    phi4: Tensor  # (B, C4, 8, 8)
    grader_phi5: Tensor  # (B, C, 6, 6), behind grader.conv6
    head_phi5: Tensor  # (B, C, 6, 6), behind new.conv2


class Maps(NamedTuple):
    """Raw outputs, each (B, n, M, M) with M = 21 for a 287 px search crop; rows are y."""

    anchor: Tensor  # 4: distances from the cell to left, right, top, bottom, in units of 71 px
    cls1: Tensor  # 2: does the cell's anchor overlap the target
    cls2: Tensor  # 2: does the cell lie in the target's middle
    cls3: Tensor  # 1: centre-ness logit
    loc: Tensor  # 4: dx, dy, dw, dh relative to the anchor


def correlate(search: Tensor, kernel: Tensor) -> Tensor:
    """Depth-wise cross-correlation (B, C, H, W) with (B, C, h, w): the batch is folded into the groups."""
    batch, channels, height, width = search.shape
    folded = search.reshape(1, batch * channels, height, width)
    out = F.conv2d(folded, kernel.reshape(batch * channels, 1, *kernel.shape[2:]), groups=batch * channels)
    return out.view(batch, channels, *out.shape[2:])


def _conv_bn_relu(inp: int, out: int) -> nn.Sequential:
    return nn.Sequential(nn.Conv2d(inp, out, 3, padding=1), nn.BatchNorm2d(out), nn.ReLU(inplace=True))


def _tower(channels: int, depth: int) -> list[nn.Module]:
    groups = channels // GROUP_CHANNELS
    blocks: list[nn.Module] = []
    for _ in range(depth):
        conv = nn.Conv2d(channels, channels, 3, padding=1)
        blocks += [conv, nn.GroupNorm(groups, channels), nn.ReLU(inplace=True)]
    return blocks


class Backbone(nn.Module):
    """AlexNet without padding; returns layer4 (non-negative) and layer5 (signed: it has no ReLU)."""

    def __init__(self, widths: tuple[int, int, int, int, int]) -> None:
        super().__init__()
        w1, w2, w3, w4, w5 = widths
        # The pool stands before the ReLU as in the official code; the two commute.
        self.layer1 = nn.Sequential(nn.Conv2d(3, w1, 11, 2), nn.BatchNorm2d(w1), nn.MaxPool2d(3, 2), nn.ReLU(True))
        self.layer2 = nn.Sequential(nn.Conv2d(w1, w2, 5), nn.BatchNorm2d(w2), nn.MaxPool2d(3, 2), nn.ReLU(True))
        self.layer3 = nn.Sequential(nn.Conv2d(w2, w3, 3), nn.BatchNorm2d(w3), nn.ReLU(True))
        self.layer4 = nn.Sequential(nn.Conv2d(w3, w4, 3), nn.BatchNorm2d(w4), nn.ReLU(True))
        self.layer5 = nn.Sequential(nn.Conv2d(w4, w5, 3), nn.BatchNorm2d(w5))

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """(B, 3, S, S) to the two feature levels; 127 px gives 8 and 6 cells, 287 px gives 28 and 26."""
        phi4 = self.layer4(self.layer3(self.layer2(self.layer1(image))))
        return phi4, self.layer5(phi4)


class Fusion(nn.Module):
    """`adcat`: x + gamma1 relu(P[x, z]) + gamma3 sigmoid(FFN(GAP z)) x. Used in APN-DF and as cross-AAN."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        # A 1x1 transposed convolution is a plain one with the weight's axes swapped; checkpoints have it this way.
        self.add: nn.Module = nn.ConvTranspose2d(2 * channels, channels, 1)
        self.fc1 = nn.Conv2d(channels, channels // SQUEEZE, 1, bias=False)
        self.fc2 = nn.Conv2d(channels // SQUEEZE, channels, 1, bias=False)
        self.gamma1 = nn.Parameter(torch.zeros(1))
        self.gamma3 = nn.Parameter(torch.zeros(1))

    def forward(self, x: Tensor, z: Tensor) -> Tensor:
        """Both (B, C, M, M)."""
        weight = torch.sigmoid(self.fc2(F.relu(self.fc1(F.adaptive_avg_pool2d(z, 1)))))
        mixed = F.relu(self.add(torch.cat((x, z), dim=1)))
        return x + self.gamma1 * mixed + self.gamma3 * (weight * x)


class AnchorProposal(nn.Module):
    """APN-DF (`grader`): one adaptive anchor per cell from both feature levels, and the feature it fused for that."""

    def __init__(self, c4: int, c5: int, head: int) -> None:
        super().__init__()
        self.conv_shape = _conv_bn_relu(head, head)
        self.anchor = nn.Conv2d(head, 4, 3, padding=1)
        self.conv3 = _conv_bn_relu(c4, head)
        self.conv5 = _conv_bn_relu(c5, head)
        self.conv6 = _conv_bn_relu(c5, head)
        self.adcat = Fusion(head)

    def forward(self, phi4: Tensor, phi5: Tensor, template: Template) -> tuple[Tensor, Tensor]:
        """Anchor map (B, 4, M, M) and fused feature R_A (B, C, M, M)."""
        r4 = self.conv3(correlate(phi4, template.phi4))
        r5 = correlate(self.conv5(phi5), template.grader_phi5)
        fused = self.adcat(r5, r4)
        return self.anchor(self.conv_shape(fused)), fused


class SpatialAttention(nn.Module):
    """Self-AAN, first half: every cell attends to every cell. No 1/sqrt(d), as in the official code."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.query_conv = nn.Conv2d(channels, channels // QUERY_SQUEEZE, 1)
        self.key_conv = nn.Conv2d(channels, channels // QUERY_SQUEEZE, 1)
        self.value_conv = nn.Conv2d(channels, channels, 1)
        self.gamma = nn.Parameter(torch.zeros(1))

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, M, M), unchanged in shape."""
        query = self.query_conv(x).flatten(2).transpose(1, 2)
        energy = query @ self.key_conv(x).flatten(2)
        # The unscaled logits are large: their softmax needs fp32 even where the rest runs in bf16.
        attention = torch.softmax(energy.float(), dim=-1).to(x.dtype)
        mixed = self.value_conv(x).flatten(2) @ attention.transpose(1, 2)
        out: Tensor = self.gamma * mixed.view_as(x) + x
        return out


class ChannelAttention(nn.Module):
    """Self-AAN, second half. The official module also owns a 7x7 convolution that it never runs; it is left out."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.fc1 = nn.Conv2d(channels, channels // SQUEEZE, 1, bias=False)
        self.fc2 = nn.Conv2d(channels // SQUEEZE, channels, 1, bias=False)
        self.gamma2 = nn.Parameter(torch.zeros(1))

    def _bottleneck(self, pooled: Tensor) -> Tensor:
        out: Tensor = self.fc2(F.relu(self.fc1(pooled)))
        return out

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, M, M), unchanged in shape."""
        strongest = self._bottleneck(F.adaptive_max_pool2d(x, 1))
        weight = torch.sigmoid(strongest + self._bottleneck(F.adaptive_avg_pool2d(x, 1)))
        return x + self.gamma2 * (weight * x)


class Head(nn.Module):
    """AAN and prediction heads (`new`)."""

    def __init__(self, c5: int, head: int) -> None:
        super().__init__()
        self.conv1 = _conv_bn_relu(c5, head)
        self.conv2 = _conv_bn_relu(c5, head)
        self.conv4 = _conv_bn_relu(head, head)
        self.point = SpatialAttention(head)
        self.channel = ChannelAttention(head)
        self.adcat = Fusion(head)
        self.convloc = nn.Sequential(*_tower(head, 4), nn.Conv2d(head, 4, 3, padding=1))
        self.convcls = nn.Sequential(*_tower(head, 2))
        self.cls1 = nn.Conv2d(head, 2, 3, padding=1)
        self.cls2 = nn.Conv2d(head, 2, 3, padding=1)
        self.cls3 = nn.Conv2d(head, 1, 3, padding=1)

    def forward(self, phi5: Tensor, template: Template, proposal: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """cls1, cls2, cls3, loc."""
        response = correlate(self.conv1(phi5), template.head_phi5)
        attended = self.conv4(self.channel(self.point(response)))
        fused = self.adcat(attended, proposal)
        classes = self.convcls(fused)
        return self.cls1(classes), self.cls2(classes), self.cls3(classes), self.convloc(fused)


class SiamAPNpp(nn.Module):
    """Exemplar and search crop to response maps. `template` runs once per target, `search` once per frame."""

    def __init__(self, size: NetworkSize = SIZES["full"]) -> None:
        super().__init__()
        c4, c5 = size.backbone[3], size.backbone[4]
        self.backbone = Backbone(size.backbone)
        self.grader = AnchorProposal(c4, c5, size.head)
        self.new = Head(c5, size.head)
        self._initialise()

    def _initialise(self) -> None:
        """Official initialisation: normal(0, 0.01) for the convolutions named in the sheet, the rest by default."""
        grader, new = self.grader, self.new
        small = [grader.conv3, grader.conv5, grader.conv6, grader.conv_shape, new.convloc, new.convcls]
        small += [new.conv1, new.conv2, new.cls1, new.cls2, new.cls3]  # type: ignore[list-item]
        for block in small:
            for module in block.modules():
                if isinstance(module, nn.Conv2d):
                    nn.init.normal_(module.weight, std=0.01)
                    if module.bias is not None:
                        nn.init.zeros_(module.bias)

    def template(self, exemplar: Tensor) -> Template:
        """(B, 3, 127, 127) to the kernels of the search branch."""
        phi4, phi5 = self.backbone(exemplar)
        return Template(phi4, self.grader.conv6(phi5), self.new.conv2(phi5))

    def search(self, template: Template, image: Tensor) -> Maps:
        """(B, 3, S, S), S = 287 by default, to the response maps."""
        phi4, phi5 = self.backbone(image)
        anchor, proposal = self.grader(phi4, phi5, template)
        return Maps(anchor, *self.new(phi5, template, proposal))

    def forward(self, exemplar: Tensor, image: Tensor) -> Maps:
        """Both branches at once, as training runs them."""
        return self.search(self.template(exemplar), image)
