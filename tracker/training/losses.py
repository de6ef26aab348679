"""The losses of SiamAPN++ (paper, section III-C; details as in the official code) on maps and labels, in fp32.

Every mean is a sum over the batch divided by a count of the batch. With several processes the counts are averaged over
them, so that the average of the processes' gradients is the gradient of the whole batch in one process.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from tracker.siamapnpp.decode import MAX_LOG_DELTA
from tracker.siamapnpp.network import Maps
from tracker.training.recipe import Labels, LossWeights
from tracker.training.targets import MAX_DELTA, Targets, iou

ANCHOR_SMOOTH = 0.04  # below it |e| becomes 25 e^2, which meets it there
LOC_SMOOTH = 0.001  # likewise 1000 e^2
IOU_ALPHA = 1.5  # the paper's alpha in (1, 2), as the code has it
MIN_OVERLAP = 1e-4  # the logarithm of no overlap has no gradient to offer
# The mean of the centre loss runs over all cells and few of them are the core, which moves in every crop: three times
# the paper's weight is what the embedded weights were trained with.
RELATIVE_CLS3_GAIN = 3.0
NO_COUNT = 1e-6  # a count is 0 (then the sum is too) or at least 1 / processes

Reduce = Callable[[Tensor], Tensor]


class Mean(NamedTuple):
    """A mean before it is divided: both 0-dimensional."""

    total: Tensor
    size: Tensor


def divided(terms: Mapping[str, Mean], reduce: Reduce | None) -> dict[str, Tensor]:
    """The means. `reduce` turns a vector of local counts into their mean over the processes (one call for all)."""
    counts = torch.stack([term.size.detach().float() for term in terms.values()])
    if reduce is not None:
        counts = reduce(counts)
    values = torch.stack([term.total for term in terms.values()]) / counts.clamp(min=NO_COUNT)
    return dict(zip(terms, values.unbind(0), strict=True))


def losses(
    maps: Maps, targets: Targets, weights: LossWeights, reduce: Reduce | None = None
) -> tuple[Tensor, dict[str, Tensor]]:
    """The total with its gradient, and detached parts: cls1, cls2, cls3, anchor, l1, iou, each without its weight, and
    `overlap`, the mean IoU of the positive cells' boxes with the target.

    `maps` of any precision. `reduce`: the mean of a vector of counts over all processes; total and parts are then so
    that their mean over the processes is the value for the whole batch.
    """
    maps = Maps(*(m.float() for m in maps))
    terms = {
        **_class_terms("cls1", maps.cls1, targets.cls1),
        **_class_terms("cls2", maps.cls2, targets.cls2),
        "cls3": _centre_term(maps.cls3[:, 0], targets),
        "anchor": _anchor_term(maps.anchor, targets),
        **_box_terms(maps.loc, targets),
    }
    means = divided(terms, reduce)
    parts = {name: 0.5 * (means[f"{name} positive"] + means[f"{name} negative"]) for name in ("cls1", "cls2")}
    parts |= {name: means[name] for name in ("cls3", "anchor", "l1", "iou", "overlap")}
    gain = RELATIVE_CLS3_GAIN if targets.rule is Labels.RELATIVE else 1.0
    cls = weights.cls1 * parts["cls1"] + weights.cls2 * parts["cls2"] + gain * weights.cls3 * parts["cls3"]
    loc = weights.l1 * parts["l1"] + weights.iou * parts["iou"]
    total = weights.cls * cls + weights.loc * loc + weights.anchor * parts["anchor"]
    return total, {name: part.detach() for name, part in parts.items()}


def _class_terms(name: str, logits: Tensor, label: Tensor) -> dict[str, Mean]:
    """Cross-entropy of a two-channel map, positives and negatives apart: each is half of the loss."""
    entropy = -F.log_softmax(logits, 1)
    positive, negative = label == 1, label == 0
    return {
        f"{name} positive": Mean((entropy[:, 1] * positive).sum(), positive.sum()),
        f"{name} negative": Mean((entropy[:, 0] * negative).sum(), negative.sum()),
    }


def _centre_term(logit: Tensor, targets: Targets) -> Mean:
    entropy = F.binary_cross_entropy_with_logits(logit, targets.cls3, reduction="none")
    return Mean((entropy * targets.cls3_weight).sum(), targets.cls3_weight.sum())


def _smoothed(error: Tensor, below: float) -> Tensor:
    """|e|, and e^2 / below where |e| is smaller than that."""
    size = error.abs()
    return torch.where(size < below, size * size / below, size)


def _anchor_term(anchor: Tensor, targets: Targets) -> Mean:
    """Paper: the sum over the four distances. Relative rule: their mean, as the embedded weights were trained."""
    distances = 1 if targets.rule is Labels.PAPER else anchor.shape[1]
    error = _smoothed(anchor - targets.anchor, ANCHOR_SMOOTH)
    weight = targets.anchor_weight
    return Mean((error * weight[:, None]).sum(), distances * weight.sum())


def _box_terms(loc: Tensor, targets: Targets) -> dict[str, Mean]:
    """L1 of the deltas and the IoU loss -(1 - u)(alpha - u) ln u of the decoded boxes.

    Paper: a sample's weights sum to 1; the L1 loss is divided by the batch, the IoU loss by the samples with positives.
    """
    paper, weight = targets.rule is Labels.PAPER, targets.loc_weight
    error = loc - targets.loc
    l1 = _smoothed(error, LOC_SMOOTH) if paper else error.abs()
    overlap = _box_overlap(loc, targets, MAX_LOG_DELTA if paper else MAX_DELTA)
    bounded = overlap.clamp(min=MIN_OVERLAP)
    penalty = -(1 - bounded) * (IOU_ALPHA - bounded) * bounded.log()
    count = weight.sum()
    samples = count.new_tensor(float(len(loc))) if paper else count
    return {
        "l1": Mean((l1.sum(1) * weight).sum(), samples),
        "iou": Mean((penalty * weight).sum(), count),
        "overlap": Mean((overlap.detach() * weight).sum(), count),
    }


def _box_overlap(loc: Tensor, targets: Targets, max_delta: float) -> Tensor:
    cx, cy, w, h = targets.anchors.unbind(1)
    dx, dy, dw, dh = loc.unbind(1)
    x, y = cx + dx * w, cy + dy * h
    half_w, half_h = w * dw.clamp(-max_delta, max_delta).exp() / 2, h * dh.clamp(-max_delta, max_delta).exp() / 2
    x1, y1, x2, y2 = targets.box[:, :, None, None].unbind(1)
    return iou((x - half_w, y - half_h, x + half_w, y + half_h), (x1, y1, x2, y2))
