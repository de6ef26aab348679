"""Sticks and switches: a receiver, what the ground station writes over it, and how both run out."""

from __future__ import annotations

from enum import Enum

from sitl.autopilot.parameters import Parameters

CHANNELS = 8
# As ArduPilot's own simulation starts: sticks centred, throttle low, mode switch in its sixth position.
DEFAULT_PWM = (1500, 1500, 1000, 1500, 1800, 1000, 1000, 1800)
ROLL, PITCH, THROTTLE, YAW = 0, 1, 2, 3
LOW_US, MIDDLE_US, HIGH_US = 1000, 1500, 2000
# ArduPilot's RCn_DZ and THR_DZ.
STICK_DEADZONE_US = 20
THROTTLE_DEADZONE_US = 100
# Throttle below this counts as closed (RC3_DZ above its minimum), so that arming is allowed.
THROTTLE_CLOSED_US = 1030
# Upper edges of the first five positions of the mode switch.
SWITCH_EDGES_US = (1230, 1360, 1490, 1620, 1749)
# A receiver that is switched off is noticed after this.
RECEIVER_LOST_S = 1.0
# RC_CHANNELS_OVERRIDE: this value leaves a channel as it is, zero gives it back.
IGNORE_US = 65535


class Signal(Enum):
    """How the sticks are heard."""

    RECEIVER = "receiver"
    LOST = "lost"


class RcInput:
    """The eight channels as the flight code sees them."""

    __slots__ = ("_lost_at_s", "_overrides", "_parameters", "_receiver")

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._receiver: tuple[int, ...] = DEFAULT_PWM
        self._lost_at_s: float | None = None
        self._overrides: dict[int, tuple[int, float]] = {}

    def receive(self, pwm: tuple[int, ...] | None, t_s: float) -> None:
        """What the receiver gives from now on (missing channels keep their value), or None: switched off."""
        if pwm is None:
            self._lost_at_s = t_s if self._lost_at_s is None else self._lost_at_s
            return
        self._lost_at_s = None
        self._receiver = (*pwm[:CHANNELS], *self._receiver[len(pwm) :])

    def override(self, pwm: tuple[int, ...], t_s: float) -> None:
        """RC_CHANNELS_OVERRIDE: 65535 leaves a channel, 0 releases it, anything else holds for RC_OVERRIDE_TIME."""
        for channel, value in enumerate(pwm[:CHANNELS]):
            if value == 0:
                self._overrides.pop(channel, None)
            elif value != IGNORE_US:
                self._overrides[channel] = (value, t_s)

    def release(self) -> None:
        """Forget every override."""
        self._overrides.clear()

    def channels(self, t_s: float) -> tuple[int, ...]:
        """Pulse widths, us."""
        if not self._overrides:
            return self._receiver
        limit = self._parameters["RC_OVERRIDE_TIME"]
        if limit >= 0.0:
            self._overrides = {c: v for c, v in self._overrides.items() if t_s - v[1] <= limit}
        values = list(self._receiver)
        for channel, (value, _) in self._overrides.items():
            values[channel] = value
        return tuple(values)

    def signal(self, t_s: float) -> Signal:
        """Whether there is a receiver; an override of the throttle stands in for it."""
        if self._lost_at_s is None or t_s - self._lost_at_s < RECEIVER_LOST_S or THROTTLE in self._overrides:
            return Signal.RECEIVER
        return Signal.LOST

    def throttle_us(self, t_s: float) -> int:
        """The throttle channel."""
        return self.channels(t_s)[THROTTLE]

    def stick(self, channel: int, t_s: float) -> float:
        """Roll, pitch or yaw in [-1, 1], zero in the dead zone; pitch back (nose up) is +."""
        value = self.channels(t_s)[channel] - MIDDLE_US
        if abs(value) <= STICK_DEADZONE_US:
            return 0.0
        span = HIGH_US - MIDDLE_US - STICK_DEADZONE_US
        moved = abs(value) - STICK_DEADZONE_US
        return max(-1.0, min(1.0, (moved if value > 0 else -moved) / span))

    def climb(self, t_s: float) -> float:
        """Throttle as a wish to climb in [-1, 1], zero about the middle."""
        value = self.throttle_us(t_s) - MIDDLE_US
        if abs(value) <= THROTTLE_DEADZONE_US:
            return 0.0
        span = HIGH_US - MIDDLE_US - THROTTLE_DEADZONE_US
        moved = abs(value) - THROTTLE_DEADZONE_US
        return max(-1.0, min(1.0, (moved if value > 0 else -moved) / span))

    def switch_position(self, t_s: float) -> int:
        """Position 1 to 6 of the mode switch."""
        channel = int(self._parameters["FLTMODE_CH"]) - 1
        value = self.channels(t_s)[channel] if 0 <= channel < CHANNELS else DEFAULT_PWM[4]
        return 1 + sum(value > edge for edge in SWITCH_EDGES_US)
