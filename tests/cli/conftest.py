"""Material for the command-line tests: a short clip as folder and as video, with truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import pytest

from sitl.clip import FPS, HEIGHT_PX, WIDTH_PX, Clip
from uavfollow.__main__ import main

FRAMES = 24


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
