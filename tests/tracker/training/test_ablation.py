from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import SafetensorError
from safetensors.torch import save_file
from torch import Tensor, nn

from tracker.box import Box
from tracker.siamapnpp.decode import ANCHOR_PX
from tracker.siamapnpp.network import Maps, NetworkSize, SiamAPNpp, Template
from tracker.training import ablation as ablation_module
from tracker.training.ablation import SweepPoint, TrainedVariant, run_ablation, sweep_w1, variant_recipe
from tracker.training.ablation_report import FILES, as_markdown
from tracker.training.errors import TrainingError
from tracker.training.recipe import Packed, Recipe, Simulator, Stage, Start, Teacher, Validation, Variant
from tracker.training.types import Footage
from tracker.training.validate import SETTINGS

TINY = NetworkSize((8, 8, 8, 8, 8), 32)
CELLS = 21
RECIPE = Recipe(
    name="tiny",
    description="for tests",
    sources=(Simulator(kind="simulator"),),
    stages=(Stage(pairs=3000, batch=10, warmup_pairs=1000), Stage(pairs=1000, batch=10, warmup_pairs=0)),
    validation=Validation(max_frames=4),
)


class Plain(nn.Module):
    """Deep features, which the engine listens to: the same everywhere."""

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        cells = 6 if image.shape[-1] == 127 else 26
        return torch.ones(1, 2, cells, cells), torch.ones(1, 2, cells, cells)


class Torn(nn.Module):
    """cls1 points four cells to the right of the target, cls2 at it: who wins depends on w1 alone."""

    def __init__(self) -> None:
        super().__init__()
        self.unused = nn.Parameter(torch.zeros(3))
        self.backbone = Plain()

    def template(self, exemplar: Tensor) -> Template:
        self.backbone(exemplar)
        return Template(exemplar, exemplar, exemplar)

    def search(self, template: Template, image: Tensor) -> Maps:
        self.backbone(image)
        shape = (1, 1, CELLS, CELLS)
        cls1, cls2 = torch.zeros(1, 2, CELLS, CELLS), torch.zeros(1, 2, CELLS, CELLS)
        cls1[:, 0], cls2[:, 0] = 8.0, 8.0
        cls1[0, :, 10, 14] = torch.tensor([0.0, 8.0])
        cls2[0, :, 10, 10] = torch.tensor([0.0, 8.0])
        anchor = torch.full(shape, 32 / ANCHOR_PX).expand(1, 4, CELLS, CELLS)
        return Maps(anchor, cls1, cls2, torch.full(shape, -8.0), torch.zeros(1, 4, CELLS, CELLS))


def footage(count: int = 4) -> list[Footage]:
    image = np.full((240, 320, 3), 90, np.uint8)
    return [Footage("still", (Box(160.0, 120.0, 64.0, 64.0),) * count, [image] * count)]


class Trainer:
    """Remembers what it was asked to train."""

    def __init__(self, make: Callable[[], nn.Module] = Torn, stops_at: Variant | None = None) -> None:
        self.make, self.stops_at = make, stops_at
        self.asked: list[tuple[Recipe, Path]] = []

    def __call__(self, recipe: Recipe, folder: Path) -> TrainedVariant | None:
        self.asked.append((recipe, folder))
        if recipe.variant is self.stops_at:
            return None
        return TrainedVariant(self.make(), sum(stage.pairs or 0 for stage in recipe.stages), 12.5)

    @property
    def variants(self) -> list[Variant]:
        return [recipe.variant for recipe, _ in self.asked]


