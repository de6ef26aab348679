"""The reference engine: PyTorch, on the CPU or on CUDA, in fp32 or bf16."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum
from typing import Any

import numpy as np
import torch
from torch import nn

from tracker.engines.cpu import has_native_bf16
from tracker.messages import ImageU8
from tracker.siamapnpp.decode import FloatMap, ResponseMaps
from tracker.siamapnpp.fold import fold
from tracker.siamapnpp.network import SiamAPNpp, Template


class Precision(str, Enum):
    """`auto` is bf16 where the processor multiplies it natively or on CUDA, else fp32."""

    AUTO = "auto"
    FP32 = "fp32"
    BF16 = "bf16"


def choose_device(name: str) -> torch.device:
    """`auto`, `cpu` or `cuda`. Raises ValueError when CUDA is asked for and absent."""
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    if name == "cuda" and not torch.cuda.is_available():
        raise ValueError("device 'cuda' was asked for, but this PyTorch sees no CUDA device; use --device cpu")
    return torch.device(name)


class TorchEngine:
    """Folded network, channels_last, one frame at a time. Implements `tracker.engines.Engine`."""

    def __init__(self, network: SiamAPNpp, precision: Precision = Precision.AUTO, device: str = "auto") -> None:
        self._device = choose_device(device)
        if precision is Precision.AUTO:
            native = self._device.type == "cuda" or has_native_bf16()
            precision = Precision.BF16 if native else Precision.FP32
        self._dtype = torch.bfloat16 if precision is Precision.BF16 else torch.float32
        self._network = fold(network).to(device=self._device, dtype=self._dtype)
        for parameter in self._network.parameters():
            if parameter.ndim == 4:
                parameter.data = parameter.data.contiguous(memory_format=torch.channels_last)
        self._template: Template | None = None
        self._features = torch.empty(0)
        # All variants of the network have this backbone, but each its own search.
        self._network.backbone.register_forward_hook(self._keep_features)
        self.name = f"torch-{torch.__version__.split('+')[0]}/{self._device.type}/{precision.value}"

    def _tensor(self, crop_bgr_u8: ImageU8) -> torch.Tensor:
        # (H, W, 3) seen as (1, 3, H, W) is channels_last already: nothing is copied but the conversion to float.
        image = torch.from_numpy(np.ascontiguousarray(crop_bgr_u8)).permute(2, 0, 1).unsqueeze(0)
        return image.to(device=self._device, dtype=self._dtype)

    @torch.inference_mode()
    def set_exemplar(self, crop_bgr_u8: ImageU8) -> FloatMap:
        """Compute and keep the template kernels of an exemplar crop, (127, 127, 3). Gives its features as `embed`."""
        with _denormals_flushed():
            self._template = self._network.template(self._tensor(crop_bgr_u8))
        return _numpy(self._features)

    @torch.inference_mode()
    def embed(self, crop_bgr_u8: ImageU8) -> FloatMap:
        """Deep features (C, 6, 6), of layer5, of an exemplar crop, (127, 127, 3)."""
        with _denormals_flushed():
            self._network.backbone(self._tensor(crop_bgr_u8))
        return _numpy(self._features)

    @torch.inference_mode()
    def search(self, crop_bgr_u8: ImageU8) -> ResponseMaps:
        """Maps of a search crop, (S, S, 3). Raises RuntimeError before `set_exemplar`."""
        if self._template is None:
            raise RuntimeError("search() before set_exemplar(): the engine has no template")
        with _denormals_flushed():
            maps = self._network.search(self._template, self._tensor(crop_bgr_u8))
        return ResponseMaps(
            cls1=_numpy(maps.cls1),
            cls2=_numpy(maps.cls2),
            cls3=_numpy(maps.cls3),
            loc=_numpy(maps.loc),
            anchor=_numpy(maps.anchor),
            features=_numpy(self._features),
        )

    def _keep_features(self, _module: nn.Module, _inputs: Any, outputs: tuple[torch.Tensor, torch.Tensor]) -> None:
        self._features = outputs[1]


@contextmanager
def _denormals_flushed() -> Iterator[None]:
    """Denormals in the maps of a lost target cost more time than the whole network.

    Only here: the switch is the processor's, and the filter and the control laws count on IEEE arithmetic.
    """
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(False)


def _numpy(map_: torch.Tensor) -> FloatMap:
    return np.asarray(map_[0].float().cpu().numpy(), dtype=np.float32)
