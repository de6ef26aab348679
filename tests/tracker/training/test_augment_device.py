"""The torch way makes the crops and labels of the OpenCV way, and never waits for its device."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from tests.tracker.training.augment_scene import FILL, NOTHING, STILL, only, plan_of, textured
from tracker.box import Box
from tracker.training.augment.device import render_batch
from tracker.training.augment.jpeg import jpeg
from tracker.training.augment.plan import Plan
from tracker.training.augment.render import render_pair
from tracker.training.recipe import Augmentation, Jitter
from tracker.training.types import View

S, POOL, ROWS = 223, 320, 6
SIZES = ((63.5, 63.5), (100.0, 30.0), (40.0, 85.0), (70.3, 55.1))


def _views() -> list[View]:
    boxes = [Box(POOL / 2 + 3.25 * i, POOL / 2 - 1.5 * i, w, h) for i, (w, h) in enumerate(SIZES)]
    return [textured(box, POOL, POOL, seed=i) for i, box in enumerate(boxes)]


VIEWS = _views()
EXEMPLARS = torch.arange(ROWS) % len(VIEWS)
SEARCHES = (torch.arange(ROWS) + 1) % len(VIEWS)


def _pool(device: str = "cpu") -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    crops = torch.from_numpy(np.stack([v.image_bgr_u8.transpose(2, 0, 1) for v in VIEWS]))
    boxes = torch.tensor([[v.box.cx_px, v.box.cy_px, v.box.w_px, v.box.h_px] for v in VIEWS])
    return crops.to(device), boxes.to(device), torch.tensor([FILL] * len(VIEWS)).to(device)


def _both(plan: Plan, seed: int = 1) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Exemplars, crops (BGR last, float) and labels of both ways."""
    generator = torch.Generator().manual_seed(seed)
    ours = render_batch(*_pool(), EXEMPLARS, SEARCHES, plan, S, generator)
    pairs = [render_pair(VIEWS[EXEMPLARS[r]], VIEWS[SEARCHES[r]], plan, r, S, seed) for r in range(ROWS)]
    theirs = [np.stack([np.asarray(pair[i], float) for pair in pairs]) for i in range(3)]
    return [
        ours[0].numpy().transpose(0, 2, 3, 1) * 1.0,
        ours[1].numpy().transpose(0, 2, 3, 1) * 1.0,
        ours[2].numpy(),
    ], theirs


