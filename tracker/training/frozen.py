"""Backbone layers that do not learn: no gradient, fixed BatchNorm, and the two folded into one convolution."""

from __future__ import annotations

from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_weights

from tracker.training.errors import TrainingError

LAYERS = 5


class FrozenLayer(nn.Sequential):
    """Convolution, BatchNorm and what follows, with the names and tensors of the layer that it stands for.

    Runs on a folded copy of the first two, without gradient, whatever mode the network is in. The copy is no part of
    the state dict; loading a state dict makes it anew.
    """

    folded_weight: Tensor
    folded_bias: Tensor

    def __init__(self, layer: nn.Sequential) -> None:
        super().__init__(*layer)
        # Empty ones first: they then follow the network to its device and memory format.
        self.register_buffer("folded_weight", torch.empty(0), persistent=False)
        self.register_buffer("folded_bias", torch.empty(0), persistent=False)
        self.register_load_state_dict_post_hook(_refold)  # type: ignore[no-untyped-call]
        self.requires_grad_(False)
        self.train(False)
        self.refold()

    @torch.no_grad()
    def refold(self) -> None:
        """Fold the present values of convolution and BatchNorm."""
        conv, norm = self[0], self[1]
        assert isinstance(conv, nn.Conv2d)
        assert isinstance(norm, nn.BatchNorm2d)
        assert norm.running_mean is not None
        assert norm.running_var is not None
        weight, bias = fuse_conv_bn_weights(
            conv.weight, conv.bias, norm.running_mean, norm.running_var, norm.eps, norm.weight, norm.bias
        )
        self.folded_weight, self.folded_bias = weight.detach(), bias.detach()

    def train(self, mode: bool = True) -> FrozenLayer:
        """Always eval: its BatchNorm statistics are fixed too."""
        super().train(False)
        return self

    def forward(self, image: Tensor) -> Tensor:
        """As the layer in eval mode within rounding, without gradient."""
        conv = self[0]
        assert isinstance(conv, nn.Conv2d)
        with torch.no_grad():
            out = F.conv2d(image, self.folded_weight, self.folded_bias, conv.stride)
            for child in list(self)[2:]:
                out = child(out)
        return out


def _refold(layer: nn.Module, incompatible: Any) -> None:
    assert isinstance(layer, FrozenLayer)
    layer.refold()


def freeze(network: nn.Module, layers: int) -> None:
    """Freeze the first `layers` (0 to 5) of `network.backbone`, and only them; call it again to change that.

    State dict and parameter objects stay the same, only `requires_grad` changes: make the optimiser afterwards. Call it
    before the network is wrapped for several processes. Raises TrainingError for another number.
    """
    if not 0 <= layers <= LAYERS:
        raise TrainingError(f"frozen_layers {layers}: the backbone has {LAYERS} layers, give 0 to {LAYERS}")
    backbone = network.get_submodule("backbone")
    for number in range(1, LAYERS + 1):
        name = f"layer{number}"
        layer = backbone.get_submodule(name)
        assert isinstance(layer, nn.Sequential)
        plain = nn.Sequential(*layer).train(network.training).requires_grad_(True)
        setattr(backbone, name, FrozenLayer(plain) if number <= layers else plain)
