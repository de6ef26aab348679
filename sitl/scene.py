"""What the parts of the simulator hand to each other: where the camera is, and what is true in its picture.

World axes are NED with the origin on the ground: north, east, down in metres, so a height is a negative down. Angles:
roll right side down +, pitch nose up +, yaw clockwise from above +, in the order yaw, pitch, roll. Pixels as in
tracker/box.py: pixel (i, j) covers [i, i+1), the middle of a picture of width W is at W/2.
"""

from __future__ import annotations

from dataclasses import dataclass

from tracker.box import Box

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class CameraModel:
    """A pinhole camera with square pixels and its principal point in the middle."""

    width_px: int = 640
    height_px: int = 480
    hfov_rad: float = 1.1519173063162575  # 66 degrees, a usual wide lens
    exposure_s: float = 0.004  # bright day; long enough to blur when the gimbal turns fast


@dataclass(frozen=True, slots=True)
class CameraPose:
    """Where the camera is and how it moves at one instant.

    The angles are those of the optical axes as FRD (x forward along the optical axis, y right, z down in the picture).
    `rates_rad_s` are about these axes; `vel_ned_m_s` is the camera's velocity in NED.
    """

    pos_ned_m: Vector
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    rates_rad_s: Vector = (0.0, 0.0, 0.0)
    vel_ned_m_s: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class ObjectTruth:
    """What is true of one object in one picture; None where it has no place in it.

    `amodal`: box of the whole silhouette, also behind occluders and beyond the border; None when (partly) behind the
    camera. `visible`: box of the visible pixels. `visibility`: visible share of the silhouette inside the picture, 0
    when nothing of it is inside. `truncation`: share of the amodal box beyond the border. `centre_px`: projection of
    the object's middle. `range_m`: from the camera to that middle.
    """

    name: str
    amodal: Box | None
    visible: Box | None
    visibility: float
    truncation: float
    centre_px: tuple[float, float] | None
    range_m: float
