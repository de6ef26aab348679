"""Imitating a teacher's maps."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch import Tensor

from tests.tracker.training.slow_labels import random_case
from tracker.siamapnpp.network import Maps
from tracker.training.errors import TrainingError
from tracker.training.recipe import Teacher as Spec
from tracker.training.teacher import Teacher, imitation
from tracker.weights.store import load


@pytest.fixture(scope="module")
def teacher() -> Teacher:
    return Teacher(Spec(model="s", weight=2.0))


@pytest.fixture(scope="module")
def crops() -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(1)
    return torch.rand(2, 3, 127, 127, generator=generator) * 255, torch.rand(2, 3, 143, 143, generator=generator) * 255


def _pair() -> tuple[Maps, Maps]:
    student, teacher = random_case(223, 4, 1)[0], random_case(223, 4, 2)[0]
    return student, teacher


def test_the_teacher_agrees_with_itself(teacher: Teacher, crops: tuple[Tensor, Tensor]) -> None:
    with torch.no_grad():
        own = load("s").network()(*crops)
        assert teacher.term(*crops, own).item() == pytest.approx(0.0, abs=1e-3)


def test_the_term_is_weighted_and_its_gradient_is_the_students(teacher: Teacher, crops: tuple[Tensor, Tensor]) -> None:
    maps = Maps(*(torch.zeros_like(m).requires_grad_() for m in teacher.maps(*crops)))
    term = teacher.term(*crops, maps)
    assert term.item() == pytest.approx(2.0 * imitation(maps, teacher.maps(*crops)).item())
    term.backward()
    assert all(m.grad is not None and torch.isfinite(m.grad).all() for m in (maps.cls1, maps.cls2, maps.cls3))
    assert not any(p.requires_grad for p in teacher._network.parameters())


@pytest.mark.parametrize("name", Maps._fields)
def test_every_map_counts(name: str) -> None:
    _, teacher = _pair()
    moved = teacher._replace(**{name: getattr(teacher, name) + torch.linspace(0.2, 0.6, 13)})
    changed = imitation(moved, teacher).item()
    if name in ("cls1", "cls2"):  # both logits moved alike say the same
        assert changed == pytest.approx(0.0, abs=1e-4)
        tilted = getattr(teacher, name) + torch.tensor([0.5, -0.5])[:, None, None]
        changed = imitation(teacher._replace(**{name: tilted}), teacher).item()
    assert changed > 0.01
    assert imitation(teacher, teacher).item() == pytest.approx(0.0, abs=1e-5)


def test_classes_are_kullback_leibler_divergences() -> None:
    student, teacher = _pair()
    same = student._replace(cls2=teacher.cls2, cls3=teacher.cls3, anchor=teacher.anchor, loc=teacher.loc)
    p, q = torch.softmax(teacher.cls1, 1), torch.softmax(student.cls1, 1)
    wanted = (p * (p / q).log()).sum(1).mean()
    assert imitation(same, teacher).item() == pytest.approx(wanted.item(), rel=1e-4)
    same = same._replace(cls1=teacher.cls1, cls3=student.cls3)
    a, b = torch.sigmoid(teacher.cls3), torch.sigmoid(student.cls3)
    wanted = (a * (a / b).log() + (1 - a) * ((1 - a) / (1 - b)).log()).mean()
    assert imitation(same, teacher).item() == pytest.approx(wanted.item(), rel=1e-4)


def test_boxes_count_only_where_the_teacher_is_sure() -> None:
    student, teacher = _pair()
    doubtful = torch.zeros_like(teacher.cls1)
    doubtful[:, 0] = 9.0
    teacher = teacher._replace(cls1=doubtful, cls2=doubtful, cls3=torch.full_like(teacher.cls3, -9.0))
    student = teacher._replace(loc=student.loc, anchor=student.anchor)
    assert imitation(student, teacher).item() == pytest.approx(0.0, abs=1e-5)
    sure = teacher._replace(cls1=-doubtful)
    sure = sure._replace(cls2=-doubtful, cls3=-teacher.cls3)
    assert imitation(sure._replace(loc=student.loc, anchor=student.anchor), sure).item() > 0.05


def test_the_same_boxes_from_other_anchors_are_equal() -> None:
    """Only the anchors' own distance is left: deltas are compared as boxes."""
    _, teacher = _pair()
    anchor, loc = torch.ones_like(teacher.anchor), torch.zeros_like(teacher.loc)
    teacher = teacher._replace(anchor=anchor, loc=loc, cls1=teacher.cls1.abs() * torch.tensor([-9.0, 9])[:, None, None])
    teacher = teacher._replace(cls2=teacher.cls1, cls3=teacher.cls3.abs())
    wider = anchor * torch.tensor([2.0, 2, 1, 1])[:, None, None]
    narrowing = loc - torch.tensor([0.0, 0, 2.0, 1.0])[:, None, None].log().nan_to_num(0, 0, 0)
    assert imitation(teacher._replace(anchor=wider, loc=narrowing), teacher).item() == pytest.approx(0.5, rel=1e-3)


def test_two_processes_have_the_mean_of_one() -> None:
    student, teacher = _pair()
    halves = (slice(0, 1), slice(1, 4))  # of different sizes
    whole, counts = imitation(student, teacher), []
    parts = [(Maps(*(m[h] for m in student)), Maps(*(m[h] for m in teacher))) for h in halves]
    for part in parts:
        imitation(*part, lambda c: counts.append(c) or c)
    mean = torch.stack(counts).mean(0)
    values = [imitation(*part, lambda _: mean) for part in parts]
    assert torch.stack(values).mean().item() == pytest.approx(whole.item(), rel=1e-5)


def test_a_missing_teacher_is_named(tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match=r"teacher\.model: .*none\.safetensors"):
        Teacher(Spec(model=str(tmp_path / "none.safetensors")))