def test_each_variant_is_trained_once_for_equally_many_pairs(tmp_path: Path) -> None:
    train, told = Trainer(), []
    wanted = [Variant.AAN, Variant.SIAMAPN, Variant.SELF_AAN, Variant.APN_DF]
    found = run_ablation(RECIPE, 400, wanted, train, footage(), tmp_path, w1_values=(), report=told.append)
    assert found is not None
    assert train.variants == [Variant.SIAMAPN, Variant.APN_DF, Variant.SELF_AAN, Variant.AAN]
    assert {tuple(stage.pairs for stage in recipe.stages) for recipe, _ in train.asked} == {(300, 100)}
    assert len({folder for _, folder in train.asked}) == 4
    assert [(r.pairs, r.pairs_per_s, r.parameters) for r in found.variants] == [(400, 12.5, 3)] * 4
    assert found.variants[0].p20 == 1.0
    assert len(told) == 8

    again = Trainer()
    assert run_ablation(RECIPE, 400, wanted, again, footage(), tmp_path, w1_values=()) == found
    assert again.asked == []


def test_the_report_marks_what_was_published_and_claims_nothing(tmp_path: Path) -> None:
    found = run_ablation(
        RECIPE, 400, list(Variant), Trainer(), footage(), tmp_path, w1_values=(0.5, 1.2), sweep_network=Torn()
    )
    assert found is not None
    text = (tmp_path / "ablation.md").read_text(encoding="utf-8")
    assert text.splitlines() == as_markdown(found)
    assert "No reproduction of the paper" in text
    assert "P20 published (UAV20L, another training)" in text
    rows = [row for row in text.splitlines() if row.startswith("| ") and "| 400 |" in row]
    for row, paper in zip(rows, (0.721, 0.727, 0.730, 0.736), strict=True):
        assert row.endswith(f"| {paper:.3f} |")
    assert "no difference here, best 1.2 in the paper (published)" in text
    better = replace(found, sweep=(*found.sweep, SweepPoint(1.5, 0.99, 1.0)))
    assert any("best 1.5 here" in line for line in as_markdown(better))
    told = json.loads((tmp_path / "ablation.json").read_text(encoding="utf-8"))
    assert [v["variant"] for v in told["variants"]] == [v.value for v in Variant]
    assert [point["w1"] for point in told["w1_sweep"]] == [0.5, 1.2]
    assert (tmp_path / "ablation.png").read_bytes().startswith(b"\x89PNG")
    assert {path.name for path in tmp_path.iterdir()} == {*FILES, "variants", "w1.json"}


def test_a_stopped_ablation_goes_on_where_it_was(tmp_path: Path) -> None:
    first = Trainer(stops_at=Variant.APN_DF)
    variants = (Variant.SIAMAPN, Variant.APN_DF)
    assert run_ablation(RECIPE, 400, variants, first, footage(), tmp_path, w1_values=()) is None
    assert not (tmp_path / "ablation.json").exists()
    second = Trainer()
    assert run_ablation(RECIPE, 400, variants, second, footage(), tmp_path, w1_values=()) is not None
    assert second.variants == [Variant.APN_DF]
    assert second.asked[0][1] == first.asked[1][1]


def test_a_variant_whose_validation_was_stopped_is_not_complete(tmp_path: Path) -> None:
    found = run_ablation(
        RECIPE, 400, (Variant.AAN,), Trainer(), footage(), tmp_path, w1_values=(), should_stop=lambda: True
    )
    assert found is None
    assert not list(tmp_path.rglob("result.json"))


def test_results_of_something_else_are_not_mixed_in(tmp_path: Path) -> None:
    run_ablation(RECIPE, 400, (Variant.AAN,), Trainer(), footage(), tmp_path, w1_values=())
    changed = RECIPE.model_copy(update={"seed": 2})
    for recipe, pairs, items in ((changed, 400, footage()), (RECIPE, 800, footage()), (RECIPE, 400, footage(5))):
        with pytest.raises(TrainingError, match=r"result.json: from another recipe.*another folder"):
            run_ablation(recipe, pairs, (Variant.AAN,), Trainer(), items, tmp_path, w1_values=())
    next(tmp_path.rglob("result.json")).write_text("{}")
    with pytest.raises(TrainingError, match="not a result of an ablation"):
        run_ablation(RECIPE, 400, (Variant.AAN,), Trainer(), footage(), tmp_path, w1_values=())


