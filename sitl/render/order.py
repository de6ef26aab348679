"""Who is drawn first: upright boxes sorted so that nothing is drawn over what lies before it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IndexArray = npt.NDArray[np.intp]

SLACK_M = 1e-3  # boxes that touch count as apart


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """Upright boxes: `centre` (N, 3) NED, `half` (N, 3) along their own axes, `yaw` (N,)."""

    centre: FloatArray
    half: FloatArray
    yaw: FloatArray

    @classmethod
    def stack(cls, parts: list[tuple[FloatArray, FloatArray, float]]) -> Boxes:
        """From single boxes."""
        if not parts:
            return cls(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
        return cls(np.array([p[0] for p in parts]), np.array([p[1] for p in parts]), np.array([p[2] for p in parts]))

    def joined(self, other: Boxes) -> Boxes:
        """These and then the others."""
        return Boxes(
            np.concatenate([self.centre, other.centre]),
            np.concatenate([self.half, other.half]),
            np.concatenate([self.yaw, other.yaw]),
        )

    def corners(self) -> FloatArray:
        """(N, 8, 3) NED."""
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
        local = self.half[:, None] * signs
        c, s = np.cos(self.yaw)[:, None], np.sin(self.yaw)[:, None]
        north = local[..., 0] * c - local[..., 1] * s
        east = local[..., 0] * s + local[..., 1] * c
        return self.centre[:, None] + np.stack([north, east, local[..., 2]], axis=-1)


def hiding(boxes: Boxes, first: IndexArray, second: IndexArray, eye: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Whether `first[i]` may hide part of `second[i]` from the eye, and the reverse.

    One cannot hide another when a face of either box has the other and the eye on one side and the one on the other.
    """
    first_hides = np.ones(len(first), dtype=bool)
    second_hides = np.ones(len(first), dtype=bool)
    c, s = np.cos(boxes.yaw), np.sin(boxes.yaw)
    at_eye = _along_axes(eye - boxes.centre, c, s)
    for owner, other, owner_hides, other_hides in (
        (first, second, first_hides, second_hides),
        (second, first, second_hides, first_hides),
    ):
        # Everything in the owner's frame: it reaches from -half to +half.
        half = boxes.half[owner]
        middle = _along_axes(boxes.centre[other] - boxes.centre[owner], c[owner], s[owner])
        turn = boxes.yaw[other] - boxes.yaw[owner]
        ct, st = np.abs(np.cos(turn)), np.abs(np.sin(turn))
        size = boxes.half[other]
        reach = np.stack([size[:, 0] * ct + size[:, 1] * st, size[:, 0] * st + size[:, 1] * ct, size[:, 2]], axis=1)
        gap = np.abs(middle) - reach
        apart = gap >= half - SLACK_M
        eye_at = at_eye[owner] * np.where(middle >= 0, 1.0, -1.0)
        owner_hides &= ~(apart & (eye_at >= half - SLACK_M)).any(axis=1)
        other_hides &= ~(apart & (eye_at <= gap + SLACK_M)).any(axis=1)
    return first_hides, second_hides


def _along_axes(points: FloatArray, c: FloatArray, s: FloatArray) -> FloatArray:
    return np.stack([points[:, 0] * c + points[:, 1] * s, points[:, 1] * c - points[:, 0] * s, points[:, 2]], axis=1)


def paint_order(boxes: Boxes, low_px: FloatArray, high_px: FloatArray, eye: FloatArray) -> list[int]:
    """Indices from the first drawn to the last; only boxes whose pictures (`low_px`, `high_px`) overlap matter."""
    distance = np.linalg.norm(boxes.centre - eye, axis=1)
    far_first = np.argsort(-distance, kind="stable")
    overlap = np.all((low_px[:, None] < high_px[None]) & (low_px[None] < high_px[:, None]), axis=2)
    first, second = np.nonzero(np.triu(overlap, 1))
    forward, backward = hiding(boxes, first, second, eye)
    # Where both may hide the other (boxes that touch), the nearer one is drawn later.
    both = forward & backward
    nearer = distance[first] < distance[second]
    behind: list[list[int]] = [[] for _ in range(len(distance))]  # what has to be drawn before
    forward &= ~both | nearer
    backward &= ~both | ~nearer
    for a, b in zip(first[forward].tolist(), second[forward].tolist(), strict=True):
        behind[a].append(b)
    for a, b in zip(first[backward].tolist(), second[backward].tolist(), strict=True):
        behind[b].append(a)
    return _sorted(behind, [int(i) for i in far_first])


def _sorted(behind: list[list[int]], start: list[int]) -> list[int]:
    """Depth-first: everything behind an item comes before it; a circle is cut where it is met."""
    order: list[int] = []
    state = [0] * len(behind)
    for root in start:
        stack = [(root, iter(behind[root]))] if not state[root] else []
        while stack:
            node, rest = stack[-1]
            state[node] = 1
            following = next((i for i in rest if not state[i]), None)
            if following is None:
                state[node] = 2
                order.append(node)
                stack.pop()
            else:
                state[following] = 1
                stack.append((following, iter(behind[following])))
    return order
