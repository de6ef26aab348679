"""The network that a recipe starts from: random, or from weights there are."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import torch
from safetensors.torch import load_file
from torch import Tensor, nn

from tracker.siamapnpp.network import SIZES
from tracker.siamapnpp.variants import make_network
from tracker.training.errors import TrainingError
from tracker.training.recipe import Recipe, Variant
from tracker.training.widen import is_symmetric, widen
from tracker.weights.errors import WeightsError
from tracker.weights.layout import COUNTER
from tracker.weights.store import EMBEDDED_FILES, SUFFIX, Weights, load

UNEVEN = 0.1  # of a widened network's shares: enough for the copies to part, no weight changes sign
BACKBONE_KEY = re.compile(r"^(?:module\.)?(?:backbone\.|features\.)?(layer[1-5]\.[01]\.[a-z_]+)$")
LISTED = 4  # tensors named in full in an error


def start_network(recipe: Recipe) -> nn.Module:
    """The network of a recipe's size and variant with its starting weights, in train mode, on the CPU.

    The random part depends on `recipe.seed` alone and leaves the global generator as it was. Raises TrainingError when
    weights cannot be had or do not fit, naming the entry of the recipe.
    """
    with torch.random.fork_rng(devices=[]):
        torch.default_generator.manual_seed(recipe.seed)  # not the GPUs': nothing is drawn there
        network = make_network(SIZES[recipe.size], recipe.variant.value)
    start = recipe.start
    if start.model:
        whole = _weights(recipe, "model", start.model, recipe.size).tensors
        if recipe.size == "full" and is_symmetric(whole):
            raise TrainingError(
                f"start.model: {start.model} is an exact widening of an `s`: its equal halves would learn the same for "
                "ever; give start.widen with the `s` instead, which parts them"
            )
        _load_whole(network, whole)
    if start.widen:
        narrow = _weights(recipe, "widen", start.widen, "s").tensors
        _load_whole(network, widen(narrow, UNEVEN, recipe.seed))
    if start.backbone:
        _load_backbone(network, read_backbone(start.backbone), start.backbone)
    return network.train()


def read_backbone(source: str) -> dict[str, Tensor]:
    """Tensors `layerN.M.name` (fp32) of the backbone in an embedded size, a .safetensors or a .pth file.

    A file may hold more than the backbone and prefix the names by `backbone.` or `features.`; a .pth is read without
    running any code in it. Raises TrainingError when there is no such file or no such tensor in it.
    """
    path = EMBEDDED_FILES.get(source, Path(source))
    if not path.is_file():
        raise TrainingError(f"start.backbone: {source}: no such file (give `s`, `full`, a {SUFFIX} or a .pth file)")
    found = {}
    for key, value in _read(path).items():
        match = BACKBONE_KEY.match(key)
        if match and not key.endswith(COUNTER):
            found[match.group(1)] = value.float()
    if not found:
        raise TrainingError(f"start.backbone: {path}: holds no tensor named layerN.M.*; it is no AlexNet of this kind")
    return found


def _read(path: Path) -> Mapping[str, Tensor]:
    try:
        loaded = load_file(path) if path.suffix == SUFFIX else torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # the unpickler raises whatever a damaged or hostile file provokes
        kind = "a safetensors file" if path.suffix == SUFFIX else "a PyTorch file of plain tensors"
        raise TrainingError(f"start.backbone: {path}: not {kind} ({type(error).__name__}); nothing was run") from error
    state = loaded.get("state_dict", loaded) if isinstance(loaded, dict) else None
    if not isinstance(state, dict):
        raise TrainingError(f"start.backbone: {path}: holds no state_dict of tensors")
    return {str(k): v for k, v in state.items() if isinstance(v, Tensor)}


def _weights(recipe: Recipe, entry: str, model: str, size: str) -> Weights:
    if recipe.variant is not Variant.AAN:
        raise TrainingError(
            f"start.{entry}: weights files hold the variant aan, this recipe's is {recipe.variant.value}; "
            "give start.backbone, which all variants share"
        )
    try:
        weights = load(model)
    except WeightsError as error:
        raise TrainingError(f"start.{entry}: {error}") from error
    if weights.size != size:
        if (entry, weights.size) == ("widen", "full"):
            raise TrainingError(f"start.widen: {model} is already of size full; give start.model instead")
        hint = "; give start.widen instead" if (entry, weights.size) == ("model", "s") else ""
        raise TrainingError(f"start.{entry}: {model} is of size {weights.size}, not {size}{hint}")
    return weights


def _load_whole(network: nn.Module, tensors: Mapping[str, Tensor]) -> None:
    counters = {k: v for k, v in network.state_dict().items() if k.endswith(COUNTER)}
    network.load_state_dict({**tensors, **counters})


def _load_backbone(network: nn.Module, tensors: Mapping[str, Tensor], source: str) -> None:
    backbone = network.get_submodule("backbone")
    wanted = {k: v.shape for k, v in backbone.state_dict().items() if not k.endswith(COUNTER)}
    faults = [f"{k} is missing" for k in wanted if k not in tensors]
    faults += [
        f"{k} is {_shown(tensors[k])}, not {'x'.join(map(str, shape))}"
        for k, shape in wanted.items()
        if k in tensors and tensors[k].shape != shape
    ]
    faults += [f"{k} is not finite" for k in wanted if k in tensors and not bool(torch.isfinite(tensors[k]).all())]
    if faults:
        more = f" and {len(faults) - LISTED} more" if len(faults) > LISTED else ""
        raise TrainingError(f"start.backbone: {source}: {'; '.join(faults[:LISTED])}{more}")
    backbone.load_state_dict({k: tensors[k] for k in wanted}, strict=False)


def _shown(tensor: Tensor) -> str:
    return "x".join(map(str, tensor.shape)) or "a scalar"
