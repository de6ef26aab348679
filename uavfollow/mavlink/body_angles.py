"""Telling servo mounts from stabilised gimbals: what the roll of their reports does when the vehicle rolls.

ArduPilot's servo mount reports the angles of its servos, which are measured from the tilted body, under flags that say
"levelled". In level flight there is no difference; in a turn the pitch is wrong by the vehicle's tilt.
"""

from __future__ import annotations

from control.frames import rotation_from_rpy, rpy_from_rotation

# Below this much roll of the vehicle a report says nothing of its kind.
MIN_ROLL_RAD = 0.07
# A servo that levels the camera reports the opposite roll, a stabilised gimbal none; half way between is neither.
AGREE_SHARE = 0.35
# So many reports more of one kind than of the other decide (0.2 s at 50 Hz): one bent packet does not.
DECIDING = 10

Angles = tuple[float, float, float]


class BodyAngles:
    """Whether a gimbal's reports are body angles; until a roll has shown it they are taken as levelled."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget, as after a restart of the autopilot."""
        self._balance = 0
        self.are_body = False

    def update(self, reported_roll_rad: float, vehicle_roll_rad: float) -> bool:
        """Take a report and the vehicle's roll at its time; True when the verdict has just changed."""
        if abs(vehicle_roll_rad) >= MIN_ROLL_RAD:
            slack = AGREE_SHARE * abs(vehicle_roll_rad)
            if abs(reported_roll_rad + vehicle_roll_rad) < slack:
                self._balance = min(self._balance + 1, DECIDING)
            elif abs(reported_roll_rad) < slack:
                self._balance = max(self._balance - 1, -DECIDING)
        before = self.are_body
        if abs(self._balance) == DECIDING:
            self.are_body = self._balance > 0
        return self.are_body is not before

    def levelled(self, reported: Angles, vehicle: tuple[float, ...]) -> Angles:
        """Roll, pitch, yaw from the horizon and the heading; body angles are turned by the vehicle's roll and pitch."""
        if not self.are_body:
            return reported
        roll, pitch = vehicle[:2]
        return rpy_from_rotation(rotation_from_rpy(roll, pitch, 0.0) @ rotation_from_rpy(*reported))
