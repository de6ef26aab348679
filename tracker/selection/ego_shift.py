"""How the picture moved between two frames: corners followed by optical flow, and the plane's motion they agree on."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from tracker.messages import Array

Grey = npt.NDArray[np.uint8]

MAX_CORNERS = 300
CORNER_QUALITY = 0.01
CORNER_GAP_SHARE = 0.02  # of the picture's width: spread over the picture, so that no one object has most of them
FLOW_WINDOW_PX = 21
FLOW_LEVELS = 3  # 2^3 * 10 px: follows 80 px from frame to frame
FLOW_STEPS = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.03)
INLIER_PX = 1.5  # of the working picture
LEAST_CORNERS = 12
LEAST_INLIER_SHARE = 0.4  # fewer agree: not one plane's motion, or the flow is lost
HOMOGRAPHY_FROM = 60  # corners; with fewer the eight numbers of a homography follow noise and four are estimated
SEED = 12345  # of OpenCV's RANSAC: the same pictures give the same motion


def estimate_motion(before: Grey, after: Grey) -> Array | None:
    """Homography (3, 3) from pixels of `before` to pixels of `after`; None when the ground cannot be followed.

    Pixels are OpenCV's, whose centres are whole numbers.
    """
    gap = max(4.0, CORNER_GAP_SHARE * before.shape[1])
    corners = cv2.goodFeaturesToTrack(before, MAX_CORNERS, CORNER_QUALITY, gap)
    if corners is None or len(corners) < LEAST_CORNERS:
        return None
    moved, found, _ = cv2.calcOpticalFlowPyrLK(
        before, after, corners, np.empty_like(corners), winSize=(FLOW_WINDOW_PX, FLOW_WINDOW_PX),
        maxLevel=FLOW_LEVELS, criteria=FLOW_STEPS,
    )  # fmt: skip
    kept = found.ravel() == 1
    if kept.sum() < LEAST_CORNERS:
        return None
    return _plane(corners.reshape(-1, 2)[kept], moved.reshape(-1, 2)[kept])


def _plane(a: npt.NDArray[np.float32], b: npt.NDArray[np.float32]) -> Array | None:
    cv2.setRNGSeed(SEED)
    if len(a) >= HOMOGRAPHY_FROM:
        matrix, inliers = cv2.findHomography(a, b, cv2.RANSAC, INLIER_PX)
    else:
        affine, inliers = cv2.estimateAffinePartial2D(a, b, method=cv2.RANSAC, ransacReprojThreshold=INLIER_PX)
        matrix = None if affine is None else np.vstack((affine, (0.0, 0.0, 1.0)))
    if matrix is None or inliers is None or not np.isfinite(matrix).all():
        return None
    if inliers.sum() < max(LEAST_CORNERS, LEAST_INLIER_SHARE * len(a)):
        return None
    return np.asarray(matrix, dtype=np.float64)


def moved_points(matrix: Array, points: Array) -> Array:
    """Points (n, 2) through a homography; points that it sends to infinity become NaN."""
    mapped = np.column_stack((points, np.ones(len(points)))) @ matrix.T
    depth = np.where(np.abs(mapped[:, 2:]) < 1e-9, np.nan, mapped[:, 2:])
    return np.asarray(mapped[:, :2] / depth)
