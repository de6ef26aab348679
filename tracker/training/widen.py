"""A network of size `s` made one of size `full` that computes the same (Net2Net, Chen et al. 2016): each channel twice.

Every tensor's output axis holds its channels as [c, c]. What reads doubled channels shares its weight among the two
copies. Exact halves keep the copies equal for ever, since equal weights get equal gradients; an uneven share, the same
function still, lets them part.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from tracker.training.errors import TrainingError
from tracker.weights.errors import WeightsError
from tracker.weights.layout import check, strip

MIXES = ("grader.adcat.add.weight", "new.adcat.add.weight")  # transposed: (in, out, 1, 1), and in is [x, z]
QUERY = "new.point.query_conv."  # its product with the keys sums over twice the channels
FIRST = "backbone.layer1.0.weight"  # reads the picture, which has as many channels as before
OUTPUTS = ("grader.anchor.", "new.cls1.", "new.cls2.", "new.cls3.", "new.convloc.12.")  # the maps stay as they are
PROBE = "new.conv4.0.weight"  # has doubled channels on both axes
MAX_UNEVEN = 0.5  # beyond it a share would be negative


def widen(state_s: Mapping[str, Tensor], uneven: float = 0.0, seed: int = 0) -> dict[str, Tensor]:
    """The tensors of a `full` that gives the same maps as those of an `s` (both without BatchNorm counters), in fp32.

    `uneven`: every weight is split into 0.5 + e and 0.5 - e with its own e, uniform in +-`uneven` (0 to 0.5). Raises
    TrainingError for anything but weights of an `s`.
    """
    if not 0.0 <= uneven <= MAX_UNEVEN:
        raise ValueError(f"uneven {uneven}: give 0 to {MAX_UNEVEN}")
    tensors = strip(state_s)
    try:
        check(tensors, "s", "widening")
    except WeightsError as error:
        raise TrainingError(f"only weights of size s can be widened: {error}") from error
    generator = torch.Generator().manual_seed(seed)
    return {key: _widened(key, tensors[key].float().cpu(), uneven, generator) for key in sorted(tensors)}


def is_symmetric(state: Mapping[str, Tensor]) -> bool:
    """Whether the weights of a `full` are an exact widening: two equal halves, which no training can tell apart."""
    weight = state[PROBE]
    first, second = weight.chunk(2, 0)
    return torch.equal(first, second) and torch.equal(*first.chunk(2, 1))


def _widened(key: str, tensor: Tensor, uneven: float, generator: torch.Generator) -> Tensor:
    if key in MIXES:
        halves = [_shared(part, 0, uneven, generator) for part in tensor.chunk(2, 0)]
        return _twice(torch.cat(halves, 0), 1)
    if tensor.numel() == 1 and "gamma" in key:
        return tensor.clone()
    out = tensor if key.startswith(OUTPUTS) else _twice(tensor, 0)
    if tensor.ndim > 1 and key != FIRST:
        out = _shared(out, 1, uneven, generator)
    return out / 2 if key.startswith(QUERY) else out


def _twice(tensor: Tensor, axis: int) -> Tensor:
    return torch.cat((tensor, tensor), axis)


def _shared(tensor: Tensor, axis: int, uneven: float, generator: torch.Generator) -> Tensor:
    """Twice as long along `axis`, the two copies summing to what there was."""
    share = 0.5 + uneven * (2 * torch.rand(tensor.shape, generator=generator) - 1)
    return torch.cat((tensor * share, tensor * (1 - share)), axis)
