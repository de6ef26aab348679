"""From the user's ONNX files to a tracker: tiny networks with the inputs and outputs of the real ones."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.tracker.nanotrack.fakes import frame, picture
from tracker.box import Box
from tracker.nanotrack.build import BACKBONE, HEAD, OnnxSession, build_tracker
from tracker.nanotrack.onnx_file import free_picture_size
from tracker.weights.errors import WeightsError

CHANNELS = 4
REAL = "UAVFOLLOW_NANOTRACK"  # the folder with the real files, which are not part of the project
# The published tracker's own code on the first 82 frames of UAVDT's S0601 gives this success AUC.
S0601_AUC = 0.7555


def _write(path: Path, nodes: list, inputs: dict[str, list[int]], outputs: dict[str, list[int]], weights: dict) -> None:
    onnx = pytest.importorskip("onnx", reason="needs onnx to make tiny networks")
    from onnx import TensorProto, helper, numpy_helper

    def values(shapes: dict[str, list[int]]) -> list:
        return [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in shapes.items()]

    tensors = [numpy_helper.from_array(np.asarray(array), name) for name, array in weights.items()]
    graph = helper.make_graph(nodes, "tiny", values(inputs), values(outputs), tensors)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    onnx.save(onnx.shape_inference.infer_shapes(model), str(path))


def _folder(root: Path, head_channels: int = CHANNELS) -> Path:
    """A backbone of two layers, declared for 255 px as the published one, and a head that looks at both its inputs."""
    from onnx import helper

    rng = np.random.default_rng(0)
    kernel = rng.normal(0, 1e-3, (CHANNELS, 3, 16, 16)).astype(np.float32)
    layers = [
        helper.make_node("Conv", ["input", "k"], ["mid"], strides=[16, 16], pads=[0, 0, 1, 1]),
        helper.make_node("Relu", ["mid"], ["output"]),
    ]
    _write(root / BACKBONE, layers, {"input": [1, 3, 255, 255]}, {"output": [1, CHANNELS, 16, 16]}, {"k": kernel})
    nodes = [
        helper.make_node("GlobalAveragePool", ["input1"], ["mean"]),
        helper.make_node("Mul", ["input2", "mean"], ["both"]),
        helper.make_node("Conv", ["both", "kc"], ["output1"]),
        helper.make_node("Conv", ["both", "ks"], ["output2"]),
    ]
    weights = {name: np.ones((n, head_channels, 2, 2), np.float32) for name, n in (("kc", 2), ("ks", 4))}
    inputs = {"input1": [1, head_channels, 8, 8], "input2": [1, head_channels, 16, 16]}
    _write(root / HEAD, nodes, inputs, {"output1": [1, 2, 15, 15], "output2": [1, 4, 15, 15]}, weights)
    return root


@pytest.fixture
def tiny(tmp_path: Path) -> Path:
    pytest.importorskip("onnxruntime", reason="needs onnxruntime (pip install 'uavfollow[nanotrack]')")
    pytest.importorskip("onnx", reason="needs onnx to make tiny networks")
    return _folder(tmp_path)


def test_a_folder_becomes_a_tracker(tiny: Path) -> None:
    built = build_tracker(str(tiny))
    assert built.confidence is None
    assert built.engine.startswith("onnxruntime")
    built.tracker.init(frame(picture((200, 180))), Box(200, 180, 32, 32))
    best = built.tracker.update(frame(picture((204, 180)), 1))[0]
    assert best.box.is_valid
    assert best.score == pytest.approx(0.5)  # both classes have the same weights


def test_the_backbone_takes_both_sizes(tiny: Path) -> None:
    session = OnnxSession(tiny / BACKBONE, tiny / HEAD)
    crop = np.random.default_rng(2).integers(0, 256, (255, 255, 3), np.uint8)
    small, large = session.features(crop[:127, :127]), session.features(crop)
    assert small.shape == (CHANNELS, 8, 8)
    assert large.shape == (CHANNELS, 16, 16)
    assert np.allclose(small[:, :7, :7], large[:, :7, :7], atol=1e-5)  # the same picture: the same features
    classes, sides = session.head(small, large)
    assert (classes.shape, sides.shape) == ((2, 15, 15), (4, 15, 15))


def test_the_identity_is_that_of_the_weights(tiny: Path, tmp_path: Path) -> None:
    assert build_tracker(str(tiny)).identity == build_tracker(str(tiny)).identity
    before = build_tracker(str(tiny)).identity
    (tiny / HEAD).write_bytes((tiny / HEAD).read_bytes() + b"\x1a\x01x")  # another producer's version
    assert build_tracker(str(tiny)).identity != before


def test_undeclared_are_height_and_width_only(tiny: Path) -> None:
    import onnx

    model = onnx.load_from_string(free_picture_size((tiny / BACKBONE).read_bytes()))
    for value, channels in ((model.graph.input[0], 3), (model.graph.output[0], CHANNELS)):
        sizes = [dim.dim_value if dim.HasField("dim_value") else None for dim in value.type.tensor_type.shape.dim]
        assert sizes == [1, channels, None, None]
    assert not model.graph.value_info
    assert len(model.graph.node) == 2
    assert len(model.graph.initializer) == 1


@given(st.binary(max_size=60))
def test_other_bytes_are_refused_or_kept(data: bytes) -> None:
    with suppress(ValueError):
        free = free_picture_size(data)
        assert free_picture_size(free) == free


def test_what_is_no_protocol_buffer_is_refused() -> None:
    whole = b"\x08\x07" + b"\x12\x04name" + b"\x1d\x00\x00\x00\x00" + b"\x21" + bytes(8)
    assert free_picture_size(whole) == whole
    for broken in (whole[:-1], b"\x12\x7fshort", b"\x08" + b"\xff" * 11, b"\x0b"):
        with pytest.raises(ValueError, match=r"field|number"):
            free_picture_size(broken)


@pytest.mark.parametrize("name", [BACKBONE, HEAD])
def test_a_missing_or_foreign_file_is_named(tiny: Path, name: str) -> None:
    (tiny / name).write_text("not a network")
    with pytest.raises(WeightsError, match=rf"{name}: cannot be read as an ONNX network"):
        build_tracker(str(tiny))
    (tiny / name).unlink()
    with pytest.raises(WeightsError, match=rf"{name}: no such file.*must hold {BACKBONE} and {HEAD}"):
        build_tracker(str(tiny))


def test_files_that_are_not_of_one_tracker_are_told_before_the_first_frame(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime", reason="needs onnxruntime (pip install 'uavfollow[nanotrack]')")
    pytest.importorskip("onnx", reason="needs onnx to make tiny networks")
    folder = _folder(tmp_path, head_channels=CHANNELS + 1)
    with pytest.raises(WeightsError, match=f"{HEAD}: does not go with {BACKBONE}"):
        build_tracker(str(folder))
    (folder / BACKBONE).write_bytes((folder / HEAD).read_bytes())
    with pytest.raises(WeightsError, match=f"{BACKBONE}: takes no picture of 127 px"):
        build_tracker(str(folder))


def test_without_weights_precision_or_runtime_it_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(WeightsError, match="nanotrack@FOLDER"):
        build_tracker("")
    for options in ({"precision": "bf16"}, {"device": "cuda"}):
        with pytest.raises(ValueError, match="fp32 on the cpu only"):
            build_tracker(str(tmp_path), **options)
    for name in (BACKBONE, HEAD):
        (tmp_path / name).write_bytes(b"")
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(WeightsError, match=r"pip install 'uavfollow\[nanotrack\]'"):
        build_tracker(str(tmp_path))


@pytest.fixture
def real() -> Path:
    folder = os.environ.get(REAL)
    if not folder:
        pytest.skip(f"the real ONNX files are not part of the project ({REAL} names no folder)")
    return Path(folder)


def test_the_real_files_follow_a_moving_patch(real: Path) -> None:
    tracker = build_tracker(str(real)).tracker
    rng = np.random.default_rng(0)
    ground = cv2.GaussianBlur(rng.integers(0, 256, (360, 480, 3), np.uint8), (0, 0), 3)

    def scene(cx: int, cy: int) -> np.ndarray:
        image = ground.copy()
        cv2.rectangle(image, (cx - 18, cy - 12), (cx + 17, cy + 11), (40, 40, 210), -1)
        cv2.rectangle(image, (cx - 8, cy - 9), (cx + 2, cy + 8), (230, 220, 60), -1)
        return image

    tracker.init(frame(scene(200, 180)), Box(200, 180, 36, 24))
    for k in range(1, 9):
        cx, cy = 200 + 6 * k, 180 - 3 * k
        best = tracker.update(frame(scene(cx, cy), k))[0]
        assert best.box.iou(Box(cx, cy, 36, 24)) > 0.6
        assert best.score > 0.9


def test_the_real_files_score_as_published(real: Path, sequences: Path) -> None:
    from tracker.benchmark.scores import score

    folder = sequences / "UAVDT_SOT" / "S0601"
    truth = [Box.from_xywh(*row) for row in np.loadtxt(folder / "groundtruth_rect.txt", delimiter=",")]
    images = sorted((folder / "img").iterdir())[: len(truth)]
    tracker, boxes = build_tracker(str(real)).tracker, [truth[0]]
    for k, path in enumerate(images):
        shot = frame(cv2.imread(str(path)), k)
        if k == 0:
            tracker.init(shot, truth[0])
        else:
            boxes.append(tracker.update(shot)[0].box)
    assert score(boxes, truth).auc == pytest.approx(S0601_AUC, abs=0.01)
