"""A diagnosis in numbers and in words: hits, centre error, and lines of predicted against true size and shape."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tracker.box import Box
from tracker.messages import Array

HIT_IOU = 0.5
LEAST_PAIRS = 8  # of a line: fewer give a slope of chance
LEAST_SPREAD = 1e-3  # of the true values: without any, there is no slope
LOW_HITS, WEAK_SEQUENCE = 0.9, 0.7
LOW_SLOPE, HIGH_SLOPE = 0.8, 1.2
LOW_ASPECT_SLOPE = 0.6  # aspects vary little, so their slope is the last thing learned
LARGE_INTERCEPT = 0.1  # boxes a tenth too large or small everywhere
LARGE_SPREAD = 0.2  # of log-scale: noise of a fifth, more than most real changes from frame to frame
LARGE_ERROR_PX = 8.0  # the distance of two cells


@dataclass(frozen=True, slots=True)
class Measured:
    """One pair: the true box and the answer in search pixels from the crop's centre, the exemplar's size in its crop.

    `answer` is None when the network's output held nothing finite.
    """

    sequence: str
    truth: Box
    answer: Box | None
    exemplar_size_px: tuple[float, float]

    @property
    def is_found(self) -> bool:
        """The answer's centre lies in the true box."""
        a, t = self.answer, self.truth
        return a is not None and abs(a.cx_px - t.cx_px) <= t.w_px / 2 and abs(a.cy_px - t.cy_px) <= t.h_px / 2

    @property
    def is_hit(self) -> bool:
        """Found, and the boxes overlap by more than half."""
        return self.answer is not None and self.is_found and self.answer.iou(self.truth) > HIT_IOU


@dataclass(frozen=True, slots=True)
class Line:
    """predicted = intercept + slope true, by least squares; `spread` is the residuals' standard deviation."""

    slope: float
    intercept: float
    correlation: float
    spread: float

    @classmethod
    def fit(cls, true: Array, predicted: Array) -> Line | None:
        """None for too few pairs, or for true values that are all the same."""
        if len(true) < LEAST_PAIRS or float(true.std()) < LEAST_SPREAD:
            return None
        x, y = true - true.mean(), predicted - predicted.mean()
        slope = float((x * y).mean() / (x * x).mean())
        spread = float((y - slope * x).std())
        scale = float(true.std() * predicted.std())
        correlation = float((x * y).mean()) / scale if scale > 0 else 0.0
        return cls(slope, float(predicted.mean() - slope * true.mean()), correlation, spread)


@dataclass(frozen=True, slots=True)
class Part:
    """The numbers of one sequence, or of all.

    `hits`, `found`: shares of the pairs. `centre_error_px`: median over the found ones, in crop pixels. `scale` and
    `aspect`: lines of the change against the exemplar of ln sqrt(w h) and of ln(w / h), over the found ones: a line
    over the hits alone would leave out the answers whose size was wrong.
    """

    name: str
    pairs: int
    hits: float
    found: float
    centre_error_px: float | None
    scale: Line | None
    aspect: Line | None

    @classmethod
    def of(cls, name: str, measured: Sequence[Measured]) -> Part:
        """From at least one pair."""
        answered = [(m, m.answer) for m in measured if m.is_found and m.answer is not None]
        errors = [math.hypot(a.cx_px - m.truth.cx_px, a.cy_px - m.truth.cy_px) for m, a in answered]
        rows = [(*_change(m.truth, m.exemplar_size_px), *_change(a, m.exemplar_size_px)) for m, a in answered]
        true_scale, true_aspect, scale, aspect = np.array(rows, dtype=np.float64).reshape(-1, 4).T
        return cls(
            name,
            len(measured),
            sum(m.is_hit for m in measured) / len(measured),
            len(answered) / len(measured),
            float(np.median(errors)) if errors else None,
            Line.fit(true_scale, scale),
            Line.fit(true_aspect, aspect),
        )


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """All numbers; `sequences` in the order in which they were measured."""

    overall: Part
    sequences: tuple[Part, ...]
    skipped: tuple[str, ...]

    @classmethod
    def of(cls, measured: Sequence[Measured], skipped: tuple[str, ...] = ()) -> Diagnosis:
        """From at least one pair."""
        names = dict.fromkeys(m.sequence for m in measured)
        parts = tuple(Part.of(name, [m for m in measured if m.sequence == name]) for name in names)
        return cls(Part.of("all", measured), parts, skipped)

    def as_json(self) -> dict[str, Any]:
        """Plain numbers; the verdict too."""
        return {**asdict(self), "verdict": list(self.verdict())}

    def table(self) -> list[str]:
        """One line per sequence, then all; slopes and spreads are of log-scale and of log-aspect."""
        width = max(8, *(len(part.name) for part in self.sequences))
        head = f"{'':{width}}  pairs  hits  found  error px | scale: slope  shift   corr spread | aspect: slope   corr"
        return [head, *(_row(part, width) for part in (*self.sequences, self.overall))]

    def verdict(self) -> tuple[str, ...]:
        """What is wrong, worst first, and what to try."""
        told = [*_where(self.overall), *_sizes(self.overall.scale), *_shapes(self.overall.aspect)]
        weak = [part.name for part in self.sequences if part.hits < WEAK_SEQUENCE]
        if weak and len(weak) < len(self.sequences):
            told.append(f"hits below {WEAK_SEQUENCE:.0%} in {', '.join(weak)}: train on more pictures of that kind")
        return tuple(told) or ("nothing stands out: hits, positions, sizes and shapes are as they should be",)