def test_unequal_trainings_are_not_compared(tmp_path: Path) -> None:
    def uneven(recipe: Recipe, folder: Path) -> TrainedVariant:
        return TrainedVariant(Torn(), 400 if recipe.variant is Variant.AAN else 390, None)

    with pytest.raises(TrainingError, match="siamapn 390, aan 400"):
        run_ablation(RECIPE, 400, (Variant.SIAMAPN, Variant.AAN), uneven, footage(), tmp_path, w1_values=())


def test_nothing_to_track_or_train_is_said_before_training(tmp_path: Path) -> None:
    train = Trainer()
    for variants, items in (((), footage()), ((Variant.AAN,), [])):
        with pytest.raises(TrainingError, match="needs variants, and sequences"):
            run_ablation(RECIPE, 400, variants, train, items, tmp_path)
    assert train.asked == []


def test_w1_decides_between_the_maps() -> None:
    points = sweep_w1(Torn(), footage(), SETTINGS, (0.5, 20.0))
    assert points is not None
    assert [point.w1 for point in points] == [0.5, 20.0]
    assert points[0].p20 == 1.0
    assert points[1].p20 < 0.5
    assert points[0].auc > points[1].auc
    assert sweep_w1(Torn(), footage(), SETTINGS, (0.5,), should_stop=lambda: True) is None


