"""Who is drawn first: upright boxes sorted so that nothing is drawn over what lies before it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IndexArray = npt.NDArray[np.intp]

SLACK_M = 1e-3  # boxes that touch count as apart
SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)  # of a box's corners


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

    def chosen(self, index: IndexArray) -> Boxes:
        """Some of them."""
        return Boxes(self.centre[index], self.half[index], self.yaw[index])

    def corners(self) -> FloatArray:
        """(8, N, 3) NED."""
        local = self.half * SIGNS[:, None]
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        found = np.empty_like(local)
        found[..., 0] = local[..., 0] * c - local[..., 1] * s
        found[..., 1] = local[..., 0] * s + local[..., 1] * c
        found[..., 2] = local[..., 2]
        found += self.centre
        return found


def hiding(boxes: Boxes, first: IndexArray, second: IndexArray, eye: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Whether `first[i]` may hide part of `second[i]` from the eye, and the reverse.

    One cannot hide another when a face of either box has the other and the eye on one side and the one on the other.
    """
    first_hides = np.ones(len(first), dtype=bool)
    second_hides = np.ones(len(first), dtype=bool)
    c, s = np.cos(boxes.yaw), np.sin(boxes.yaw)
    # Axes come first, (3, n): numpy is slow along short last axes.
    at_eye = _along_axes((eye - boxes.centre).T, c, s)
    centre, halves = np.ascontiguousarray(boxes.centre.T), np.ascontiguousarray(boxes.half.T)
    for owner, other, owner_hides, other_hides in (
        (first, second, first_hides, second_hides),
        (second, first, second_hides, first_hides),
    ):
        # Everything in the owner's frame: it reaches from -half to +half.
        edge = halves[:, owner] - SLACK_M
        middle = _along_axes(centre[:, other] - centre[:, owner], c[owner], s[owner])
        # Cosine and sine of the turn from one to the other.
        ct = np.abs(c[other] * c[owner] + s[other] * s[owner])
        st = np.abs(s[other] * c[owner] - c[other] * s[owner])
        size = halves[:, other]
        gap = np.abs(middle)
        gap[0] -= size[0] * ct + size[1] * st
        gap[1] -= size[0] * st + size[1] * ct
        gap[2] -= size[2]
        apart = gap >= edge
        eye_at = np.copysign(1.0, middle) * at_eye[:, owner]
        owner_hides &= ~(apart & (eye_at >= edge)).any(axis=0)
        other_hides &= ~(apart & (eye_at <= gap + SLACK_M)).any(axis=0)
    return first_hides, second_hides


def _along_axes(points: FloatArray, c: FloatArray, s: FloatArray) -> FloatArray:
    """Points (3, n) along the axes of boxes."""
    return np.stack([points[0] * c + points[1] * s, points[1] * c - points[0] * s, points[2]])


def paint_order(boxes: Boxes, low_px: FloatArray, high_px: FloatArray, eye: FloatArray) -> list[int]:
    """Indices from the first drawn to the last; only boxes whose pictures (`low_px`, `high_px`) overlap matter."""
    distance = np.linalg.norm(boxes.centre - eye, axis=1)
    far_first = np.argsort(-distance, kind="stable")
    (left, top), (right, bottom) = low_px.T, high_px.T
    before, above = left[:, None] < right, top[:, None] < bottom
    first, second = np.nonzero(np.triu(before & before.T & above & above.T, 1))
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
    return _sorted(behind, far_first.tolist())


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