def _differences(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.abs(a - b).mean(axis=(1, 2, 3))


def test_shapes_and_types() -> None:
    exemplar, search, box = render_batch(*_pool(), EXEMPLARS, SEARCHES, plan_of(Augmentation(), Jitter(), ROWS), 287)
    assert (exemplar.shape, search.shape, box.shape) == ((ROWS, 3, 127, 127), (ROWS, 3, 287, 287), (ROWS, 4))
    assert (exemplar.dtype, search.dtype, box.dtype) == (torch.uint8, torch.uint8, torch.float32)


@pytest.mark.parametrize(
    "jitter",
    [STILL, Jitter(angle_deg=40, log_scale=0.6, exemplar_angle_deg=30, exemplar_log_scale=0.4), Jitter(log_scale=1.4)],
    ids=["still", "strong", "shrunk"],
)
def test_same_geometry_and_same_labels(jitter: Jitter) -> None:
    plan = plan_of(NOTHING.model_copy(update={"flip": 0.5}), jitter, ROWS)
    ours, theirs = _both(plan)
    assert np.abs(ours[2] - theirs[2]).max() < 1e-3
    assert _differences(ours[0], theirs[0]).max() < 0.1
    assert _differences(ours[1], theirs[1]).max() < 0.5


@pytest.mark.parametrize(
    ("effect", "limit"),
    [
        ("colour", 0.5),
        ("gamma", 0.5),
        ("gray", 0.5),
        ("motion_blur", 0.3),
        ("blur", 0.3),
        ("low_resolution", 0.4),
        ("fog", 0.4),
        ("occlusion", 0.1),
        ("lookalike", 0.3),
        ("jpeg", 2.0),  # libjpeg rounds its colours and transforms with integers
        ("exemplar_low_resolution", 0.1),
    ],
)
def test_same_effects(effect: str, limit: float) -> None:
    plan = plan_of(only(effect), Jitter(), ROWS)
    ours, theirs = _both(plan)
    plain = render_batch(*_pool(), EXEMPLARS, SEARCHES, plan_of(NOTHING, Jitter(), ROWS), S)
    changed = int(effect != "exemplar_low_resolution")
    effects = _differences(ours[changed], plain[changed].numpy().transpose(0, 2, 3, 1) * 1.0)
    assert np.median(effects) > 2 * np.median(_differences(ours[changed], theirs[changed]))
    assert np.median(effects) > 0.5
    assert _differences(ours[1], theirs[1]).max() < limit
    assert _differences(ours[0], theirs[0]).max() < 0.5
    assert np.array_equal(ours[2], plain[2].numpy())


def test_noise_has_its_strength_and_comes_from_the_generator() -> None:
    plan = plan_of(only("noise"), STILL, ROWS)
    one, _ = _both(plan, 1)
    assert np.array_equal(one[1], _both(plan, 1)[0][1])
    assert not np.array_equal(one[1], _both(plan, 2)[0][1])
    plain, _ = _both(plan_of(NOTHING, STILL, ROWS))
    noise = (one[1] - plain[1]).std(axis=(1, 2, 3))
    assert noise == pytest.approx(plan.degradation.noise_sigma, rel=0.04)
    assert np.array_equal(one[0], plain[0])


def test_rows_do_not_disturb_each_other() -> None:
    recipe = Augmentation(noise=0, jpeg=0.1, occlusion=0.5, lookalike=0.5, motion_blur=0.3, low_resolution=0.3)
    plan = plan_of(recipe, Jitter(log_scale=1.2), ROWS)
    together = render_batch(*_pool(), EXEMPLARS, SEARCHES, plan, S)
    for row in range(ROWS):
        one = plan.rows(slice(row, row + 1))
        alone = render_batch(*_pool(), EXEMPLARS[row : row + 1], SEARCHES[row : row + 1], one, S)
        assert torch.allclose(alone[2][0], together[2][row], atol=1e-4)
        for i in (0, 1):
            assert (alone[i][0].float() - together[i][row].float()).abs().mean() < 0.01


def test_many_rows_are_rendered_in_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = plan_of(NOTHING, Jitter(), ROWS)
    whole = render_batch(*_pool(), EXEMPLARS, SEARCHES, plan, S)
    monkeypatch.setattr("tracker.training.augment.device.CHUNK_ROWS", 4)
    chunks = render_batch(*_pool(), EXEMPLARS, SEARCHES, plan, S)
    assert all(torch.equal(a, b) for a, b in zip(whole, chunks, strict=True))


def test_no_step_asks_the_device_for_a_number() -> None:
    """Tensors on `meta` have shapes and no values: reading one, or a shape that depends on one, raises."""
    shares = {"motion_blur": 0.2, "blur": 0.2, "low_resolution": 0.2, "noise": 0.1, "fog": 0.1, "jpeg": 0.2}
    recipe = Augmentation(**shares, gray=0.5, gamma=0.5, occlusion=0.9, lookalike=0.9, exemplar_low_resolution=0.5)
    plan = plan_of(recipe, Jitter(log_scale=1.4), 60)
    assert set(plan.degradation.effect) == set(range(1, 7))
    index = torch.arange(60, device="meta") % len(VIEWS)
    exemplar, search, box = render_batch(*_pool("meta"), index, index, plan, S)
    assert (exemplar.shape, search.shape, box.shape) == ((60, 3, 127, 127), (60, 3, S, S), (60, 4))
    with pytest.raises(RuntimeError):
        box[0, 0].item()


@pytest.mark.parametrize("quality", [12, 45, 80])
def test_jpeg_is_that_of_libjpeg(quality: int) -> None:
    image = VIEWS[0].image_bgr_u8[:S, :S]
    _, code = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    theirs = cv2.imdecode(code, cv2.IMREAD_COLOR).astype(float)
    ours = jpeg(
        torch.from_numpy(image.transpose(2, 0, 1).copy())[None].float(), torch.full((1, 1, 1, 1), float(quality))
    )
    difference = np.abs(ours[0].numpy().transpose(1, 2, 0) - theirs).mean()
    assert difference < 0.4 * np.abs(theirs - image).mean()


def test_a_shrunk_crop_averages_instead_of_skipping_pixels() -> None:
    board = 255 * (np.indices((POOL, POOL)).sum(axis=0) % 2).astype(np.uint8)
    pool = torch.from_numpy(np.repeat(board[None, None], 3, axis=1))
    plan = plan_of(NOTHING, STILL)
    plan = replace(plan, search=replace(plan.search, log_scale=np.array([-0.9]), angle_rad=np.array([0.2])))
    box, fill, index = torch.tensor([[160.0, 160.0, 63.5, 63.5]]), torch.zeros(1, 3), torch.zeros(1, dtype=torch.long)
    _, search, _ = render_batch(pool, box, fill, index, index, plan, S)
    middle = search[0, 0, 90:130, 90:130].float()
    assert abs(float(middle.mean()) - 127.5) < 2
    assert float(middle.std()) < 3
