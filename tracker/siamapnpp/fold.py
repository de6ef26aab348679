"""Inference form of the network: BatchNorm folded into its convolution, 1x1 transposed convolutions made plain ones."""

from __future__ import annotations

import copy

import torch
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from tracker.siamapnpp.network import Fusion, SiamAPNpp


def _fold_sequential(block: nn.Sequential) -> nn.Sequential:
    layers = list(block)
    folded: list[nn.Module] = []
    for layer in layers:
        if isinstance(layer, nn.BatchNorm2d):
            conv = folded.pop()
            assert isinstance(conv, nn.Conv2d), "a BatchNorm without a convolution before it"
            folded.append(fuse_conv_bn_eval(conv, layer))
        else:
            folded.append(layer)
    return nn.Sequential(*folded)


def _plain_1x1(transposed: nn.ConvTranspose2d) -> nn.Conv2d:
    conv = nn.Conv2d(transposed.in_channels, transposed.out_channels, 1)
    with torch.no_grad():
        conv.weight.copy_(transposed.weight.transpose(0, 1))
        assert transposed.bias is not None
        assert conv.bias is not None
        conv.bias.copy_(transposed.bias)
    return conv


def fold(network: SiamAPNpp) -> SiamAPNpp:
    """A copy for inference, equal to `network` in eval mode within 1e-3 on every map. Its state dict has other keys."""
    result = copy.deepcopy(network).eval()
    for parent in list(result.modules()):
        for name, child in list(parent.named_children()):
            if isinstance(child, nn.Sequential) and any(isinstance(m, nn.BatchNorm2d) for m in child):
                setattr(parent, name, _fold_sequential(child))
        if isinstance(parent, Fusion) and isinstance(parent.add, nn.ConvTranspose2d):
            parent.add = _plain_1x1(parent.add)
    return result.requires_grad_(False)
