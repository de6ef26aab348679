"""The vectorised labels say what a slow loop over samples and cells says."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from tests.tracker.training.slow_labels import deltas, paper, random_case, relative_total, samples
from tracker.siamapnpp.network import Maps
from tracker.training.errors import TrainingError
from tracker.training.losses import losses
from tracker.training.recipe import Labels, LossWeights
from tracker.training.targets import DRAWS, IGNORED, Draw, Targets, cells_per_side, draws_for, labels

PAPER_FIELDS = ("cls1", "cls2", "cls3", "anchor_weight", "loc_weight")


@pytest.mark.parametrize(("search_px", "seed"), [(287, 1), (223, 2), (255, 3)])
def test_paper_rule_equals_the_slow_loop(search_px: int, seed: int) -> None:
    maps, box, negative, draws = random_case(search_px, 16, seed, noise=0.2)
    maps.anchor[5, 0, 2, 2] = -4.0  # one anchor without width: no regression for its whole sample
    found = labels(maps, box, negative, search_px, Labels.PAPER, draws)
    for index, sample in enumerate(samples(maps, box, negative, draws)):
        wanted = paper(sample)
        for name in PAPER_FIELDS:
            got = getattr(found, name)[index].double().numpy()
            assert np.abs(got - wanted[name]).max() < 1e-5, (index, name)
        for r, c in np.argwhere(wanted["loc_weight"] > 0):
            assert found.loc[index, :, r, c].tolist() == pytest.approx(deltas(sample, r, c, 1e-3), abs=1e-4)
    assert (found.cls3_weight == 1).all()
    assert (found.loc_weight[5] == 0).all()
    assert (found.cls1[5] >= 0).any(), "only the regression is given up"


def test_paper_case_exercises_every_limit() -> None:
    """The comparison above means something only if the limits bite in it."""
    maps, box, negative, draws = random_case(287, 16, 1, noise=0.2)
    found = labels(maps, box, negative, 287, Labels.PAPER, draws)
    positives, chosen = (found.cls1 == 1).flatten(1).sum(1), (found.loc_weight > 0).flatten(1).sum(1)
    negatives = (found.cls1 == 0).flatten(1).sum(1)
    assert positives.max() == 16
    assert (positives[~negative] == 0).any()
    assert chosen.max() == 16
    assert ((chosen > 0) & (chosen < 16)).any()
    assert negatives[~negative].max() == 48
    assert (negatives[negative] == 16).all()
    assert (box.abs().amax(1) > 80).any(), "a target that leaves the map"


@pytest.mark.parametrize(("search_px", "seed", "noise"), [(255, 4, 0.05), (223, 5, 0.15)])
def test_relative_rule_equals_the_slow_loop(search_px: int, seed: int, noise: float) -> None:
    maps, box, negative, draws = random_case(search_px, 6, seed, noise)
    found = labels(maps, box, negative, search_px, Labels.RELATIVE, draws)
    total, _ = losses(maps, found, LossWeights())
    assert total.item() == pytest.approx(relative_total(maps, samples(maps, box, negative, draws)), abs=1e-4)


def test_relative_rule_has_positives_where_the_papers_has_none() -> None:
    maps, box, negative, draws = random_case(223, 8, 6, noise=1.0)
    strict, lenient = (labels(maps, box, negative, 223, rule, draws) for rule in Labels)
    without = ((strict.cls1 == 1).flatten(1).sum(1) == 0) & ~negative
    assert ((lenient.cls1 == 1).flatten(1).sum(1)[without] > 0).any()


@pytest.mark.parametrize("rule", Labels)
@pytest.mark.parametrize("value", [float("nan"), float("inf"), 0.0, 1e6])
def test_a_negative_has_no_positive_and_its_box_may_be_anything(rule: Labels, value: float) -> None:
    maps, box, _, draws = random_case(223, 2, 7)
    found = labels(maps, torch.full_like(box, value), torch.ones(2, dtype=torch.bool), 223, rule, draws)
    assert not (found.cls1 == 1).any()
    assert not (found.cls2 == 1).any()
    assert found.cls3.sum() == found.anchor_weight.sum() == found.loc_weight.sum() == 0
    assert (found.cls1 == 0).any(1).any(1).all(), "something to learn from"
    assert (found.cls2 == 0).any(1).any(1).all()
    total, _ = losses(maps, found, LossWeights())
    assert torch.isfinite(total)


def test_a_samples_labels_depend_on_that_sample_alone() -> None:
    maps, box, negative, draws = random_case(223, 6, 8)
    for rule in Labels:
        whole = labels(maps, box, negative, 223, rule, draws)
        half = labels(Maps(*(m[3:] for m in maps)), box[3:], negative[3:], 223, rule, draws[3:])
        for name in (*PAPER_FIELDS, "cls3_weight", "anchor", "loc", "anchors"):
            assert torch.equal(getattr(whole, name)[3:], getattr(half, name)), (rule, name)


def test_mirrored_pictures_have_mirrored_labels() -> None:
    """Left and right, or x and y, mixed up anywhere would show here. (The paper's truncated indices are one-sided.)"""
    maps, box, negative, draws = random_case(223, 6, 9)
    found = labels(maps, box, negative, 223, Labels.RELATIVE, draws)
    mirrored_maps = Maps(*(m.flip(-1) for m in maps))._replace(anchor=maps.anchor.flip(-1)[:, [1, 0, 2, 3]])
    mirrored_draws = draws.view(6, 13, 13, DRAWS).flip(2).reshape(6, 169, DRAWS)
    mirrored = labels(mirrored_maps, box[:, [2, 1, 0, 3]] * torch.tensor([-1, 1, -1, 1]), negative, 223,
                      Labels.RELATIVE, mirrored_draws)  # fmt: skip
    for name in ("cls1", "cls2", "anchor_weight", "loc_weight"):
        assert torch.equal(getattr(mirrored, name).flip(-1), getattr(found, name)), name
    sign = torch.tensor([-1.0, 1, 1, 1])[:, None, None]
    weight = found.loc_weight[:, None]
    assert torch.allclose(mirrored.loc.flip(-1) * sign * weight, found.loc * weight, atol=1e-5)


def test_no_gradient_flows_into_the_anchors_from_labels() -> None:
    maps, box, negative, draws = random_case(223, 4, 10)
    maps = maps._replace(anchor=maps.anchor.requires_grad_())
    for rule in Labels:
        found = labels(maps, box, negative, 223, rule, draws)
        tensors = [v for v in (getattr(found, n) for n in Targets.__dataclass_fields__) if isinstance(v, torch.Tensor)]
        assert not any(t.requires_grad for t in tensors)


def test_maps_of_another_crop_are_refused() -> None:
    maps, box, negative, draws = random_case(223, 2, 11)
    with pytest.raises(TrainingError, match="287 px has 21 cells a side, the maps 13"):
        labels(maps, box, negative, 287, Labels.PAPER, draws)


def test_cells_per_side() -> None:
    assert [cells_per_side(px) for px in (223, 231, 255, 287, 511)] == [13, 14, 17, 21, 49]


def test_draws_are_uniform_and_a_function_of_their_arguments() -> None:
    draws = draws_for(7, 1, 12, range(64), 169)
    assert draws.shape == (64, 169, DRAWS)
    assert draws.dtype is torch.float32
    assert draws.min() >= 0
    assert draws.max() < 1
    counts = torch.histc(draws, 16, 0, 1)
    assert ((counts - counts.mean()).abs() < 6 * counts.mean().sqrt()).all()
    flat = draws.flatten(1) - 0.5
    correlation = (flat @ flat.T) / (flat**2).sum(1)
    assert (correlation - torch.eye(64)).abs().max() < 6 / flat.shape[1] ** 0.5, "rows are independent"
    assert torch.equal(draws, draws_for(7, 1, 12, range(64), 169))


def test_two_processes_draw_what_one_draws() -> None:
    whole = draws_for(7, 1, 12, range(8), 169)
    parts = [draws_for(7, 1, 12, range(a, a + 4), 169) for a in (0, 4)]
    assert torch.equal(whole, torch.cat(parts))


@pytest.mark.parametrize("other", [(8, 1, 12), (7, 0, 12), (7, 1, 13), (1, 7, 12), (7, 12, 1)])
def test_draws_differ_by_seed_stage_and_step(other: tuple[int, int, int]) -> None:
    one, two = draws_for(7, 1, 12, range(2), 169), draws_for(*other, range(2), 169)
    assert ((one - two).abs() > 0.01).float().mean() > 0.9


def test_the_draws_decide_which_negatives_are_kept() -> None:
    maps, box, negative, draws = random_case(223, 4, 12)
    kept = draws.clone()
    kept[..., Draw.NEGATIVE] = 0.0
    none = draws.clone()
    none[..., Draw.NEGATIVE] = 0.9
    assert not (labels(maps, box, negative, 223, Labels.RELATIVE, none).cls1 == 0).any()
    assert (labels(maps, box, negative, 223, Labels.RELATIVE, kept).cls1[negative] == 0).all()
    assert IGNORED == -1
