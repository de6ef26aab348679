"""From NED metres to pixels: the camera's axes, projection, clipping of polygons."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from sitl.scene import CameraModel, CameraPose

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

NEAR_M = 0.15  # nothing nearer to the lens is drawn
FARTHEST_M = 1e5  # a camera beyond is drawn from there, so that no number overflows
GUARD_PX = 3000.0  # polygons are clipped this far outside of the picture: cv2 takes 32-bit points


def camera_axes(roll_rad: float, pitch_rad: float, yaw_rad: float) -> FloatArray:
    """Rows: right, down (in the picture) and forward of the camera in NED."""
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    cy, sy = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array(
        [
            [cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr],
            [cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr],
            [cy * cp, sy * cp, -sp],
        ]
    )


class View:
    """A pinhole camera in one pose. Camera coordinates: x right, y down, z forward, in metres."""

    def __init__(self, camera: CameraModel, pose: CameraPose, scale: float = 1.0) -> None:
        self.width_px, self.height_px = camera.width_px, camera.height_px
        self.focal_px = camera.width_px / 2 / math.tan(camera.hfov_rad / 2)
        self.middle_px = np.array([camera.width_px / 2, camera.height_px / 2])
        reach = FARTHEST_M * scale
        self.position = np.clip(np.asarray(pose.pos_ned_m, np.float64), -reach, reach)
        self.axes = camera_axes(pose.roll_rad, pose.pitch_rad, pose.yaw_rad)
        self.near_m = NEAR_M * scale
        self.tilt_rad = pose.roll_rad if math.cos(pose.pitch_rad) >= 0 else pose.roll_rad + math.pi
        self.matrix = np.array(
            [
                [self.focal_px, 0.0, self.middle_px[0]],
                [0.0, self.focal_px, self.middle_px[1]],
                [0.0, 0.0, 1.0],
            ]
        )

    @property
    def height_m(self) -> float:
        """Above the ground."""
        return -float(self.position[2])

    def to_camera(self, points: FloatArray) -> FloatArray:
        """NED (..., 3) to camera coordinates (..., 3)."""
        # One product of matrices: numpy multiplies stacks of small ones one after the other.
        flat = (points - self.position).reshape(-1, 3) @ self.axes.T
        return np.asarray(flat.reshape(points.shape))

    def pixels(self, in_camera: FloatArray) -> FloatArray:
        """Camera coordinates (..., 3) with positive depth to pixels (..., 2)."""
        return np.asarray(self.focal_px * in_camera[..., :2] / in_camera[..., 2:] + self.middle_px)

    def may_see(self, in_camera: FloatArray) -> BoolArray:
        """False (N,) for sets of points (m, N, 3), camera coordinates, that all lie beyond one side of the picture."""
        x, y, z = in_camera.transpose(2, 0, 1)
        right, down = z * (self.middle_px[0] / self.focal_px), z * (self.middle_px[1] / self.focal_px)
        beyond = x > right, x < -right, y > down, y < -down
        return np.asarray(~np.logical_or.reduce([side.all(axis=0) for side in beyond]))

    def plane_to_pixels(self, origin: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
        """Homography (3, 3) from coordinates (s, t) on the plane origin + s u + t v to pixels."""
        columns = np.stack([u, v, origin - self.position], axis=1)
        return np.asarray(self.matrix @ (self.axes @ columns))

    def polygon(self, points: FloatArray) -> FloatArray | None:
        """Pixels (n, 2) of a convex polygon (m, 3) NED, cut at the near plane and far outside of the picture."""
        corners = self.to_camera(points)
        if float(corners[:, 2].min()) < self.near_m:
            corners = _cut(corners, corners[:, 2] - self.near_m)
        if len(corners) < 3:
            return None
        pixels = self.pixels(corners)
        if float(np.abs(pixels).max()) > GUARD_PX:
            pixels = _cut_sides(pixels)
        return pixels if len(pixels) >= 3 else None


def _cut(points: FloatArray, inside: FloatArray) -> FloatArray:
    """The part of a convex polygon where `inside` (linear over it, given at the corners) is not negative."""
    kept: list[FloatArray] = []
    count = len(points)
    for i in range(count):
        j = (i + 1) % count
        a, b = float(inside[i]), float(inside[j])
        if a >= 0:
            kept.append(points[i])
        if (a >= 0) != (b >= 0):
            kept.append(points[i] + (points[j] - points[i]) * (a / (a - b)))
    return np.array(kept) if kept else points[:0]


def _cut_sides(pixels: FloatArray) -> FloatArray:
    for axis in (0, 1):
        for sign in (1.0, -1.0):
            if len(pixels) >= 3:
                pixels = _cut(pixels, GUARD_PX - sign * pixels[:, axis])
    return pixels


def windows(view: View, low: FloatArray, high: FloatArray) -> list[tuple[int, int, int, int]]:
    """Whole pixels x0, y0, x1, y1 that cover boxes (n, 2) and lie in the picture; x1 <= x0 or y1 <= y0 when none."""
    edges = np.concatenate([np.floor(low), np.ceil(high)], axis=1)
    size = (view.width_px, view.height_px) * 2
    inside = np.minimum(np.maximum(edges, 0.0), size).astype(int)
    return [(x0, y0, x1, y1) for x0, y0, x1, y1 in inside.tolist()]


def window(view: View, low: FloatArray, high: FloatArray) -> tuple[int, int, int, int] | None:
    """The same for one box (2,), None when there are none."""
    (left, top), (right, bottom) = low.tolist(), high.tolist()
    x0, y0 = max(0, math.floor(left)), max(0, math.floor(top))
    x1, y1 = min(view.width_px, math.ceil(right)), min(view.height_px, math.ceil(bottom))
    return (x0, y0, x1, y1) if x1 > x0 and y1 > y0 else None
