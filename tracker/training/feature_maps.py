"""What the attention looks at: the paper's visualisation, step by step, over the search crop."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import cv2
import numpy as np
import torch
from torch import Tensor, nn

from tracker.messages import Array, ImageU8
from tracker.siamapnpp.crop import EXEMPLAR_PX
from tracker.siamapnpp.decode import STRIDE_PX, ResponseMaps, decode
from tracker.siamapnpp.settings import TrackerSettings
from tracker.training.validate import SETTINGS

COLUMNS = 4
CAPTION_PX = 22
GAP_PX = 4
HEAT_SHARE = 0.6  # the crop stays visible below
OUTSIDE_SHARE = 0.45  # brightness of what no cell of the maps stands for
# Caption, module, whether its first input is meant. A network that lacks a module has no such panel.
STAGES = (
    ("response", "new.point", True),
    ("after spatial attention", "new.point", False),
    ("after channel attention", "new.conv4", False),
    ("APN-DF: R_A", "grader", False),
    ("after cross-AAN", "new.adcat", False),
    # The variants before cross-AAN (`tracker/siamapnpp/variants.py`).
    ("response", "new.attention", True),
    ("after spatial attention", "new.attention.0", False),
    ("after channel attention", "new.attention.4", False),
    ("after concatenation", "new.add", False),
)


def draw_maps(network: nn.Module, exemplar: ImageU8, search: ImageU8, settings: TrackerSettings = SETTINGS) -> ImageU8:
    """A sheet: the search crop with the exemplar and the best box, energies as heat over the crop, the confidence.

    `exemplar` is (127, 127, 3), `search` (S, S, 3), both BGR uint8. An energy is the mean over the channels of the
    absolute value, each map scaled to its own range; heat lies where the cells are, every 8 px about the middle.
    The network is watched by hooks and left as it was. Raises ValueError for crops of another shape.
    """
    side = search.shape[0]
    if exemplar.shape != (EXEMPLAR_PX, EXEMPLAR_PX, 3) or search.shape != (side, side, 3) or side <= EXEMPLAR_PX:
        raise ValueError(
            f"crops must be {(EXEMPLAR_PX, EXEMPLAR_PX, 3)} and (S, S, 3), not {exemplar.shape} and {search.shape}"
        )
    seen, maps = _run(network, exemplar, search)
    decoded = decode(maps, settings)
    cells = maps.cls1.shape[-1]
    panels = [("search crop, exemplar", _marked(exemplar, search, decoded_box(maps, settings)))]
    panels += [(caption, _heated(search, energy)) for caption, energy in seen.items()]
    panels.append(("confidence", _heated(search, decoded.confidence.reshape(cells, cells))))
    return _sheet([_captioned(image, caption) for caption, image in panels])


def energies(network: nn.Module, exemplar: ImageU8, search: ImageU8) -> dict[str, Array]:
    """The energy (M, M) of each stage by its caption, as `draw_maps` shows them but not scaled."""
    return _run(network, exemplar, search)[0]


def decoded_box(maps: ResponseMaps, settings: TrackerSettings) -> tuple[float, float, float, float]:
    """Corners of the most confident cell's box, in search pixels from the crop's centre."""
    decoded = decode(maps, settings)
    best = int(decoded.confidence.argmax())
    cx, cy, w, h = (float(part[best]) for part in (decoded.cx, decoded.cy, decoded.w, decoded.h))
    return cx - w / 2, cy - h / 2, cx + w / 2, cy + h / 2


def _run(network: nn.Module, exemplar: ImageU8, search: ImageU8) -> tuple[dict[str, Array], ResponseMaps]:
    some = next(network.parameters())
    crops = [torch.from_numpy(c.copy()).permute(2, 0, 1)[None].to(some.device, some.dtype) for c in (exemplar, search)]
    was_training = network.training
    network.eval()
    try:
        with _watched(network) as seen, torch.inference_mode():
            maps = network(*crops)
    finally:
        network.train(was_training)
    return seen, ResponseMaps(**{name: value[0].float().cpu().numpy() for name, value in maps._asdict().items()})


@contextmanager
def _watched(network: nn.Module) -> Iterator[dict[str, Array]]:
    """Energies by caption, in the order of `STAGES`, filled while the network runs."""
    modules = dict(network.named_modules())
    present = [stage for stage in STAGES if stage[1] in modules]
    found: dict[str, Array] = {caption: np.zeros((1, 1)) for caption, _, _ in present}

    def watch(caption: str, takes_input: bool) -> Callable[..., None]:
        def hook(module: nn.Module, inputs: tuple[Tensor, ...], output: Tensor | tuple[Tensor, ...]) -> None:
            told = inputs[0] if takes_input else output
            feature = told if isinstance(told, Tensor) else told[-1]  # the proposal's feature comes behind its anchors
            found[caption] = feature[0].detach().float().abs().mean(dim=0).double().cpu().numpy()

        return hook

    handles = [modules[name].register_forward_hook(watch(caption, first)) for caption, name, first in present]
    try:
        yield found
    finally:
        for handle in handles:
            handle.remove()


def _heated(search: ImageU8, energy: Array) -> ImageU8:
    """The crop with the map where its cells lie; darker around."""
    side = search.shape[0]
    span = energy.shape[0] * STRIDE_PX
    low = (side - span) // 2
    spread = float(energy.max() - energy.min())
    scaled = (energy - energy.min()) / spread if spread > 0 else np.zeros_like(energy)
    grey = cv2.resize((255 * scaled).astype(np.uint8), (span, span), interpolation=cv2.INTER_LINEAR)
    heat = cv2.applyColorMap(grey, cv2.COLORMAP_JET)
    out = (search * OUTSIDE_SHARE).astype(np.uint8)
    inner = np.s_[low : low + span, low : low + span]
    out[inner] = cv2.addWeighted(heat, HEAT_SHARE, search[inner], 1 - HEAT_SHARE, 0)
    return out


def _marked(exemplar: ImageU8, search: ImageU8, corners: tuple[float, float, float, float]) -> ImageU8:
    out = search.copy()
    x1, y1, x2, y2 = (round(v + search.shape[0] / 2) for v in corners)
    cv2.rectangle(out, (x1, y1), (x2, y2), (0, 255, 255), 1)
    small = cv2.resize(exemplar, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    out[: small.shape[0], : small.shape[1]] = small
    return np.asarray(out, dtype=np.uint8)


def _captioned(image: ImageU8, caption: str) -> ImageU8:
    strip = np.full((CAPTION_PX, image.shape[1], 3), 255, np.uint8)
    cv2.putText(strip, caption, (3, CAPTION_PX - 7), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 0), 1, cv2.LINE_AA)
    return np.concatenate([strip, image])


def _sheet(panels: list[ImageU8]) -> ImageU8:
    height, width = panels[0].shape[:2]
    rows = -(-len(panels) // COLUMNS)
    sheet = np.full((rows * (height + GAP_PX) - GAP_PX, COLUMNS * (width + GAP_PX) - GAP_PX, 3), 255, np.uint8)
    for i, panel in enumerate(panels):
        y, x = i // COLUMNS * (height + GAP_PX), i % COLUMNS * (width + GAP_PX)
        sheet[y : y + height, x : x + width] = panel
    return sheet
