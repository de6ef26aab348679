"""Where a run's weights come from."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from torch import Tensor

from tracker.training.errors import TrainingError
from tracker.training.recipe import Recipe
from tracker.training.start import read_backbone, start_network
from tracker.training.widen import is_symmetric, widen
from tracker.weights.store import load


def _recipe(**values: object) -> Recipe:
    base = {
        "name": "test",
        "description": "a test",
        "sources": [{"kind": "simulator"}],
        "stages": [{"pairs": 16}],
    }
    return Recipe.model_validate({**base, **values})


def _backbone(tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    return {k: v for k, v in tensors.items() if k.startswith("backbone.")}


def _equal(network_state: dict[str, Tensor], tensors: dict[str, Tensor]) -> bool:
    return all(torch.equal(network_state[k], v) for k, v in tensors.items())


def test_random_start_depends_on_the_seed_alone() -> None:
    torch.manual_seed(1)
    before = torch.get_rng_state()
    one = start_network(_recipe(seed=3)).state_dict()
    assert torch.equal(torch.get_rng_state(), before), "the global generator is left as it was"
    torch.manual_seed(99)
    assert _equal(start_network(_recipe(seed=3)).state_dict(), one)
    assert not _equal(start_network(_recipe(seed=4)).state_dict(), one)


def test_model() -> None:
    network = start_network(_recipe(start={"model": "s"}))
    assert _equal(network.state_dict(), load("s").tensors)
    assert network.training


def test_model_of_another_size_says_what_to_do() -> None:
    with pytest.raises(TrainingError, match=r"start\.model: s is of size s, not full; give start\.widen"):
        start_network(_recipe(size="full", start={"model": "s"}))
    with pytest.raises(TrainingError, match=r"start\.model: full is of size full, not s"):
        start_network(_recipe(start={"model": "full"}))


def test_an_exact_widening_is_no_start() -> None:
    assert is_symmetric(widen(load("s").tensors))
    assert not is_symmetric(widen(load("s").tensors, 0.1))
    with pytest.raises(TrainingError, match=r"full is an exact widening of an `s`.*give start\.widen"):
        start_network(_recipe(size="full", start={"model": "full"}))


def test_widen_gives_the_same_maps_as_the_s() -> None:
    recipe = _recipe(size="full", start={"widen": "s"})
    network, narrow = start_network(recipe).eval(), load("s").network()
    generator = torch.Generator().manual_seed(1)
    crops = [torch.rand(1, 3, side, side, generator=generator) * 255 for side in (127, 143)]
    with torch.no_grad():
        for a, b in zip(network(*crops), narrow(*crops), strict=True):
            assert (a - b).abs().max() < 1e-3
    weight = network.state_dict()["new.conv4.0.weight"]
    assert not torch.equal(weight[:, :128], weight[:, 128:]), "the copies must be able to part"
    with pytest.raises(TrainingError, match=r"start\.widen: full is already of size full; give start\.model"):
        start_network(_recipe(size="full", start={"widen": "full"}))


@pytest.mark.parametrize("variant", ["siamapn", "self_aan", "aan"])
def test_embedded_backbone_for_every_variant(variant: str) -> None:
    network = start_network(_recipe(variant=variant, start={"backbone": "s"}))
    fresh = start_network(_recipe(variant=variant))
    state, random = network.state_dict(), fresh.state_dict()
    assert _equal(state, _backbone(load("s").tensors))
    heads = {k: v for k, v in random.items() if not k.startswith("backbone.")}
    assert _equal(state, heads)


@pytest.mark.parametrize("prefix", ["backbone.", "", "features.", "module.backbone."])
@pytest.mark.parametrize("suffix", [".safetensors", ".pth"])
def test_backbone_files(tmp_path: Path, prefix: str, suffix: str) -> None:
    wanted = _backbone(load("s").tensors)
    tensors = {prefix + k.removeprefix("backbone."): v.contiguous() for k, v in wanted.items()}
    tensors |= {"classifier.weight": torch.zeros(3), f"{prefix}layer1.1.num_batches_tracked": torch.tensor(7)}
    path = tmp_path / f"backbone{suffix}"
    if suffix == ".pth":
        torch.save({"state_dict": tensors} if prefix else tensors, path)
    else:
        save_file(tensors, path)
    assert _equal(start_network(_recipe(start={"backbone": str(path)})).state_dict(), wanted)
    assert len(read_backbone(str(path))) == len(wanted) == 30


def test_backbone_that_does_not_fit_is_named() -> None:
    with pytest.raises(TrainingError, match=r"full: layer1\.0\.weight is 96x3x11x11, not 48x3x11x11;.* and \d+ more"):
        start_network(_recipe(start={"backbone": "full"}))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"layer3.1.bias": None}, r"layer3\.1\.bias is missing$"),
        ({"layer2.0.bias": torch.full((128,), float("nan"))}, r"layer2\.0\.bias is not finite$"),
        ({"layer2.0.bias": torch.tensor(1.0)}, r"layer2\.0\.bias is a scalar, not 128$"),
    ],
)
def test_broken_backbones(tmp_path: Path, change: dict[str, Tensor | None], message: str) -> None:
    tensors = {k.removeprefix("backbone."): v for k, v in _backbone(load("s").tensors).items()}
    changed = {k: v.contiguous() for k, v in {**tensors, **change}.items() if v is not None}
    save_file(changed, tmp_path / "b.safetensors")
    with pytest.raises(TrainingError, match=message):
        start_network(_recipe(start={"backbone": str(tmp_path / "b.safetensors")}))


class _Evil:
    def __reduce__(self) -> tuple[object, ...]:
        return (Path.touch, (Path("evil"),))


def test_files_that_are_no_backbone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.safetensors").write_text("hello")
    torch.save({"state_dict": {"x": torch.zeros(1)}}, tmp_path / "other.pth")
    torch.save([1, 2], tmp_path / "list.pth")
    torch.save(_Evil(), tmp_path / "evil.pth")
    for name, message in (
        ("none.pth", "no such file"),
        ("text.safetensors", "not a safetensors file"),
        ("other.pth", r"no tensor named layerN\.M"),
        ("list.pth", "no state_dict"),
        ("evil.pth", "nothing was run"),
    ):
        with pytest.raises(TrainingError, match=message):
            start_network(_recipe(start={"backbone": name}))
    assert not (tmp_path / "evil").exists()


def test_weights_of_aan_for_another_variant_are_refused() -> None:
    with pytest.raises(TrainingError, match=r"start\.model: .*aan.*apn_df.*start\.backbone"):
        start_network(_recipe(variant="apn_df", start={"model": "s"}))


def test_missing_model_is_named() -> None:
    with pytest.raises(TrainingError, match=r"start\.model: none\.safetensors"):
        start_network(_recipe(start={"model": "none.safetensors"}))
