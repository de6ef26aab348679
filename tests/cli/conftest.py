"""Material for the command-line tests: a short clip as folder and as video, with truth."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import cv2
import pytest

from sitl.clip import FPS, HEIGHT_PX, WIDTH_PX, Clip
from uavfollow.__main__ import main

FRAMES = 24
TINY_RECIPE = """
name: tiny
description: four steps
start: {backbone: s}
sources:
  - {kind: folders, name: clip, path: train, frame_range: 10, min_side_px: 4}
pairing: {distractor: 0, patch: 0}
ema: 0.5
stages:
  - {pairs: 8, batch: 2, lr: 1e-4, warmup_pairs: 2}
validation:
  every_pairs: 1000
  max_frames: 3
  sources:
    - {kind: folders, name: held-out, path: val}
"""


@dataclass(frozen=True)
class Material:
    folder: Path
    video: Path
    truth: Path
    box: str


@pytest.fixture(scope="session")
def material(tmp_path_factory: pytest.TempPathFactory) -> Material:
    """24 frames of the drawn clip."""
    root = tmp_path_factory.mktemp("material")
    folder, video, truth = root / "images", root / "clip.mp4", root / "truth.txt"
    folder.mkdir()
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*"mp4v"), FPS, (WIDTH_PX, HEIGHT_PX))
    clip, rows = Clip(), []
    for k in range(FRAMES):
        frame = clip.frame(k)
        cv2.imwrite(str(folder / f"{k + 1}.jpg"), frame.image_bgr_u8)  # not padded: 10 must come after 9
        writer.write(frame.image_bgr_u8)
        rows.append(",".join(f"{v:.1f}" for v in frame.box.to_xywh()))
    writer.release()
    truth.write_text("\n".join(rows) + "\n")
    return Material(folder, video, truth, rows[0])


@dataclass(frozen=True)
class Result:
    code: int
    out: str
    err: str


@pytest.fixture
def cli(capfd: pytest.CaptureFixture[str]):
    """Run the command line in this process; captured are also lines that C libraries print."""

    def run(*arguments: object) -> Result:
        capfd.readouterr()
        code = main([str(a) for a in arguments])
        captured = capfd.readouterr()
        return Result(code, captured.out, captured.err)

    return run


@pytest.fixture(scope="module")
def data(material, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sequence to train on and one to validate on, and the recipe."""
    root = tmp_path_factory.mktemp("training")
    for place in ("train/a", "val/b"):
        (root / place).mkdir(parents=True)
        (root / place / "img").symlink_to(material.folder)
        shutil.copy(material.truth, root / place / "groundtruth_rect.txt")
    (root / "tiny.yaml").write_text(TINY_RECIPE)
    return root
