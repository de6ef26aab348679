"""The tracker around the network: conventions, bounds, and that nothing makes its state go bad."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import torch

from tracker.box import Box
from tracker.engines.torch_engine import Precision, TorchEngine
from tracker.messages import Frame, SearchHint
from tracker.siamapnpp.decode import ResponseMaps
from tracker.siamapnpp.network import SIZES, NetworkSize, SiamAPNpp
from tracker.siamapnpp.settings import CentreTerm, TrackerSettings
from tracker.siamapnpp.tracker import SiamAPNTracker
from tracker.weights.build import build_tracker


class ScriptedEngine:
    """Answers every search with the same maps, and remembers its crops."""

    name = "scripted"

    def __init__(self, maps: ResponseMaps) -> None:
        self.maps = maps
        self.crops: list[np.ndarray] = []

    def set_exemplar(self, crop_bgr_u8: np.ndarray) -> None:
        self.crops.append(crop_bgr_u8)

    def search(self, crop_bgr_u8: np.ndarray) -> ResponseMaps:
        self.crops.append(crop_bgr_u8)
        return self.maps


def _maps_with_one_hit(row: int, column: int) -> ResponseMaps:
    cls = np.zeros((2, 21, 21), np.float32)
    cls[0] = 6
    cls[:, row, column] = [0, 12]
    centre = np.full((1, 21, 21), -8, np.float32)
    centre[0, row, column] = 8
    anchor = np.full((4, 21, 21), 31.75 / 71, np.float32)  # 63.5 px: a square target in its own search crop
    return ResponseMaps(cls, cls.copy(), centre, np.zeros((4, 21, 21), np.float32), anchor)


def _frame(image: np.ndarray, seq: int = 0) -> Frame:
    return Frame(image, seq, seq / 30, seq / 30)


def _blank(width: int = 640, height: int = 480) -> np.ndarray:
    return np.full((height, width, 3), 90, np.uint8)


TINY = NetworkSize((4, 8, 8, 8, 8), 8)
SETTINGS = TrackerSettings(centre_term=CentreTerm.SIGMOID)


def test_a_hit_in_the_centre_cell_leaves_the_box_where_it_is() -> None:
    tracker = SiamAPNTracker(ScriptedEngine(_maps_with_one_hit(10, 10)), SETTINGS)
    tracker.init(_frame(_blank()), Box(300, 200, 40, 40))
    box = tracker.update(_frame(_blank(), 1))[0].box
    assert (box.cx_px, box.cy_px) == (pytest.approx(300), pytest.approx(200))
    assert (box.w_px, box.h_px) == (pytest.approx(40, rel=1e-3), pytest.approx(40, rel=1e-3))


@pytest.mark.parametrize(
    ("row", "column", "sx", "sy"), [(10, 14, 1, 0), (10, 6, -1, 0), (14, 10, 0, 1), (6, 10, 0, -1)]
)
def test_cells_map_to_frame_pixels(row: int, column: int, sx: int, sy: int) -> None:
    tracker = SiamAPNTracker(ScriptedEngine(_maps_with_one_hit(row, column)), SETTINGS)
    tracker.init(_frame(_blank()), Box(300, 200, 40, 40))
    box = tracker.update(_frame(_blank(), 1))[0].box
    step = 4 * 8 * 80 / 127  # four cells of 8 px in a crop where 80 frame pixels are 127
    assert (box.cx_px - 300, box.cy_px - 200) == (pytest.approx(sx * step), pytest.approx(sy * step))


def test_the_search_crop_is_centred_on_the_hint() -> None:
    image = _blank()
    cv2.circle(image, (400, 260), 4, (255, 255, 255), -1)
    engine = ScriptedEngine(_maps_with_one_hit(10, 10))
    tracker = SiamAPNTracker(engine, SETTINGS)
    tracker.init(_frame(_blank()), Box(360, 240, 40, 40))
    box = tracker.update(_frame(image, 1), SearchHint((400.5, 260.5), (1, 0, 1)))[0].box
    assert (box.cx_px, box.cy_px) == (pytest.approx(400.5), pytest.approx(260.5))
    assert engine.crops[-1][143, 143].tolist() == [255, 255, 255]


def test_a_wild_or_broken_hint_cannot_throw_the_window_away() -> None:
    tracker = SiamAPNTracker(ScriptedEngine(_maps_with_one_hit(10, 10)), SETTINGS)
    tracker.init(_frame(_blank()), Box(300, 200, 40, 40))
    for centre in ((float("nan"), 200.0), (float("inf"), 200.0)):
        box = tracker.update(_frame(_blank(), 1), SearchHint(centre, (1, 0, 1)))[0].box
        assert (box.cx_px, box.cy_px) == (pytest.approx(300), pytest.approx(200))
    # Far outside there is nothing to see; the box is held in the picture, and the next hint leads back.
    box = tracker.update(_frame(_blank(), 1), SearchHint((5000.0, 200.0), (1, 0, 1)))[0].box
    assert (box.cx_px, box.cy_px) == (640.0, pytest.approx(200))
    box = tracker.update(_frame(_blank(), 1), SearchHint((300.0, 200.0), (1, 0, 1)))[0].box
    assert (box.cx_px, box.cy_px) == (pytest.approx(300), pytest.approx(200))


def test_scale_of_the_hint_widens_the_search() -> None:
    maps = _maps_with_one_hit(10, 18)
    for scale, expected in ((1.0, 64 * 80 / 127), (2.0, 128 * 80 / 127)):
        tracker = SiamAPNTracker(ScriptedEngine(maps), SETTINGS)
        tracker.init(_frame(_blank()), Box(300, 200, 40, 40))
        box = tracker.update(_frame(_blank(), 1), SearchHint((300, 200), (1, 0, 1), scale))[0].box
        assert box.cx_px - 300 == pytest.approx(expected)


@pytest.mark.parametrize(
    ("box", "word"),
    [
        (Box(float("nan"), 10, 20, 20), "finite"),
        (Box(100, 100, float("inf"), 20), "finite"),
        (Box(100, 100, 3.9, 20), "4 px"),
        (Box(100, 100, 20, -5), "4 px"),
        (Box(5, 100, 20, 20), "outside"),
        (Box(635, 100, 20, 20), "outside"),
        (Box(2000, 100, 20, 20), "outside"),
    ],
)
def test_impossible_boxes_are_refused(box: Box, word: str) -> None:
    tracker = SiamAPNTracker(ScriptedEngine(_maps_with_one_hit(10, 10)), SETTINGS)
    with pytest.raises(ValueError, match=word):
        tracker.init(_frame(_blank()), box)


def test_misuse_is_told() -> None:
    tracker = SiamAPNTracker(ScriptedEngine(_maps_with_one_hit(10, 10)), SETTINGS)
    with pytest.raises(RuntimeError, match="before init"):
        tracker.update(_frame(_blank()))
    with pytest.raises(ValueError, match="BGR uint8"):
        tracker.init(_frame(np.zeros((10, 10), np.uint8)), Box(5, 5, 5, 5))
    engine = TorchEngine(SiamAPNpp(SIZES["s"]), Precision.FP32, "cpu")
    with pytest.raises(RuntimeError, match="set_exemplar"):
        engine.search(np.zeros((287, 287, 3), np.uint8))
    if not torch.cuda.is_available():
        with pytest.raises(ValueError, match="cuda"):
            TorchEngine(SiamAPNpp(SIZES["s"]), Precision.FP32, "cuda")


def test_the_engine_leaves_the_processors_arithmetic_as_it_was() -> None:
    smallest_normal = float.fromhex("0x1p-1022")
    assert smallest_normal / 2 > 0.0
    engine = TorchEngine(SiamAPNpp(SIZES["s"]), Precision.FP32, "cpu")
    engine.set_exemplar(np.zeros((127, 127, 3), np.uint8))
    engine.search(np.zeros((287, 287, 3), np.uint8))
    assert smallest_normal / 2 > 0.0  # denormals are flushed inside the network only


def test_random_weights_on_1000_random_frames_stay_finite_and_bounded() -> None:
    torch.manual_seed(3)
    network = SiamAPNpp(TINY).eval()
    for parameter in network.parameters():
        parameter.data = torch.randn_like(parameter) * 0.2  # wild: negative anchors, huge deltas, overflowing scores
    engine = TorchEngine(network, Precision.FP32, "cpu")
    tracker = SiamAPNTracker(engine, TrackerSettings(search_px=223))
    rng = np.random.default_rng(3)
    noise = rng.integers(0, 256, (8, 96, 128, 3), np.uint8)
    tracker.init(_frame(noise[0]), Box(64, 48, 30, 20))
    seen = 0
    for k in range(1, 1001):
        for candidate in tracker.update(_frame(noise[k % 8], k)):
            seen += 1
            box = candidate.box
            assert box.is_valid
            assert 0 <= box.cx_px <= 128
            assert 0 <= box.cy_px <= 96
            assert 4 <= box.w_px <= 128
            assert 4 <= box.h_px <= 96
            assert 0 <= candidate.score <= 1
            assert 0 <= candidate.similarity <= 1
            assert np.isfinite(candidate.peak)
            assert candidate.evidence is not None
            assert -1 <= (candidate.evidence.exemplar or 0.0) <= 1
    assert seen > 100


def _square_on_noise(cx: int, cy: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    image = cv2.GaussianBlur(rng.integers(0, 256, (360, 480, 3), np.uint8), (0, 0), 3)
    cv2.rectangle(image, (cx - 18, cy - 12), (cx + 17, cy + 11), (40, 40, 210), -1)
    cv2.rectangle(image, (cx - 8, cy - 9), (cx + 2, cy + 8), (230, 220, 60), -1)
    return image


@pytest.mark.parametrize("precision", ["fp32", "bf16"])
def test_the_embedded_weights_follow_a_moving_patch(precision: str) -> None:
    built = build_tracker("s", precision, "cpu")
    assert built.engine.endswith(precision)
    tracker = built.tracker
    tracker.init(_frame(_square_on_noise(200, 180)), Box(200, 180, 36, 24))
    for k in range(1, 6):
        cx, cy = 200 + 6 * k, 180 - 3 * k
        best = tracker.update(_frame(_square_on_noise(cx, cy), k))[0]
        assert abs(best.box.cx_px - cx) < 6
        assert abs(best.box.cy_px - cy) < 6
        assert best.box.iou(Box(cx, cy, 36, 24)) > 0.5
        assert best.score > 0.5


def test_bf16_agrees_with_fp32() -> None:
    rng = np.random.default_rng(5)
    z, x = rng.integers(0, 256, (127, 127, 3), np.uint8), rng.integers(0, 256, (287, 287, 3), np.uint8)
    from tracker.weights.store import load

    maps = []
    for precision in (Precision.FP32, Precision.BF16):
        engine = TorchEngine(load("s").network(), precision, "cpu")
        engine.set_exemplar(z)
        maps.append(engine.search(x))
    for field in ("cls1", "cls2", "cls3", "loc", "anchor"):
        a, b = getattr(maps[0], field).ravel(), getattr(maps[1], field).ravel()
        assert np.corrcoef(a, b)[0, 1] > 0.98, field
