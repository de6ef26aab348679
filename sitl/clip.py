"""A short clip that the program draws itself: textured ground, a moving car, a tree that hides it for a second.

    python -m sitl.clip --out FOLDER        writes clip.mp4 and groundtruth_rect.txt (x,y,w,h; NaN while hidden)

The camera looks straight down from a drifting drone, so the whole picture moves as well.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from tracker.box import Box

ImageU8 = npt.NDArray[np.uint8]

WIDTH_PX, HEIGHT_PX = 640, 360
FPS = 30.0
DURATION_S = 10.0
WORLD_PX = (1400, 900)  # one world pixel is one image pixel
SUPERSAMPLE = 4  # the car is drawn larger and averaged down: smooth edges at sub-pixel positions
CAR_PX = (46, 24)
CAR_SPEED_PX_S = 62.0
TREE_AT_S = 5.0  # the middle of the time behind the tree
TREE_RADIUS_PX = 52
HIDDEN_BELOW = 0.15  # visible share under which the target counts as absent
NOISE_SIGMA = 3.0


@dataclass(frozen=True, slots=True)
class ClipFrame:
    """A picture with the car's whole (amodal) box in it and the share of the car that can be seen."""

    image_bgr_u8: ImageU8
    box: Box
    visible: float


def _octaves(rng: np.random.Generator, size: tuple[int, int]) -> npt.NDArray[np.float32]:
    """Natural-looking noise, about 1/f: many scales, each half as strong as the next coarser one."""
    width, height = size
    total = np.zeros((height, width), np.float32)
    for cells, weight in ((6, 1.0), (14, 0.7), (40, 0.5), (110, 0.35), (300, 0.25), (900, 0.2)):
        small = rng.standard_normal((max(2, cells * height // width), cells)).astype(np.float32)
        total += weight * cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC)
    return total / float(total.std())


def _ground(rng: np.random.Generator) -> npt.NDArray[np.float32]:
    texture = _octaves(rng, WORLD_PX)[..., None]
    tint = _octaves(rng, WORLD_PX)[..., None]
    grass = np.array([52, 92, 78], np.float32) + texture * 13 + tint * np.array([4, 9, 7], np.float32)
    height = WORLD_PX[1]
    asphalt = np.array([104, 104, 106], np.float32) + texture * 5
    rows = np.arange(height, dtype=np.float32)[:, None, None]
    distance = np.abs(rows - _road_y(np.arange(WORLD_PX[0], dtype=np.float32))[None, :, None])
    ground = np.where(distance < 34, asphalt, grass)
    ground = np.where((distance > 34) & (distance < 38), np.float32(150) + texture * 8, ground)
    dashes = (np.arange(WORLD_PX[0])[None, :, None] % 60 < 30) & (distance < 1.6)
    ground = np.where(dashes, np.float32(205), ground)
    for _ in range(60):  # bushes and stones
        x, y = int(rng.integers(0, WORLD_PX[0])), int(rng.integers(0, height))
        if abs(y - float(_road_y(x))) > 60:
            shade = float(rng.uniform(0.45, 1.25))
            cv2.circle(ground, (x, y), int(rng.integers(3, 12)), (40 * shade, 84 * shade, 60 * shade), -1, cv2.LINE_AA)
    return np.asarray(ground, dtype=np.float32)


def _road_y(x: npt.ArrayLike) -> npt.NDArray[np.float32]:
    return np.asarray(450 + 60 * np.sin(np.asarray(x, np.float32) / 260), dtype=np.float32)


def _car_sprite() -> npt.NDArray[np.float32]:
    """The car from above, pointing right, SUPERSAMPLE times too large; the fourth channel is coverage."""
    length, width = CAR_PX[0] * SUPERSAMPLE, CAR_PX[1] * SUPERSAMPLE
    sprite = np.zeros((width, length, 4), np.float32)
    body, glass, dark = (38, 40, 196, 255), (70, 52, 44, 255), (26, 28, 150, 255)

    def part(x1: float, y1: float, x2: float, y2: float, colour: tuple[int, int, int, int]) -> None:
        corner = (round(x1 * length), round(y1 * width))
        cv2.rectangle(sprite, corner, (round(x2 * length) - 1, round(y2 * width) - 1), colour, -1)

    part(0.02, 0.04, 0.98, 0.96, body)
    part(0.62, 0.12, 0.76, 0.88, glass)
    part(0.10, 0.16, 0.20, 0.84, glass)
    part(0.24, 0.08, 0.60, 0.14, glass)
    part(0.24, 0.86, 0.60, 0.92, glass)
    part(0.78, 0.10, 0.80, 0.90, dark)
    part(0.95, 0.10, 0.99, 0.26, (190, 235, 245, 255))
    part(0.95, 0.74, 0.99, 0.90, (190, 235, 245, 255))
    return sprite


def _tree(rng: np.random.Generator) -> npt.NDArray[np.float32]:
    """A crown of leaves, opaque in the middle and ragged at the edge."""
    side = 2 * TREE_RADIUS_PX + 40
    sprite = np.zeros((side, side, 4), np.float32)
    for _ in range(900):
        radius = TREE_RADIUS_PX * float(np.sqrt(rng.uniform()))
        angle = float(rng.uniform(0, 2 * np.pi))
        at = (round(side / 2 + radius * np.cos(angle)), round(side / 2 + radius * np.sin(angle)))
        shade = float(rng.uniform(0.5, 1.2)) * (1.15 - 0.4 * (at[0] + at[1]) / (2 * side))
        cv2.circle(sprite, at, int(rng.integers(4, 9)), (30 * shade, 96 * shade, 48 * shade, 255), -1, cv2.LINE_AA)
    return sprite


def _paste(
    canvas: npt.NDArray[np.float32], sprite: npt.NDArray[np.float32], matrix: npt.NDArray[np.float64]
) -> ImageU8:
    """Blend a sprite into the canvas through a 2x3 matrix; returns its coverage, 0..255."""
    size = (canvas.shape[1], canvas.shape[0])
    layer = cv2.warpAffine(sprite, matrix, size, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_CONSTANT)
    alpha = layer[..., 3:] / 255
    # Colours come premultiplied out of the warp, since the border is black and transparent.
    canvas *= 1 - alpha
    canvas += layer[..., :3]
    return np.asarray(layer[..., 3], dtype=np.uint8)


class Clip:
    """The scene; `frame(k)` draws frame k. The same seed gives the same clip."""

    def __init__(self, seed: int = 7) -> None:
        rng = np.random.default_rng(seed)
        self._ground = _ground(rng)
        self._tree_sprite = _tree(rng)
        blur = (SUPERSAMPLE * 2 - 1, SUPERSAMPLE * 2 - 1)
        padded = cv2.copyMakeBorder(_car_sprite(), 12, 12, 12, 12, cv2.BORDER_CONSTANT)
        self._car_sprite = np.asarray(cv2.GaussianBlur(padded, blur, 0), dtype=np.float32)
        self._noise = [rng.normal(0, NOISE_SIGMA, (HEIGHT_PX, WIDTH_PX, 3)).astype(np.float32) for _ in range(7)]
        self.count = round(FPS * DURATION_S)

    def _car(self, t_s: float) -> tuple[float, float, float]:
        x = 330 + CAR_SPEED_PX_S * t_s
        y = float(_road_y(x)) + 14
        slope = 60 / 260 * float(np.cos(x / 260))
        return x, y, float(np.arctan(slope))

    def frame(self, k: int) -> ClipFrame:
        """Picture k with its truth."""
        t_s = k / FPS
        # The drone drifts after the car a little late and sways.
        cam_x = 60 + 0.9 * CAR_SPEED_PX_S * t_s + 10 * np.sin(1.1 * t_s)
        cam_y = 270 + 45 * np.sin(0.45 * t_s) + 4 * np.sin(2.3 * t_s)
        view = np.array([[1.0, 0.0, -cam_x], [0.0, 1.0, -cam_y]])
        ground = cv2.warpAffine(self._ground, view, (WIDTH_PX, HEIGHT_PX), flags=cv2.INTER_LINEAR)
        canvas = np.asarray(ground, dtype=np.float32)
        car = self._car(t_s)
        self._shadow(canvas, car, view)
        car_cover = _paste(canvas, self._car_sprite, self._car_matrix(car, view))
        tree_x, tree_y, _ = self._car(TREE_AT_S)
        half = self._tree_sprite.shape[0] / 2
        tree_view = view + np.array([[0, 0, tree_x - half + 4], [0, 0, tree_y - half - 2]])
        tree_cover = _paste(canvas, self._tree_sprite, tree_view)
        image = cv2.GaussianBlur(canvas, (3, 3), 0.6) + self._noise[k % len(self._noise)]
        covered = car_cover > 127
        visible = float((covered & (tree_cover < 128)).sum() / max(1, covered.sum()))
        return ClipFrame(np.clip(image, 0, 255).astype(np.uint8), self._box(covered), visible)

    def _car_matrix(self, car: tuple[float, float, float], view: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        x, y, heading = car
        height, width = self._car_sprite.shape[:2]
        c, s = np.cos(heading) / SUPERSAMPLE, np.sin(heading) / SUPERSAMPLE
        dx = x + view[0, 2] - c * width / 2 + s * height / 2
        dy = y + view[1, 2] - s * width / 2 - c * height / 2
        return np.array([[c, -s, dx], [s, c, dy]])

    def _shadow(
        self, canvas: npt.NDArray[np.float32], car: tuple[float, float, float], view: npt.NDArray[np.float64]
    ) -> None:
        sprite = self._car_sprite.copy()
        sprite[..., :3] = 0
        sprite[..., 3] *= 0.5
        _paste(canvas, sprite, self._car_matrix((car[0] + 5, car[1] + 6, car[2]), view))

    @staticmethod
    def _box(covered: npt.NDArray[np.bool_]) -> Box:
        rows, columns = np.flatnonzero(covered.any(1)), np.flatnonzero(covered.any(0))
        if not rows.size:
            return Box(np.nan, np.nan, np.nan, np.nan)
        return Box.from_corners(float(columns[0]), float(rows[0]), float(columns[-1]) + 1, float(rows[-1]) + 1)


def write_clip(folder: Path, seed: int = 7) -> tuple[Path, Path]:
    """Write clip.mp4 and groundtruth_rect.txt into `folder`; returns both paths. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    video, truth = folder / "clip.mp4", folder / "groundtruth_rect.txt"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*"mp4v"), FPS, (WIDTH_PX, HEIGHT_PX))
    if not writer.isOpened():
        raise OSError(f"{video}: cannot be written")
    clip, rows = Clip(seed), []
    for k in range(clip.count):
        frame = clip.frame(k)
        writer.write(frame.image_bgr_u8)
        seen = frame.visible >= HIDDEN_BELOW and frame.box.is_valid
        rows.append(",".join(f"{v:.2f}" for v in frame.box.to_xywh()) if seen else "nan,nan,nan,nan")
    writer.release()
    truth.write_text("\n".join(rows) + "\n")
    return video, truth


def main(argv: list[str] | None = None) -> int:
    """Draw the clip."""
    parser = argparse.ArgumentParser(prog="python -m sitl.clip", description=__doc__)
    parser.add_argument("--out", required=True, type=Path)
    parser.add_argument("--seed", type=int, default=7)
    arguments = parser.parse_args(argv)
    try:
        video, truth = write_clip(arguments.out, arguments.seed)
    except OSError as error:
        print(f"sitl.clip: error: {error}", file=sys.stderr)
        return 2
    print(f"drew {video} and {truth}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
