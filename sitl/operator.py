"""The person at the ground station: takes off, points the camera, changes modes. MAVLink bytes over an own link."""

from __future__ import annotations

import math
from enum import Enum
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega

from sitl.autopilot.link import ByteLink

GROUND_STATION = (255, 190)  # the ids that ground stations use
HEARTBEAT_PERIOD_S = 1.0
RETRY_S = 1.0  # a person presses the button again
HEIGHT_TOLERANCE_M = 0.4
MAX_CLIMB_LEFT_M_S = 0.15  # slower than this the take-off is over
SETTLE_S = 1.0  # the gimbal comes to rest before the scenario begins
MODES = {"STABILIZE": 0, "ALT_HOLD": 2, "GUIDED": 4, "LOITER": 5, "RTL": 6, "LAND": 9, "BRAKE": 17}
IN_AIR = 2


class Stage(str, Enum):
    """How far the take-off is."""

    CONNECT = "waiting for the autopilot's heartbeat"
    MODE = "asking for GUIDED"
    ARM = "arming"
    TAKE_OFF = "asking for take-off"
    CLIMB = "climbing"
    SETTLE = "pointing the camera"
    READY = "ready"


class OperatorError(RuntimeError):
    """The flight could not begin; says at which stage and what the autopilot said."""


class Operator:
    """Reads and writes the ground station's link. `step` is called often; nothing blocks."""

    def __init__(self, link: ByteLink, height_m: float, gimbal_pitch_rad: float, gimbal_yaw_rad: float = 0.0) -> None:
        self._link = link
        self._height_m = height_m
        self._gimbal = (gimbal_pitch_rad, gimbal_yaw_rad)
        self._mav = ardupilotmega.MAVLink(None, srcSystem=GROUND_STATION[0], srcComponent=GROUND_STATION[1])
        self._mav.robust_parsing = True
        self._heartbeat_due_s = self._retry_due_s = -math.inf
        self._settled_s = math.inf
        self._mode = -1
        self._armed = False
        self._landed_state = 0
        self._height_seen_m = self._climb_m_s = 0.0
        self.stage = Stage.CONNECT
        self.texts: list[str] = []

    @property
    def is_ready(self) -> bool:
        """In the air at its height, the camera pointed."""
        return self.stage is Stage.READY

    def step(self, now_s: float) -> None:
        """Read, beat, and press the next button of the take-off."""
        for message in self._mav.parse_buffer(self._link.read_available()) or ():
            self._take(message)
        if now_s >= self._heartbeat_due_s:
            self._heartbeat_due_s = now_s + HEARTBEAT_PERIOD_S
            self._send(
                ardupilotmega.MAVLink_heartbeat_message(
                    type=6, autopilot=8, base_mode=0, custom_mode=0, system_status=4, mavlink_version=3
                )
            )
        if self.stage is not Stage.READY:
            self._take_off(now_s)

    def change_mode(self, name: str) -> None:
        """Someone takes over: DO_SET_MODE of a mode by its ArduCopter name."""
        self._command(ardupilotmega.MAV_CMD_DO_SET_MODE, 1.0, float(MODES[name]))

    def _take(self, message: Any) -> None:
        kind = message.get_type()
        if kind == "HEARTBEAT" and message.get_srcComponent() == 1:
            self._mode, self._armed = message.custom_mode, bool(message.base_mode & 128)
            if self.stage is Stage.CONNECT:
                self._connected()
        elif kind == "EXTENDED_SYS_STATE":
            self._landed_state = message.landed_state
        elif kind == "LOCAL_POSITION_NED":
            self._height_seen_m, self._climb_m_s = -message.z, -message.vz
        elif kind == "STATUSTEXT":
            text = message.text if isinstance(message.text, str) else bytes(message.text).decode(errors="replace")
            self.texts.append(text.rstrip("\0"))

    def _connected(self) -> None:
        for message_id, period_us in ((32, 100_000), (245, 200_000)):
            self._command(ardupilotmega.MAV_CMD_SET_MESSAGE_INTERVAL, float(message_id), float(period_us))
        self.stage = Stage.MODE

    def _take_off(self, now_s: float) -> None:
        self._advance(now_s)
        if now_s < self._retry_due_s:
            return
        self._retry_due_s = now_s + RETRY_S
        if self.stage is Stage.MODE:
            self.change_mode("GUIDED")
        elif self.stage is Stage.ARM:
            self._command(ardupilotmega.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        elif self.stage is Stage.TAKE_OFF:
            self._command(ardupilotmega.MAV_CMD_NAV_TAKEOFF, p7=self._height_m)
        elif self.stage is Stage.SETTLE:
            pitch_deg, yaw_deg = (math.degrees(v) for v in self._gimbal)
            self._command(ardupilotmega.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, pitch_deg, yaw_deg, math.nan, math.nan)

    def _advance(self, now_s: float) -> None:
        """Go on to the next stage when the autopilot shows that this one is done."""
        before = self.stage
        if self.stage is Stage.MODE and self._mode == MODES["GUIDED"]:
            self.stage = Stage.ARM
        elif self.stage is Stage.ARM and self._armed:
            self.stage = Stage.TAKE_OFF
        elif self.stage is Stage.TAKE_OFF and self._height_seen_m > HEIGHT_TOLERANCE_M:
            self.stage = Stage.CLIMB
        elif self.stage is Stage.CLIMB and self._has_climbed():
            self.stage, self._settled_s = Stage.SETTLE, now_s + SETTLE_S
        elif self.stage is Stage.SETTLE and now_s >= self._settled_s:
            self.stage = Stage.READY
        if self.stage is not before:
            self._retry_due_s = now_s

    def _has_climbed(self) -> bool:
        reached = self._height_seen_m > self._height_m - HEIGHT_TOLERANCE_M
        return reached and abs(self._climb_m_s) < MAX_CLIMB_LEFT_M_S and self._landed_state == IN_AIR

    def _command(self, command: int, *params: float, p7: float = 0.0) -> None:
        values = [*params, *[0.0] * (6 - len(params)), p7]
        self._send(ardupilotmega.MAVLink_command_long_message(1, 1, command, 0, *values))

    def _send(self, message: Any) -> None:
        self._link.write(bytes(message.pack(self._mav)))
        self._mav.seq = (self._mav.seq + 1) % 256
