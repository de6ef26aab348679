"""How honest a tracker is about its target, and whether it gets it back.

A frame is *on target* when the target is present and the reported box overlaps it by 0.2 or more, and *followed* when
it is also LOCKED. A *true loss* is a frame that is not on target after one that was followed: the target has become
absent, whatever the status says, or the box has left it although the status still says LOCKED. A tracker that has left
LOCKED by then has lost nothing silently. The next loss can only come after the target was followed again.

A *chance* to get the target back is a frame from which on it is to be found: one in which it is present after it was
absent, or one of a true loss at which it is present.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from tracker.benchmark.scores import ON_TARGET_IOU, Flags, on_target, overlaps
from tracker.benchmark.shares import Share
from tracker.box import Box
from tracker.messages import TargetStatus

LEAVE_WITHIN_S = 0.7  # not LOCKED by then after a true loss (docs/interfaces.md, section 4)
BACK_WITHIN_FRAMES = 30  # as the field reports re-acquisition, whatever the frame rate
BACK_WITHIN_S = 1.0
USEFUL_IOU = 0.5  # a box that overlaps by more is right, so a useful tracker must say LOCKED


@dataclass(frozen=True, slots=True)
class LongTerm:
    """Counts of one sequence, or of several pooled.

    `false_confirmed`: LOCKED while not on target, of all frames. `honest_lock`: LOCKED, of the frames whose box
    overlaps the target by more than 0.5. `locked_after_loss_s`: for every true loss, how long the status stayed LOCKED
    after it; the end of the sequence, or the target followed again, ends the time. `left_in_time`: true losses after
    which the status left LOCKED within 0.7 s; those that ended otherwise before that are left out. `never_left`: true
    losses that the status never showed. `back_in_frames`, `back_in_s`: chances after which the target was followed
    within 30 frames, or 1 s; chances whose target leaves, or whose sequence ends, before that are left out.
    `wrong_writes`: boxes written to memory that were not on target.
    """

    false_confirmed: Share = field(default_factory=Share)
    honest_lock: Share = field(default_factory=Share)
    locked_after_loss_s: tuple[float, ...] = ()
    left_in_time: Share = field(default_factory=Share)
    never_left: int = 0
    back_in_frames: Share = field(default_factory=Share)
    back_in_s: Share = field(default_factory=Share)
    wrong_writes: Share = field(default_factory=Share)

    @property
    def losses(self) -> int:
        """Number of true losses."""
        return len(self.locked_after_loss_s)

    @property
    def leave_s(self) -> float | None:
        """Median time in LOCKED after a true loss; None without a loss."""
        return float(np.median(self.locked_after_loss_s)) if self.locked_after_loss_s else None

    def __add__(self, other: LongTerm) -> LongTerm:
        return LongTerm(
            self.false_confirmed + other.false_confirmed,
            self.honest_lock + other.honest_lock,
            self.locked_after_loss_s + other.locked_after_loss_s,
            self.left_in_time + other.left_in_time,
            self.never_left + other.never_left,
            self.back_in_frames + other.back_in_frames,
            self.back_in_s + other.back_in_s,
            self.wrong_writes + other.wrong_writes,
        )


def long_term(
    boxes: Sequence[Box | None],
    statuses: Sequence[TargetStatus],
    truth: Sequence[Box | None],
    fps: float,
    *,
    writes: Sequence[Box | None] | None = None,
    raw: bool = False,
) -> LongTerm:
    """Long-term counts of one sequence: a box, a status and a row of truth for each frame.

    `writes` has for each frame the box written to the tracker's memory, or None. `raw`: the tracker has no status of
    its own and counts as LOCKED in every frame. Raises ValueError when lengths differ or `fps` is not positive.
    """
    if not fps > 0:
        raise ValueError(f"fps {fps}: must be above 0")
    if len(statuses) != len(truth) or (writes is not None and len(writes) != len(truth)):
        raise ValueError(f"{len(statuses)} statuses, or the memory writes, against {len(truth)} rows of truth")
    locked = np.array([raw or s is TargetStatus.LOCKED for s in statuses], dtype=bool)
    found = overlaps(boxes, truth)
    present = np.isfinite(found)
    on = on_target(boxes, truth, ON_TARGET_IOU)
    right = present & (np.where(present, found, 0.0) > USEFUL_IOU)
    losses = _losses(locked, on, present)
    stays = [_stay(i, locked, on) for i in losses]
    stays_s = tuple(frames / fps for frames, _ in stays)
    starts = sorted({*_returns(present), *(i for i in losses if present[i])})
    return LongTerm(
        false_confirmed=Share(int((locked & ~on).sum()), len(locked)),
        honest_lock=Share(int((locked & right).sum()), int(right.sum())),
        locked_after_loss_s=stays_s,
        left_in_time=_left_in_time(stays, fps),
        never_left=sum(not left for _, left in stays),
        back_in_frames=_back(starts, BACK_WITHIN_FRAMES, locked & on, present),
        back_in_s=_back(starts, max(1, round(BACK_WITHIN_S * fps)), locked & on, present),
        wrong_writes=_wrong_writes(writes, truth),
    )


def pooled(of: Iterable[LongTerm]) -> LongTerm:
    """All sequences together: every frame, loss, chance and write of the same weight."""
    return sum(of, LongTerm())


def _losses(locked: Flags, on: Flags, present: Flags) -> list[int]:
    followed = locked & on
    return [i for i in range(1, len(on)) if followed[i - 1] and not on[i] and (locked[i] or not present[i])]


def _left_in_time(stays: Sequence[tuple[int, bool]], fps: float) -> Share:
    told = [left for frames, left in stays if frames / fps <= LEAVE_WITHIN_S and left]
    return Share(len(told), len(told) + sum(frames / fps > LEAVE_WITHIN_S for frames, _ in stays))


def _stay(start: int, locked: Flags, on: Flags) -> tuple[int, bool]:
    """Frames in LOCKED from a loss on, and whether the status was what ended them."""
    for i in range(start, len(on)):
        if not locked[i]:
            return i - start, True
        if on[i]:
            return i - start, False
    return len(on) - start, False


def _returns(present: Flags) -> list[int]:
    return [i for i in range(1, len(present)) if present[i] and not present[i - 1]]


def _back(starts: Sequence[int], window: int, followed: Flags, present: Flags) -> Share:
    whole = [i for i in starts if i + window <= len(present) and present[i : i + window].all()]
    return Share(sum(bool(followed[i : i + window].any()) for i in whole), len(whole))


def _wrong_writes(writes: Sequence[Box | None] | None, truth: Sequence[Box | None]) -> Share:
    written = [(w, t) for w, t in zip(writes, truth, strict=True) if w is not None] if writes is not None else []
    on = on_target([w for w, _ in written], [t for _, t in written])
    return Share(int((~on).sum()), len(written))
