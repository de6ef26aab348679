"""Which tensors a SiamAPN++ of a given size has, and holding a file's tensors against that."""

from __future__ import annotations

from collections.abc import Mapping

import torch

from tracker.siamapnpp.network import SIZES, NetworkSize, SiamAPNpp
from tracker.weights.errors import WeightsError

PREFIX = "module."  # DataParallel's
DEAD = "new.channel.conv1."  # the official model's 7x7 convolution and its BatchNorm: owned, never run
COUNTER = ".num_batches_tracked"
HEAD_WIDTH_KEY = "new.conv4.0.weight"  # (head, head, 3, 3): tells the size of a network
LISTED = 8  # keys named in full in an error; the rest is counted

Tensors = Mapping[str, torch.Tensor]


def expected_shapes(size: NetworkSize) -> dict[str, tuple[int, ...]]:
    """Live tensors of a size by official name, without the BatchNorm counters: 128 of them."""
    with torch.device("meta"):
        network = SiamAPNpp(size)
    return {k: tuple(v.shape) for k, v in network.state_dict().items() if not k.endswith(COUNTER)}


def strip(tensors: Tensors) -> dict[str, torch.Tensor]:
    """Without the `module.` prefix, the counters and the dead convolution."""
    plain = {key.removeprefix(PREFIX): value for key, value in tensors.items()}
    return {k: v for k, v in plain.items() if not k.endswith(COUNTER) and not k.startswith(DEAD)}


def size_of(tensors: Tensors, where: str) -> str:
    """Name of the size whose head width the tensors have. Raises WeightsError when there is none."""
    probe = tensors.get(HEAD_WIDTH_KEY)
    for name, size in SIZES.items():
        if probe is not None and tuple(probe.shape[:1]) == (size.head,):
            return name
    found = "no such tensor" if probe is None else f"shape {'x'.join(map(str, probe.shape))}"
    raise WeightsError(
        f"{where}: not SiamAPN++ weights of a known size ({', '.join(SIZES)}): {HEAD_WIDTH_KEY} has {found}"
    )


def check(tensors: Tensors, size_name: str, where: str) -> None:
    """Raise one WeightsError that lists every missing, unexpected, mis-shaped or non-finite tensor."""
    want = expected_shapes(SIZES[size_name])
    problems = [
        ("missing", sorted(set(want) - set(tensors))),
        ("unexpected", sorted(set(tensors) - set(want))),
        ("mis-shaped", [_shape_note(k, tensors[k], want[k]) for k in want if _differs(tensors, k, want[k])]),
        ("not floating point", sorted(k for k in tensors if k in want and not tensors[k].is_floating_point())),
        ("not finite", sorted(k for k in tensors if k in want and not _finite(tensors[k]))),
    ]
    notes = [f"{len(keys)} {what}: {_listing(keys)}" for what, keys in problems if keys]
    if notes:
        raise WeightsError(f"{where}: not weights of SiamAPN++ `{size_name}`: {'; '.join(notes)}")


def _differs(tensors: Tensors, key: str, shape: tuple[int, ...]) -> bool:
    return key in tensors and tuple(tensors[key].shape) != shape


def _shape_note(key: str, tensor: torch.Tensor, shape: tuple[int, ...]) -> str:
    return f"{key} is {'x'.join(map(str, tensor.shape)) or 'scalar'}, not {'x'.join(map(str, shape))}"


def _finite(tensor: torch.Tensor) -> bool:
    return not tensor.is_floating_point() or bool(torch.isfinite(tensor).all())


def _listing(keys: list[str]) -> str:
    more = f" and {len(keys) - LISTED} more" if len(keys) > LISTED else ""
    return ", ".join(keys[:LISTED]) + more
