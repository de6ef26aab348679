"""The losses: values by hand, gradients of two processes, precision."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from tests.tracker.training.slow_labels import random_case
from tracker.siamapnpp.network import Maps
from tracker.training.losses import Mean, divided, losses
from tracker.training.recipe import Labels, LossWeights
from tracker.training.targets import labels

PARTS = {"cls1", "cls2", "cls3", "anchor", "l1", "iou", "overlap"}


def _rows(maps: Maps, rows: slice) -> Maps:
    return Maps(*(m[rows] for m in maps))


def _single(rule: Labels, **maps: Tensor) -> tuple[Maps, dict[str, Tensor]]:
    """One target of 64 px in the middle with perfect anchors, and its loss parts with the given maps instead."""
    base, _, _, draws = random_case(223, 1, 1, noise=0.0)
    box = torch.tensor([[-32.0, -32, 32, 32]])
    axis = (torch.arange(13).float() - 6) * 8
    gy, gx = torch.meshgrid(axis, axis, indexing="ij")
    anchor = torch.stack((gx + 32, 32 - gx, gy + 32, 32 - gy))[None] / 71
    case = base._replace(anchor=anchor, loc=torch.zeros(1, 4, 13, 13))._replace(**maps)
    targets = labels(case._replace(anchor=anchor), box, torch.tensor([False]), 223, rule, draws)
    _, parts = losses(case, targets, LossWeights())
    return case, parts


@pytest.mark.parametrize("rule", Labels)
def test_perfect_maps_cost_nothing(rule: Labels) -> None:
    _, parts = _single(rule)
    assert set(parts) == PARTS
    assert parts["anchor"] < 1e-6
    assert parts["l1"] < 1e-6
    assert parts["iou"] < 1e-5
    assert parts["overlap"].item() == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("rule", Labels)
@pytest.mark.parametrize(("error", "cost"), [(0.02, 25 * 0.02**2), (-0.02, 25 * 0.02**2), (0.04, 0.04), (0.5, 0.5)])
def test_anchor_loss_is_smooth_near_zero(rule: Labels, error: float, cost: float) -> None:
    perfect, _ = _single(rule)
    _, parts = _single(rule, anchor=perfect.anchor + error)
    assert parts["anchor"].item() == pytest.approx(cost * (4 if rule is Labels.PAPER else 1), rel=1e-3)


@pytest.mark.parametrize(
    ("rule", "error", "cost"),
    [
        (Labels.PAPER, 0.0005, 1000 * 0.0005**2),
        (Labels.PAPER, 0.01, 0.01),
        (Labels.RELATIVE, 0.0005, 0.0005),
        (Labels.RELATIVE, -0.01, 0.01),
    ],
)
def test_delta_loss(rule: Labels, error: float, cost: float) -> None:
    """Summed over the four coordinates; the weights of a sample's cells sum to 1."""
    _, parts = _single(rule, loc=torch.full((1, 4, 13, 13), error))
    assert parts["l1"].item() == pytest.approx(4 * cost, rel=1e-2)


@pytest.mark.parametrize(("rule", "share"), [(Labels.PAPER, 0.5), (Labels.RELATIVE, 1.0)])
def test_delta_loss_of_a_batch_with_a_negative(rule: Labels, share: float) -> None:
    """The paper divides by the batch, so a negative halves it; the relative rule by the positive cells."""
    case, alone = _single(rule, loc=torch.full((1, 4, 13, 13), 0.1))
    box = torch.tensor([[-32.0, -32, 32, 32]] * 2)
    both = Maps(*(torch.cat((m, m)) for m in case))
    draws = torch.rand(2, 169, 4, generator=torch.Generator().manual_seed(1))
    targets = labels(both, box, torch.tensor([False, True]), 223, rule, draws)
    _, parts = losses(both, targets, LossWeights())
    assert parts["l1"].item() == pytest.approx(share * alone["l1"].item(), rel=1e-2)
    assert parts["iou"].item() == pytest.approx(alone["iou"].item(), rel=1e-2)


@pytest.mark.parametrize("rule", Labels)
def test_iou_loss_is_the_redesigned_one(rule: Labels) -> None:
    shift = torch.zeros(1, 4, 13, 13)
    shift[:, 0] = 0.5  # half a width aside: an overlap of a third
    _, parts = _single(rule, loc=shift)
    assert parts["overlap"].item() == pytest.approx(1 / 3, abs=1e-4)
    assert parts["iou"].item() == pytest.approx(-(2 / 3) * (1.5 - 1 / 3) * math.log(1 / 3), rel=1e-3)


@pytest.mark.parametrize("rule", Labels)
def test_classes_are_balanced(rule: Labels) -> None:
    """Sure and right in the few positives, sure and wrong in the many negatives: that costs half of the worst."""
    maps, box, negative, draws = random_case(223, 8, 7)
    sure = torch.zeros(8, 2, 13, 13)
    sure[:, 1] = 8.0
    targets = labels(maps, box, negative, 223, rule, draws)
    assert (targets.cls1 == 1).any()
    _, parts = losses(maps._replace(cls1=sure, cls2=sure), targets, LossWeights())
    assert parts["cls1"].item() == pytest.approx(4.0, abs=0.01)
    assert parts["cls2"].item() == pytest.approx(4.0, abs=0.01)