def test_w1_is_swept_on_the_trained_aan_and_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(ablation_module.SIZES, "s", TINY)
    swept: list[dict[str, Tensor]] = []
    sweep = ablation_module.sweep_w1

    def watched(network: nn.Module, *rest: object) -> object:
        swept.append(network.state_dict())
        return sweep(network, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(ablation_module, "sweep_w1", watched)
    torch.manual_seed(1)
    network = SiamAPNpp(TINY).eval()
    train = Trainer(lambda: network)
    found = run_ablation(RECIPE, 400, (Variant.AAN,), train, footage(2), tmp_path, w1_values=(1.2,))
    assert found is not None
    assert [point.w1 for point in found.sweep] == [1.2]
    assert len(swept) == 1
    assert all(torch.equal(value, network.state_dict()[name]) for name, value in swept[0].items())
    assert run_ablation(RECIPE, 400, (Variant.AAN,), train, footage(2), tmp_path, w1_values=(1.2,)) == found
    assert len(swept) == 1
    assert run_ablation(RECIPE, 400, (Variant.AAN,), train, footage(2), tmp_path, w1_values=(0.9,)) != found


@pytest.fixture
def swept_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], object]:
    """A study of the aan with a sweep in `tmp_path`, and what does it again; tells whether it swept again."""
    monkeypatch.setitem(ablation_module.SIZES, "s", TINY)
    torch.manual_seed(1)
    network = SiamAPNpp(TINY).eval()
    count = 0
    sweep = ablation_module.sweep_w1

    def watched(*arguments: object) -> object:
        nonlocal count
        count += 1
        return sweep(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(ablation_module, "sweep_w1", watched)

    def again() -> int:
        train = Trainer(lambda: network)
        found = run_ablation(RECIPE, 400, (Variant.AAN,), train, footage(2), tmp_path, w1_values=(1.2,))
        assert found is not None
        assert [point.w1 for point in found.sweep] == [1.2]
        return count

    assert again() == 1
    return again


@pytest.mark.parametrize("content", ["{", "{}", "[]", "[" * 100_000, '{"key": KEY, "points": [{"w1": "x"}]}'])
def test_a_damaged_sweep_is_done_again(tmp_path: Path, swept_once: Callable[[], object], content: str) -> None:
    key = json.dumps(json.loads((tmp_path / "w1.json").read_text())["key"])
    (tmp_path / "w1.json").write_text(content.replace("KEY", key))
    assert swept_once() == 2
    assert swept_once() == 2


@pytest.mark.parametrize("damaged", [b"", b"123456789", "other"])
def test_damaged_weights_of_the_aan_are_told(
    tmp_path: Path, swept_once: Callable[[], object], damaged: bytes | str
) -> None:
    (tmp_path / "w1.json").unlink()
    own = tmp_path / "variants" / "aan"
    path = own / "weights.safetensors"
    if isinstance(damaged, bytes):
        path.write_bytes(damaged)
    else:
        save_file({"x": torch.zeros(2)}, path)
    with pytest.raises(TrainingError) as caught:
        swept_once()
    assert str(caught.value).startswith(f"{path}: not the trained weights (")
    assert str(caught.value).endswith(f"; delete {own} to train anew")
    assert "\n" not in str(caught.value)


def test_a_result_with_texts_for_numbers_is_none(tmp_path: Path) -> None:
    run_ablation(RECIPE, 400, (Variant.AAN,), Trainer(), footage(), tmp_path, w1_values=())
    path = next(tmp_path.rglob("result.json"))
    told = json.loads(path.read_text())
    told["result"]["auc"] = "much"
    path.write_text(json.dumps(told))
    with pytest.raises(TrainingError, match="not a result of an ablation"):
        run_ablation(RECIPE, 400, (Variant.AAN,), Trainer(), footage(), tmp_path, w1_values=())


def test_a_full_disk_is_told_and_the_variant_not_complete(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(tensors: object, path: Path) -> None:
        path.write_bytes(b"a part")
        raise SafetensorError("No space left on device")

    monkeypatch.setattr(ablation_module, "save_file", full)
    with pytest.raises(TrainingError, match=r"aan: cannot be written \(No space left on device\); make room"):
        run_ablation(RECIPE, 400, (Variant.AAN,), Trainer(), footage(), tmp_path, w1_values=())
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == []


def test_a_pack_that_was_moved_makes_no_other_study(tmp_path: Path) -> None:
    packs = [Packed(kind="packed", path=f"/{place}", set_name="a") for place in ("here", "there")]
    one, other = (RECIPE.model_copy(update={"sources": (pack,)}) for pack in packs)
    found = run_ablation(one, 400, (Variant.AAN,), Trainer(), footage(), tmp_path, w1_values=())
    train = Trainer()
    assert run_ablation(other, 400, (Variant.AAN,), train, footage(), tmp_path, w1_values=()) == found
    assert train.asked == []


def test_the_recipe_of_a_variant() -> None:
    made = variant_recipe(RECIPE, Variant.APN_DF, 400)
    assert made.variant is Variant.APN_DF
    assert [stage.warmup_pairs for stage in made.stages] == [100, 0]
    assert (made.seed, made.sources, made.loss) == (RECIPE.seed, RECIPE.sources, RECIPE.loss)
    whole = RECIPE.model_copy(update={"start": Start(model="s"), "teacher": Teacher(model="full")})
    made = variant_recipe(whole, Variant.SIAMAPN, 400)
    assert made.teacher is None
    assert made.start == Start(backbone="s")
    with pytest.raises(TrainingError, match=r"start.widen.*give start.backbone"):
        variant_recipe(RECIPE.model_copy(update={"size": "full", "start": Start(widen="s")}), Variant.AAN, 400)
    timed = RECIPE.model_copy(update={"stages": (Stage(minutes=30, batch=10), Stage(minutes=10, batch=10))})
    assert [(s.pairs, s.minutes, s.warmup_pairs) for s in variant_recipe(timed, Variant.AAN, 400).stages] == [
        (300, None, 30),
        (100, None, 10),
    ]
    mixed = RECIPE.model_copy(update={"stages": (Stage(minutes=30), Stage(pairs=10))})
    with pytest.raises(TrainingError, match="all stages pairs or all minutes"):
        variant_recipe(mixed, Variant.AAN, 400)
