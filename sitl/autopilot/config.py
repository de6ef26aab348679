"""Settings of the simulated ArduCopter that are no parameters of the real one."""

from __future__ import annotations

import math
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class ArduCopterConfig:
    """What a run fixes before it starts.

    `booted_at_s`: time at which the autopilot was switched on; its `time_boot_ms` counts from there and the physics
    run from there. `ready_after_s`: from boot until the estimator has a position; before, modes that need a position
    are refused and no LOCAL_POSITION_NED is sent. `parameters` overrides defaults by name. The noises are standard
    deviations of what is reported, not of what is flown. Raises ValueError for values out of range.
    """

    sysid: int = 1
    home_lat_deg: float = -35.3632610
    home_lon_deg: float = 149.1652300
    home_alt_m: float = 584.08
    booted_at_s: float = 0.0
    ready_after_s: float = 0.0
    physics_hz: int = 400
    position_noise_m: float = 0.0
    velocity_noise_m_s: float = 0.0
    parameters: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 1 <= self.sysid <= 255:
            raise ValueError(f"sysid must be 1 to 255, not {self.sysid}")
        if not 50 <= self.physics_hz <= 1000:
            raise ValueError(f"physics_hz must be 50 to 1000, not {self.physics_hz}")
        if not (abs(self.home_lat_deg) < 89.0 and abs(self.home_lon_deg) <= 180.0):
            raise ValueError(f"home must be a place off the poles, not {self.home_lat_deg}, {self.home_lon_deg}")
        for name in ("home_alt_m", "booted_at_s", "ready_after_s", "position_noise_m", "velocity_noise_m_s"):
            if not math.isfinite(getattr(self, name)):
                raise ValueError(f"{name} must be finite, not {getattr(self, name)}")
        if min(self.ready_after_s, self.position_noise_m, self.velocity_noise_m_s) < 0.0:
            raise ValueError("ready_after_s, position_noise_m and velocity_noise_m_s must not be negative")
