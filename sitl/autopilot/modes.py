"""Flight modes of ArduCopter: numbers, names, what each needs."""

from __future__ import annotations

from enum import Enum, IntEnum


class Mode(IntEnum):
    """Flight modes that are modelled; the number is HEARTBEAT.custom_mode."""

    STABILIZE = 0
    ALT_HOLD = 2
    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    LAND = 9
    POSHOLD = 16
    BRAKE = 17


class ModeReason(Enum):
    """Why the mode is what it is."""

    BOOT = "boot"
    COMMAND = "command"
    RC_SWITCH = "rc_switch"
    RADIO_FAILSAFE = "radio_failsafe"
    GCS_FAILSAFE = "gcs_failsafe"


MANUAL = frozenset({Mode.STABILIZE, Mode.ALT_HOLD})
# LAND also works without a position (it then only levels), but shows the guided bit all the same.
NEEDS_POSITION = frozenset({Mode.AUTO, Mode.GUIDED, Mode.LOITER, Mode.RTL, Mode.POSHOLD, Mode.BRAKE})
ARMABLE = frozenset({Mode.STABILIZE, Mode.ALT_HOLD, Mode.GUIDED, Mode.LOITER, Mode.POSHOLD})

# MAV_MODE_FLAG: custom mode, stabilised, manual input; guided; safety armed.
BASE_MODE = 0x51
BASE_MODE_GUIDED = 0x08
BASE_MODE_ARMED = 0x80


def base_mode(mode: Mode, armed: bool) -> int:
    """HEARTBEAT.base_mode as it was seen: 0x51 or, in modes that use the position, 0x59; with 0x80 when armed."""
    return BASE_MODE | (0 if mode in MANUAL else BASE_MODE_GUIDED) | (BASE_MODE_ARMED if armed else 0)
