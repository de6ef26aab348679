"""Learning from a trained network's maps beside the labels."""

from __future__ import annotations

from typing import cast

import torch
import torch.nn.functional as F
from torch import Tensor

from tracker.siamapnpp.decode import ANCHOR_PX, MAX_LOG_DELTA
from tracker.siamapnpp.fold import fold
from tracker.siamapnpp.network import Maps
from tracker.siamapnpp.settings import TrackerSettings
from tracker.training.errors import TrainingError
from tracker.training.losses import Mean, Reduce, divided
from tracker.training.recipe import Teacher as TeacherSpec
from tracker.training.targets import MIN_ANCHOR_PX
from tracker.weights.errors import WeightsError
from tracker.weights.store import load

SURE = 0.5  # confidence from which a teacher's anchor and box mean something


class Teacher:
    """A frozen network of any size, in eval mode with folded BatchNorm. Raises TrainingError when it cannot be had."""

    def __init__(self, spec: TeacherSpec, device: torch.device | str = "cpu") -> None:
        try:
            network = load(spec.model).network()
        except WeightsError as error:
            raise TrainingError(f"teacher.model: {error}") from error
        self._network = fold(network).to(device=device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._weight = spec.weight

    @torch.no_grad()
    def maps(self, exemplar: Tensor, search: Tensor) -> Maps:
        """The teacher's maps of a batch of crops (BGR 0..255, float)."""
        return cast(Maps, self._network(exemplar, search))

    def term(self, exemplar: Tensor, search: Tensor, maps: Maps, reduce: Reduce | None = None) -> Tensor:
        """The weighted loss of a student's `maps` for the same crops. `reduce` as in `losses`."""
        return self._weight * imitation(maps, self.maps(exemplar, search), reduce)


def imitation(student: Maps, teacher: Maps, reduce: Reduce | None = None) -> Tensor:
    """How far maps are from a teacher's, in fp32; 0 when they are equal.

    Kullback-Leibler divergences of cls1, cls2 (softmax, temperature 1) and cls3 (sigmoid), each the mean over all
    cells, and where the teacher is sure the L1 distance of anchors and of boxes, in units of the anchor map. Boxes are
    compared decoded: deltas of different anchors say different things.
    """
    student, teacher = (Maps(*(m.float() for m in maps)) for maps in (student, teacher))
    sure = (_confidence(teacher) > SURE).float()
    cells = sure.new_tensor(float(sure.numel()))
    channels = student.anchor.shape[1]
    boxes = (_sides(student) - _sides(teacher).detach()).abs().sum(1)
    anchors = (student.anchor - teacher.anchor.detach()).abs().sum(1)
    means = divided(
        {
            "cls1": Mean(_divergence(student.cls1, teacher.cls1), cells),
            "cls2": Mean(_divergence(student.cls2, teacher.cls2), cells),
            "cls3": Mean(_divergence(_two(student.cls3), _two(teacher.cls3)), cells),
            "anchor": Mean((anchors * sure).sum(), channels * sure.sum()),
            "box": Mean((boxes * sure).sum(), channels * sure.sum()),
        },
        reduce,
    )
    return torch.stack(list(means.values())).sum()


def _divergence(student: Tensor, teacher: Tensor) -> Tensor:
    target = F.log_softmax(teacher.detach(), 1)
    return F.kl_div(F.log_softmax(student, 1), target, reduction="sum", log_target=True)


def _two(logit: Tensor) -> Tensor:
    """A sigmoid's logit as the two of a softmax."""
    return torch.cat((torch.zeros_like(logit), logit), 1)


def _confidence(maps: Maps) -> Tensor:
    """The tracker's confidence of every cell with its default weights: (B, M, M)."""
    w1, w2, w3 = TrackerSettings().class_weights
    first, second = (torch.softmax(m, 1)[:, 1] for m in (maps.cls1, maps.cls2))
    return (w1 * first + w2 * second + w3 * torch.sigmoid(maps.cls3[:, 0])) / (w1 + w2 + w3)


def _sides(maps: Maps) -> Tensor:
    """x1, y1, x2, y2 of the boxes from their cells, in units of the anchor map; no gradient into the anchors."""
    left, right, top, bottom = maps.anchor.detach().unbind(1)
    dx, dy, dw, dh = maps.loc.unbind(1)
    floor = MIN_ANCHOR_PX / ANCHOR_PX
    w, h = (left + right).clamp(min=floor), (top + bottom).clamp(min=floor)
    x, y = (right - left) / 2 + dx * w, (bottom - top) / 2 + dy * h
    half_w = w * dw.clamp(-MAX_LOG_DELTA, MAX_LOG_DELTA).exp() / 2
    half_h = h * dh.clamp(-MAX_LOG_DELTA, MAX_LOG_DELTA).exp() / 2
    return torch.stack((x - half_w, y - half_h, x + half_w, y + half_h), 1)
