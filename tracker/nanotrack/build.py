"""From a folder with NanoTrack's two ONNX files to a tracker that runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tracker.messages import ImageU8
from tracker.nanotrack.onnx_file import free_picture_size
from tracker.nanotrack.settings import NanoSettings
from tracker.nanotrack.tracker import SEARCH_PX, NanoTracker
from tracker.siamapnpp.crop import EXEMPLAR_PX
from tracker.siamapnpp.decode import FloatMap
from tracker.weights.build import BuiltTracker, identity_of
from tracker.weights.card import sha256_of
from tracker.weights.errors import WeightsError

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

BACKBONE, HEAD = "nanotrack_backbone.onnx", "nanotrack_head.onnx"
DEFAULT_THREADS = 1  # of half a million weights: more threads wait for each other longer than they save
QUIET = 3  # errors only: the files hold unused weights, each of which is a line of warning
CLASSES, SIDES = 2, 4  # channels of the head's two outputs, by which they are told apart


def build_tracker(
    model: str, precision: str = "auto", device: str = "auto", threads: int | None = None
) -> BuiltTracker:
    """NanoTrack V3 from the folder `model`, in fp32 on the processor. Raises WeightsError or ValueError."""
    if not model:
        raise WeightsError(f"comes without weights; name a folder that holds {BACKBONE} and {HEAD}: nanotrack@FOLDER")
    if precision not in ("auto", "fp32") or device not in ("auto", "cpu"):
        raise ValueError(f"runs in fp32 on the cpu only, not in {precision} on {device}; leave the options out")
    paths = [Path(model) / name for name in (BACKBONE, HEAD)]
    for path in paths:
        if not path.is_file():
            raise WeightsError(f"{path}: no such file; the folder must hold {BACKBONE} and {HEAD}")
    session = OnnxSession(paths[0], paths[1], threads or DEFAULT_THREADS)
    settings = NanoSettings()
    hashes = [sha256_of(path) for path in paths]
    identity = identity_of(weights=hashes, settings=repr(settings), confidence=None, engine=session.name)
    return BuiltTracker(NanoTracker(session, settings), session.name, identity, None)


class OnnxSession:
    """Both networks on ONNX Runtime. Implements `tracker.nanotrack.tracker.Session`. Raises WeightsError."""

    def __init__(self, backbone: Path, head: Path, threads: int = DEFAULT_THREADS) -> None:
        self._backbone = _open(backbone, threads, any_size=True)
        self._head = _open(head, threads, any_size=False)
        self._input = self._backbone.get_inputs()[0].name
        self._inputs = [value.name for value in self._head.get_inputs()]
        self.name = f"onnxruntime-{_runtime().__version__}/cpu/fp32"
        self._try(backbone, head)

    def features(self, crop_bgr_u8: ImageU8) -> FloatMap:
        """Of a crop (S, S, 3): (C, S / 16, S / 16), rounded up."""
        image = np.ascontiguousarray(crop_bgr_u8.transpose(2, 0, 1)[None], dtype=np.float32)
        return np.asarray(self._backbone.run(None, {self._input: image})[0][0], dtype=np.float32)

    def head(self, exemplar: FloatMap, search: FloatMap) -> tuple[FloatMap, FloatMap]:
        """Class logits (2, M, M) and box sides (4, M, M) from the features of both crops."""
        both = dict(zip(self._inputs, (exemplar[None], search[None]), strict=True))
        maps = {out.shape[1]: np.asarray(out[0], dtype=np.float32) for out in self._head.run(None, both)}
        return maps[CLASSES], maps[SIDES]

    def _try(self, backbone: Path, head: Path) -> None:
        """Run both once: a file of another network is told now, not in the loop."""
        made = []
        for side_px in (EXEMPLAR_PX, SEARCH_PX):
            try:
                made.append(self.features(np.zeros((side_px, side_px, 3), np.uint8)))
            except Exception as error:
                raise WeightsError(
                    f"{backbone}: takes no picture of {side_px} px ({_one_line(error)}); give NanoTrack's backbone"
                ) from error
        try:
            classes, sides = self.head(made[0], made[1])
        except Exception as error:
            raise WeightsError(
                f"{head}: does not go with {backbone.name} ({_one_line(error)}); give the two of one NanoTrack"
            ) from error
        if classes.ndim != 3 or classes.shape[1:] != sides.shape[1:] or classes.shape[1] != classes.shape[2]:
            raise WeightsError(f"{head}: gives maps {classes.shape} and {sides.shape}, not (2, M, M) and (4, M, M)")


def _runtime() -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise WeightsError("NanoTrack needs ONNX Runtime; run: pip install 'uavfollow[nanotrack]'") from error
    return onnxruntime


def _open(path: Path, threads: int, any_size: bool) -> InferenceSession:
    runtime = _runtime()
    options = runtime.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = QUIET
    try:
        model = path.read_bytes()
        model = free_picture_size(model) if any_size else model
        return runtime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime has a class of its own for each way to be wrong
        raise WeightsError(f"{path}: cannot be read as an ONNX network ({_one_line(error)})") from error


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