@pytest.mark.parametrize(("rule", "gain"), [(Labels.PAPER, 1.0), (Labels.RELATIVE, 3.0)])
def test_total_is_the_weighted_sum(rule: Labels, gain: float) -> None:
    maps, box, negative, draws = random_case(223, 8, 2)
    targets = labels(maps, box, negative, 223, rule, draws)
    weights = LossWeights(cls1=2, cls2=3, cls3=5, cls=7, l1=11, iou=13, loc=17, anchor=19)
    total, p = losses(maps, targets, weights)
    cls = 7 * (2 * p["cls1"] + 3 * p["cls2"] + gain * 5 * p["cls3"])
    assert total.item() == pytest.approx(
        (cls + 17 * (11 * p["l1"] + 13 * p["iou"]) + 19 * p["anchor"]).item(), rel=1e-5
    )
    assert not any(part.requires_grad for part in p.values())


@pytest.mark.parametrize("rule", Labels)
def test_no_gradient_from_boxes_into_anchors(rule: Labels) -> None:
    maps, box, negative, draws = random_case(223, 8, 3)
    maps = maps._replace(anchor=maps.anchor.requires_grad_(), loc=maps.loc.requires_grad_())
    targets = labels(maps, box, negative, 223, rule, draws)
    total, _ = losses(maps, targets, LossWeights(cls=0, anchor=0))
    total.backward()
    assert maps.anchor.grad is None or not maps.anchor.grad.any()
    assert maps.loc.grad is not None
    assert maps.loc.grad.any()


class _Processes:
    """Stands for two processes that exchange their counts: the first pass notes them, the second gets the mean."""

    def __init__(self) -> None:
        self.noted: list[Tensor] = []

    def note(self, counts: Tensor) -> Tensor:
        self.noted.append(counts)
        return counts

    def mean(self, counts: Tensor) -> Tensor:
        assert any(torch.equal(counts, n) for n in self.noted)
        return torch.stack(self.noted).mean(0)


@pytest.mark.parametrize("rule", Labels)
@pytest.mark.parametrize("batch", [8, 4])  # with 4 rows no second half has a positive to spare
def test_two_processes_have_the_gradient_of_one(rule: Labels, batch: int) -> None:
    maps, box, negative, draws = random_case(223, batch, 4)
    negative[batch // 2 :] = True
    negative[batch // 2] = batch == 4  # one positive, or none at all, in the second half
    mix = torch.nn.Conv2d(13, 13, 3, padding=1).double()  # something shared that all maps depend on

    def run(rows: slice, reduce: Callable[[Tensor], Tensor] | None) -> tuple[Tensor, Tensor]:
        out = mix(torch.cat(tuple(maps), 1)[rows].double())
        grown = Maps(*(m + 0.1 * o for m, o in zip(_rows(maps, rows), out.split((4, 2, 2, 1, 4), 1), strict=True)))
        targets = labels(grown, box[rows], negative[rows], 223, rule, draws[rows])
        total, _ = losses(grown, targets, LossWeights(), reduce)
        return total.detach(), torch.autograd.grad(total, mix.weight)[0]

    whole, gradient = run(slice(None), None)
    processes, halves = _Processes(), (slice(0, batch // 2), slice(batch // 2, batch))
    for half in halves:
        run(half, processes.note)
    results = [run(half, processes.mean) for half in halves]
    assert torch.stack([value for value, _ in results]).mean().item() == pytest.approx(whole.item(), rel=1e-5)
    error = (torch.stack([g for _, g in results]).mean(0) - gradient).abs().max()
    assert error < 1e-5 * gradient.abs().max()
    alone = [run(half, None)[1] for half in halves]
    assert (torch.stack(alone).mean(0) - gradient).abs().max() > 1e-2 * gradient.abs().max(), "reduce mattered"


@pytest.mark.parametrize("rule", Labels)
def test_fp32_under_autocast_and_from_half_precision(rule: Labels) -> None:
    maps, box, negative, draws = random_case(223, 8, 5)
    rounded = Maps(*(m.bfloat16() for m in maps))
    wanted, _ = losses(
        Maps(*(m.float() for m in rounded)), labels(rounded, box, negative, 223, rule, draws), LossWeights()
    )
    with torch.autocast("cpu", torch.bfloat16):
        total, parts = losses(rounded, labels(rounded, box, negative, 223, rule, draws), LossWeights())
    assert total.dtype is torch.float32
    assert {p.dtype for p in parts.values()} == {torch.float32}
    assert total.item() == pytest.approx(wanted.item(), rel=1e-6)


def test_a_mean_of_nothing_is_zero_and_one_call_reduces_all() -> None:
    calls: list[Tensor] = []

    def reduce(counts: Tensor) -> Tensor:
        calls.append(counts)
        return counts

    terms = {"none": Mean(torch.tensor(0.0), torch.tensor(0)), "some": Mean(torch.tensor(6.0), torch.tensor(3))}
    assert {k: v.item() for k, v in divided(terms, reduce).items()} == {"none": 0.0, "some": 2.0}
    assert [c.tolist() for c in calls] == [[0.0, 3.0]]


@pytest.mark.parametrize("rule", Labels)
def test_maps_that_are_not_finite_show_in_the_total(rule: Labels) -> None:
    """The loop skips such a step; a total that hid it would let the weights be ruined."""
    for name in Maps._fields:
        maps, box, negative, draws = random_case(223, 4, 6)
        getattr(maps, name)[0] = float("nan")
        total, _ = losses(maps, labels(maps, box, negative, 223, rule, draws), LossWeights())
        assert not torch.isfinite(total), name
