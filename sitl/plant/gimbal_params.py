"""What a gimbal of the simulator is like. Defaults: a small servo-driven brushless gimbal as sold for 2 kg drones."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace


@dataclass(frozen=True, slots=True)
class GimbalParams:
    """Limits, lags and faults of a two-axis gimbal; radians and seconds.

    Raises ValueError, naming the field, for a value that is not finite or outside of what makes sense.
    """

    delay_s: float = 0.03  # command to motor: one frame of a serial protocol and its handling
    lag_s: float = 0.05  # rate loop; 30 to 80 ms are usual
    max_rate_rad_s: float = math.radians(120.0)  # 60 to 150 deg/s are usual
    max_accel_rad_s2: float = 20.0  # full rate in 0.1 s
    stiction_rad: float = 0.001  # break-away error of a standing joint: 0.06 deg, a pixel or less
    min_pitch_rad: float = math.radians(-90.0)
    max_pitch_rad: float = math.radians(30.0)
    min_yaw_rad: float = math.radians(-170.0)
    max_yaw_rad: float = math.radians(170.0)
    misalignment_pitch_rad: float = 0.0  # of the camera against the joints: 1 to 3 degrees are common
    misalignment_yaw_rad: float = 0.0
    misalignment_roll_rad: float = 0.0
    encoder_step_rad: float = math.tau / 4096.0  # 12 bit
    stabilisation_residue: float = 0.02  # share of the vehicle's fast tilting that reaches the picture
    stabilisation_time_s: float = 0.5  # slower tilting than this is removed wholly

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not math.isfinite(value):
                raise ValueError(f"GimbalParams.{field.name} must be finite, not {value}")
            if field.name in _POSITIVE and value <= 0.0:
                raise ValueError(f"GimbalParams.{field.name} must be positive, not {value}")
            if field.name in _NOT_NEGATIVE and value < 0.0:
                raise ValueError(f"GimbalParams.{field.name} must not be negative, not {value}")
        if not self.min_pitch_rad < self.max_pitch_rad or not self.min_yaw_rad < self.max_yaw_rad:
            raise ValueError("GimbalParams: the lower stop must lie below the upper one")
        if self.stabilisation_residue > 1.0:
            raise ValueError("GimbalParams.stabilisation_residue is a share, at most 1")

    def mirrored(self) -> GimbalParams:
        """The same gimbal in a mirror (east and west exchanged)."""
        return replace(
            self,
            min_yaw_rad=-self.max_yaw_rad,
            max_yaw_rad=-self.min_yaw_rad,
            misalignment_yaw_rad=-self.misalignment_yaw_rad,
            misalignment_roll_rad=-self.misalignment_roll_rad,
        )


_POSITIVE = frozenset({"lag_s", "max_rate_rad_s", "max_accel_rad_s2", "stabilisation_time_s"})
_NOT_NEGATIVE = frozenset({"delay_s", "stiction_rad", "encoder_step_rad", "stabilisation_residue"})
