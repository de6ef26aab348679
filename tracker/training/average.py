"""The average of the weights over the last steps: less noisy than any single step, and what is kept in the end."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from tracker.training.errors import TrainingError

WARM_STEPS = 25.0  # decay after n steps is at most n / (n + this): early weights must not linger
UPDATES = "average.num_batches_tracked"  # named as BatchNorm's counters: whoever writes weights leaves those out


class Average:
    """Exponential moving average of all floating state, BatchNorm statistics too; counters are copied.

    fp32 on the network's device. `decay` per step; None follows the weights themselves.
    """

    def __init__(self, network: nn.Module, decay: float | None) -> None:
        self.updates = 0
        self._decay = decay or 0.0
        self._tensors = {k: _averaged(v).clone() for k, v in network.state_dict().items()}

    @torch.no_grad()
    def update(self, network: nn.Module) -> None:
        """Take in the network's state after a step."""
        self.updates += 1
        decay = min(self._decay, self.updates / (self.updates + WARM_STEPS))
        state = network.state_dict()
        floating = [k for k, v in self._tensors.items() if v.is_floating_point()]
        current = [state[k].to(self._tensors[k].dtype) for k in floating]
        torch._foreach_lerp_([self._tensors[k] for k in floating], current, 1.0 - decay)
        for key, value in self._tensors.items():
            if not value.is_floating_point():
                value.copy_(state[key])

    def tensors(self) -> dict[str, Tensor]:
        """The averaged state under the names of the network's own: for `load_state_dict` and for saving."""
        return dict(self._tensors)

    def state_dict(self) -> dict[str, Tensor]:
        """`tensors` and the number of updates under `UPDATES`: what a resumed run needs."""
        return {**self._tensors, UPDATES: torch.tensor(self.updates)}

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        """Take over a `state_dict`. Raises TrainingError when it is that of another network."""
        differing = sorted(set(state) ^ {*self._tensors, UPDATES})
        differing += [k for k, v in self._tensors.items() if k in state and state[k].shape != v.shape]
        if differing:
            raise TrainingError(
                f"the averaged weights are those of another network: {len(differing)} tensors differ, {differing[0]} "
                "among them; resume with the size and variant that the run began with"
            )
        for key, value in self._tensors.items():
            value.copy_(state[key])
        self.updates = int(state[UPDATES])


def _averaged(value: Tensor) -> Tensor:
    value = value.detach()
    return value.float() if value.is_floating_point() else value
