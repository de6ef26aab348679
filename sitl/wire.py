"""What really went over the link from the application: listened to between it and the autopilot."""

from __future__ import annotations

from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega

from sitl.autopilot.link import ByteLink


@dataclass(frozen=True, slots=True)
class SentSetpoint:
    """SET_POSITION_TARGET_LOCAL_NED as it was on the wire; `t_s` is when the autopilot read it."""

    t_s: float
    v_ned_m_s: tuple[float, float, float]
    yaw_rate_rad_s: float
    frame: int
    type_mask: int


@dataclass(frozen=True, slots=True)
class SentGimbal:
    """GIMBAL_MANAGER_SET_ATTITUDE as it was on the wire."""

    t_s: float
    flags: int
    q_wxyz: tuple[float, float, float, float]
    rates_rad_s: tuple[float, float, float]


class WireTap:
    """A `ByteLink` around the autopilot's end of the application's link, which notes setpoints in passing."""

    def __init__(self, link: ByteLink) -> None:
        self._link = link
        self._mav = ardupilotmega.MAVLink(None)
        self._mav.robust_parsing = True
        self.now_s = 0.0
        self.setpoints: list[SentSetpoint] = []
        self.gimbal: list[SentGimbal] = []

    def write(self, data: bytes) -> None:
        """From the autopilot to the application: passed on."""
        self._link.write(data)

    def read_available(self) -> bytes:
        """From the application to the autopilot: noted and passed on."""
        data = self._link.read_available()
        if data:
            for message in self._mav.parse_buffer(data) or ():
                self._note(message)
        return data

    def _note(self, message: ardupilotmega.MAVLink_message) -> None:
        kind = message.get_type()
        if kind == "SET_POSITION_TARGET_LOCAL_NED":
            v = (message.vx, message.vy, message.vz)
            self.setpoints.append(
                SentSetpoint(self.now_s, v, message.yaw_rate, message.coordinate_frame, message.type_mask)
            )
        elif kind == "GIMBAL_MANAGER_SET_ATTITUDE":
            rates = (message.angular_velocity_x, message.angular_velocity_y, message.angular_velocity_z)
            w, x, y, z = message.q
            self.gimbal.append(SentGimbal(self.now_s, message.flags, (w, x, y, z), rates))