def _change(box: Box, exemplar_size_px: tuple[float, float]) -> tuple[float, float]:
    """ln of the factors of size and of aspect, against the exemplar."""
    w, h = box.w_px / exemplar_size_px[0], box.h_px / exemplar_size_px[1]
    return 0.5 * math.log(w * h), math.log(w / h)


def _where(part: Part) -> list[str]:
    told = []
    if part.hits < LOW_HITS:
        missed, small = 1.0 - part.found, part.found - part.hits
        told.append(
            f"hits {part.hits:.0%}: {missed:.0%} of the answers are elsewhere (more pairs, negatives, distractors)"
            f", {small:.0%} at the target with a wrong box (see the slopes)"
        )
    if part.centre_error_px is not None and part.centre_error_px > LARGE_ERROR_PX:
        told.append(f"centre error {part.centre_error_px:.1f} px, more than a cell: train longer, at a falling rate")
    return told


def _sizes(line: Line | None) -> list[str]:
    if line is None:
        return ["too few targets were found to judge sizes: more pairs, or train longer"]
    told = []
    if line.slope < LOW_SLOPE:
        told.append(
            f"slope {line.slope:.2f}: changes of size are under-estimated, towards the exemplar's own size, so tracked "
            "boxes will lag behind; raise jitter.log_scale well above the spread and train longer"
        )
    if line.slope > HIGH_SLOPE:
        told.append(f"slope {line.slope:.2f}: changes of size are over-estimated; lower jitter.log_scale")
    if abs(line.intercept) > LARGE_INTERCEPT:
        kind = "large" if line.intercept > 0 else "small"
        factor = math.exp(abs(line.intercept)) - 1.0
        told.append(f"boxes are {factor:.0%} too {kind} everywhere: look at the boxes of the data (train preview)")
    if line.spread > LARGE_SPREAD:
        told.append(f"spread {line.spread:.2f} of log-scale: sizes are noisy; train longer, at a falling rate")
    return told


def _shapes(line: Line | None) -> list[str]:
    if line is None or line.slope >= LOW_ASPECT_SLOPE:
        return []
    return [f"aspect slope {line.slope:.2f}: changes of shape are under-estimated; raise jitter.log_aspect"]


def _row(part: Part, width: int) -> str:
    error = "-" if part.centre_error_px is None else f"{part.centre_error_px:.1f}"
    scale = f"{'-':>12}" if part.scale is None else (
        f"{part.scale.slope:12.2f} {part.scale.intercept:+6.2f} {part.scale.correlation:6.2f} {part.scale.spread:6.2f}"
    )  # fmt: skip
    aspect = f"{'-':>13}" if part.aspect is None else f"{part.aspect.slope:13.2f} {part.aspect.correlation:6.2f}"
    return f"{part.name:{width}} {part.pairs:6d} {part.hits:5.0%} {part.found:6.0%} {error:>9} |{scale:33} |{aspect}"
