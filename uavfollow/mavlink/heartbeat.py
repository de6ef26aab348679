"""HEARTBEAT (0) of our two components: the controller (191) and the camera (100). Each goes out at 1 Hz."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega

from uavfollow.mavlink.ids import (
    AUTOPILOT_INVALID,
    STATE_ACTIVE,
    STATE_STANDBY,
    TYPE_CAMERA,
    TYPE_ONBOARD_CONTROLLER,
)
from uavfollow.mavlink.packer import Message

HEARTBEAT_PERIOD_S = 1.0  # what autopilots and ground stations expect; QGroundControl drops a camera after 5 s


def controller_heartbeat() -> Message:
    """HEARTBEAT of the onboard controller: type 18, no autopilot, active."""
    return _heartbeat(TYPE_ONBOARD_CONTROLLER, STATE_ACTIVE)


def camera_heartbeat(has_video: bool) -> Message:
    """HEARTBEAT of the camera: type 30, no autopilot; active with fresh video, standby without."""
    return _heartbeat(TYPE_CAMERA, STATE_ACTIVE if has_video else STATE_STANDBY)


def _heartbeat(component_type: int, state: int) -> Message:
    return ardupilotmega.MAVLink_heartbeat_message(
        type=component_type,
        autopilot=AUTOPILOT_INVALID,
        base_mode=0,
        custom_mode=0,
        system_status=state,
        mavlink_version=3,
    )
