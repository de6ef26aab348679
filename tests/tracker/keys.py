"""The official checkpoint's 134 tensors, written down from the fact sheet and not taken from our own network."""

from __future__ import annotations

import torch


def _bn(prefix: str, n: int) -> dict[str, tuple[int, ...]]:
    return {f"{prefix}.{p}": (n,) for p in ("weight", "bias", "running_mean", "running_var")}


def _conv(prefix: str, out: int, inp: int, k: int, bias: bool = True) -> dict[str, tuple[int, ...]]:
    return {f"{prefix}.weight": (out, inp, k, k), **({f"{prefix}.bias": (out,)} if bias else {})}


def official_shapes() -> dict[str, tuple[int, ...]]:
    """Name to shape, section 1.8 of the sheet."""
    shapes: dict[str, tuple[int, ...]] = {}
    stages = [(96, 3, 11), (256, 96, 5), (384, 256, 3), (384, 384, 3), (256, 384, 3)]
    for i, (out, inp, k) in enumerate(stages, 1):
        shapes |= _conv(f"backbone.layer{i}.0", out, inp, k) | _bn(f"backbone.layer{i}.1", out)
    for name, inp in (("conv_shape", 256), ("conv3", 384), ("conv5", 256), ("conv6", 256)):
        shapes |= _conv(f"grader.{name}.0", 256, inp, 3) | _bn(f"grader.{name}.1", 256)
    shapes |= _conv("grader.anchor", 4, 256, 3)
    for name in ("conv1", "conv2", "conv4"):
        shapes |= _conv(f"new.{name}.0", 256, 256, 3) | _bn(f"new.{name}.1", 256)
    for i in (0, 3, 6, 9):
        shapes |= _conv(f"new.convloc.{i}", 256, 256, 3)
        shapes |= {f"new.convloc.{i + 1}.weight": (256,), f"new.convloc.{i + 1}.bias": (256,)}
    shapes |= _conv("new.convloc.12", 4, 256, 3)
    for i in (0, 3):
        shapes |= _conv(f"new.convcls.{i}", 256, 256, 3)
        shapes |= {f"new.convcls.{i + 1}.weight": (256,), f"new.convcls.{i + 1}.bias": (256,)}
    shapes |= {"new.channel.gamma2": (1,), "new.point.gamma": (1,)}
    shapes |= _conv("new.channel.conv1.0", 256, 256, 7) | _bn("new.channel.conv1.1", 256)
    for name in ("grader.adcat", "new.adcat", "new.channel"):
        shapes |= _conv(f"{name}.fc1", 42, 256, 1, bias=False) | _conv(f"{name}.fc2", 256, 42, 1, bias=False)
    for name in ("grader.adcat", "new.adcat"):
        shapes |= {f"{name}.gamma1": (1,), f"{name}.gamma3": (1,)}
        shapes |= {f"{name}.add.weight": (512, 256, 1, 1), f"{name}.add.bias": (256,)}
    shapes |= _conv("new.point.query_conv", 32, 256, 1) | _conv("new.point.key_conv", 32, 256, 1)
    shapes |= _conv("new.point.value_conv", 256, 256, 1)
    for name, out in (("cls1", 2), ("cls2", 2), ("cls3", 1)):
        shapes |= _conv(f"new.{name}", out, 256, 3)
    return shapes


def synthetic_state(seed: int = 0) -> dict[str, torch.Tensor]:
    """Random tensors with exactly the official keys and shapes."""
    generator = torch.Generator().manual_seed(seed)
    return {
        key: torch.rand(shape, generator=generator) * 0.1 + (0.5 if key.endswith("running_var") else 0.0)
        for key, shape in official_shapes().items()
    }
