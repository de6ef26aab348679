"""Optimisers by recipe: who decays, and how much slower the backbone learns."""

from __future__ import annotations

from typing import Any

import torch
from torch import nn

from tracker.training.errors import TrainingError
from tracker.training.recipe import Optimiser

BETAS = (0.9, 0.98)  # the batches are small and differ much: a second moment over 50 steps follows them, 1000 lag
BACKBONE = "backbone."


def make_optimiser(network: nn.Module, optimiser: Optimiser, lr: float) -> torch.optim.Optimizer:
    """AdamW or SGD over the parameters that require a gradient, so it is made anew whenever another part is frozen.

    Groups by backbone or heads and by decay: matrices decay, vectors (biases, norms, gammas) only with `decay_all`.
    Each group has its `factor` on the rate. Raises TrainingError when nothing is left to train.
    """
    groups: dict[str, dict[str, Any]] = {}
    for name, parameter in network.named_parameters():
        if not parameter.requires_grad:
            continue
        in_backbone, decays = name.startswith(BACKBONE), optimiser.decay_all or parameter.ndim > 1
        key = f"{'backbone' if in_backbone else 'heads'}, {'decay' if decays else 'no decay'}"
        factor = optimiser.backbone_factor if in_backbone else 1.0
        decay = optimiser.weight_decay if decays else 0.0
        group = {"params": [], "name": key, "factor": factor, "weight_decay": decay, "lr": lr * factor}
        groups.setdefault(key, group)["params"].append(parameter)
    if not groups:
        raise TrainingError("no parameter of the network requires a gradient; freeze fewer layers")
    if optimiser.kind == "sgd":
        return torch.optim.SGD(list(groups.values()), lr=lr, momentum=optimiser.momentum)
    return torch.optim.AdamW(list(groups.values()), lr=lr, betas=BETAS)


def set_rate(optimiser: torch.optim.Optimizer, rate: float) -> None:
    """Learning rate of the next steps; every group's factor applies."""
    for group in optimiser.param_groups:
        group["lr"] = rate * group["factor"]
