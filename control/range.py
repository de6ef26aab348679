"""How far the target is: from its apparent size and one known pair of size and range."""

from __future__ import annotations

import math
from dataclasses import dataclass

from control.gate import all_finite
from tracker.messages import Array, TargetState

# A box smaller than this is a few pixels of blur; its size is that of the network's stride, not of the target.
MIN_SIZE_PX = 4.0
# Beyond this relative sigma the estimate says "somewhere": half or twice as far are both within two sigma.
MAX_RELATIVE_SIGMA = 0.35
# The reference holds for a pose of the target; ten times as near or as far the box is cut or blurred.
MAX_RATIO = 10.0


@dataclass(frozen=True, slots=True)
class RangeEstimate:
    """Slant range from camera to target and its sigma. The numbers may be NaN when not `valid`."""

    range_m: float
    sigma_m: float
    valid: bool


NO_RANGE = RangeEstimate(math.nan, math.nan, False)

# Closer to the horizon than this a degree of error in the gimbal is 10 % of the range or more.
MIN_DEPRESSION_RAD = math.radians(10.0)
# Lower than this the target's own height, which is not known, is a large part of it.
MIN_HEIGHT_M = 4.0
# Beyond it nothing that can be followed is large enough in the picture.
MAX_GROUND_RANGE_M = 500.0


def ground_range_m(sight_ned: Array, height_m: float, half_height_rad: float = 0.0) -> float | None:
    """Slant range (m) of what stands on flat ground `height_m` below the camera, seen along `sight_ned` (3,), unit.

    The line goes to its middle; `half_height_rad` is the angle from there to its lower edge, by which its middle is
    taken to lie above the ground. None when the line is not steep enough or the camera not high enough to say, or a
    number is not finite. The ground is taken as level with the place of take-off: on lower ground the result is too
    small, on higher ground too large.
    """
    down = float(sight_ned[2])
    if not all_finite(down, height_m, half_height_rad) or height_m < MIN_HEIGHT_M or not 0 <= half_height_rad < 1:
        return None
    if down < math.sin(MIN_DEPRESSION_RAD):
        return None
    # Middle at height h above the ground: range * down = height - h, with h = range * half_height * cos(depression).
    range_m = height_m / (down + half_height_rad * math.sqrt(max(0.0, 1.0 - down * down)))
    return range_m if range_m <= MAX_GROUND_RANGE_M else None


@dataclass(frozen=True, slots=True)
class SizeRange:
    """Monocular range: reference range * reference size / size, with size = sqrt(w h) in pixels.

    True while the target shows the same side and the zoom stays. Raises ValueError when a reference is not positive.
    """

    reference_range_m: float
    reference_size_px: float

    def __post_init__(self) -> None:
        for name in ("reference_range_m", "reference_size_px"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"SizeRange.{name} = {value}: must be finite and above 0")

    def resized(self, factor: float) -> SizeRange:
        """The same range for a box that was redrawn `factor` times as large; the target itself is what it was."""
        return SizeRange(self.reference_range_m, self.reference_size_px * factor)

    def estimate(self, target: TargetState) -> RangeEstimate:
        """Range of the target's box, not valid without a finite box and covariance or outside the gates above.

        ln(size) is the mean of ln w and ln h, and ln(range) a constant minus it, so the relative sigma of the range is
        that of ln(size). It holds the noise of the box only, not that of a target which turns.
        """
        box = target.box
        if box is None or target.cov is None or not box.is_valid:
            return NO_RANGE
        size_px = math.sqrt(box.w_px) * math.sqrt(box.h_px)
        relative_sigma = _sigma_ln_size(target.cov)
        ratio = self.reference_size_px / size_px if size_px >= MIN_SIZE_PX else math.nan
        if not (1 / MAX_RATIO <= ratio <= MAX_RATIO and relative_sigma <= MAX_RELATIVE_SIGMA):
            return NO_RANGE
        range_m = self.reference_range_m * ratio
        return RangeEstimate(range_m, range_m * relative_sigma, True)


def _sigma_ln_size(cov: Array) -> float:
    """Sigma of (ln w + ln h) / 2 from the (4, 4) covariance of (cx, cy, ln w, ln h); NaN when it is not one."""
    var_w, var_h, cov_wh = float(cov[2, 2]), float(cov[3, 3]), float(cov[2, 3])
    variance = (var_w + var_h + 2 * cov_wh) / 4
    if not all_finite(variance) or min(var_w, var_h, variance) < 0:
        return math.nan
    return math.sqrt(variance)
