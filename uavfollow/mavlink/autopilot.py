"""What the autopilot tells: its status and mode, and vehicle and gimbal telemetry at any time of the last second."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable

import numpy as np

from control.frames import rpy_from_quaternion, wrap_pi
from control.messages import FlightStatus, GimbalFrame, GimbalState, VehicleState
from uavfollow.mavlink import ids
from uavfollow.mavlink.body_angles import BodyAngles
from uavfollow.mavlink.boot_clock import BootClock
from uavfollow.mavlink.history import History
from uavfollow.mavlink.packer import Message

log = logging.getLogger(__name__)

MODE_GUIDED = 4
COPTER_MODES = {
    0: "STABILIZE", 1: "ACRO", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL", 7: "CIRCLE", 9: "LAND",
    11: "DRIFT", 13: "SPORT", 14: "FLIP", 15: "AUTOTUNE", 16: "POSHOLD", 17: "BRAKE", 18: "THROW", 19: "AVOID_ADSB",
    20: "GUIDED_NOGPS", 21: "SMART_RTL", 22: "FLOWHOLD", 23: "FOLLOW", 24: "ZIGZAG", 25: "SYSTEMID", 26: "AUTOROTATE",
    27: "AUTO_RTL",
}  # fmt: skip
# The estimator's flags are asked for at 2 Hz; ArduPilot goes on with LOCAL_POSITION_NED when its position has become
# a guess (GPS lost), so flags that have stopped to come are no "good" any more.
MAX_ESTIMATOR_AGE_S = 2.0
NEVER_S = -math.inf


class AutopilotView:
    """Built from messages of component 1 of one system. `take` never raises; what it cannot use is counted."""

    def __init__(self, system_id: int, gimbal_device_id: int = 1) -> None:
        self.system_id = system_id
        self.clock = BootClock()
        self.reboots = 0
        self.unusable = 0
        self.gimbal_primary: tuple[int, int] | None = None
        self.gimbal_primary_s = NEVER_S
        self._device_id = gimbal_device_id
        self._attitude = History(angles=(0, 1, 2))
        self._position = History()
        self._gimbal = History(angles=(0, 1))
        self._gimbal_frame = GimbalFrame.VEHICLE
        self._body_angles = BodyAngles()
        self._forget()
        self._handlers: dict[str, Callable[[Message, float], None]] = {
            "HEARTBEAT": self._heartbeat,
            "ATTITUDE": self._take_attitude,
            "LOCAL_POSITION_NED": self._take_position,
            "EXTENDED_SYS_STATE": self._landed_state,
            "EKF_STATUS_REPORT": self._estimator,
            "ESTIMATOR_STATUS": self._estimator,
            "GIMBAL_DEVICE_ATTITUDE_STATUS": self._take_gimbal,
            "GIMBAL_MANAGER_STATUS": self._gimbal_manager,
        }

    def _forget(self) -> None:
        for history in (self._attitude, self._position, self._gimbal):
            history.clear()
        self._heartbeat_s = self._landed_s = self._estimator_s = NEVER_S
        self._accepts = self._armed = self._failsafe = self._airborne = self._estimator_good = False
        self._mode = "unknown"
        self.gimbal_primary = None
        self._heard_s: dict[str, float] = {}
        self._body_angles.reset()

    def take(self, message: Message, now_s: float) -> None:
        """Use a message received at `now_s` (our clock); those of other components and of unknown use are left."""
        handler = self._handlers.get(message.get_type())
        source = (message.get_srcSystem(), message.get_srcComponent())
        if handler is None or source != (self.system_id, ids.AUTOPILOT_COMPONENT):
            return
        self._heard_s[message.get_type()] = now_s
        try:
            handler(message, now_s)
        except Exception as error:  # one bad packet must not end a flight
            self.unusable += 1
            log.warning("%s cannot be used: %r", message.get_type(), error)

    def timesync(self, tc1_ns: int, ts1_ns: int, now_s: float) -> None:
        """Take the autopilot's answer to a TIMESYNC request of ours.

        After a restart ArduPilot sends nothing with a boot time but these answers until streams are asked for again.
        """
        if self.clock.reply(tc1_ns, ts1_ns, now_s):
            self._hear(tc1_ns * 1e-9, now_s)

    def oldest_stream_s(self, names: Iterable[str]) -> float:
        """When that of the messages `names` was heard last which has been silent longest; -inf: one never came."""
        return min((self._heard_s.get(name, NEVER_S) for name in names), default=NEVER_S)

    def status(self, now_s: float) -> FlightStatus:
        """Mode, armed, in the air and so on, with the times they were heard."""
        return FlightStatus(
            t_heartbeat_s=self._heartbeat_s,
            mode=self._mode,
            accepts_setpoints=self._accepts,
            armed=self._armed,
            failsafe=self._failsafe,
            t_landed_state_s=self._landed_s,
            airborne=self._airborne,
            position_good=self._has_position(now_s),
            t_timesync_s=self.clock.t_quick_answer_s,
        )

    def _has_position(self, now_s: float) -> bool:
        return self._estimator_good and now_s - self._estimator_s <= MAX_ESTIMATOR_AGE_S

    def vehicle_at(self, t_s: float, now_s: float) -> VehicleState:
        """Attitude, position and velocity at `t_s`; a group without reports is not valid."""
        attitude, position = self._attitude.at(t_s), self._position.at(t_s)
        stamps = [found[0] for found in (attitude, position) if found is not None]
        roll, pitch, yaw = attitude[1] if attitude is not None else (0.0, 0.0, 0.0)
        north, east, down, *velocity = position[1] if position is not None else (0.0,) * 6
        return VehicleState(
            t_s=min(stamps, default=NEVER_S),
            roll_rad=roll,
            pitch_rad=pitch,
            yaw_rad=yaw,
            pos_ned_m=(north, east, down),
            vel_ned_m_s=(velocity[0], velocity[1], velocity[2]),
            attitude_valid=attitude is not None,
            position_valid=position is not None and self._has_position(now_s),
            source=f"mavlink {self.system_id}/{ids.AUTOPILOT_COMPONENT}",
        )

    def gimbal_at(self, t_s: float, frame: GimbalFrame) -> GimbalState:
        """Where the camera pointed at `t_s`, yaw in `frame`; not valid without a report (or heading)."""
        source = f"mavlink {self.system_id}/{ids.AUTOPILOT_COMPONENT} device {self._device_id}"
        found = self._gimbal.at(t_s)
        if found is None:
            return GimbalState(NEVER_S, 0.0, 0.0, frame, False, source)
        stamp_s, (pitch, yaw) = found
        if frame is not self._gimbal_frame:
            heading = self._attitude.at(stamp_s)
            if heading is None:
                return GimbalState(NEVER_S, 0.0, 0.0, frame, False, source)
            sign = 1.0 if frame is GimbalFrame.EARTH else -1.0
            yaw, stamp_s = wrap_pi(yaw + sign * heading[1][2]), min(stamp_s, heading[0])
        return GimbalState(stamp_s, pitch, yaw, frame, True, source)

    def _stamp_s(self, message: Message, now_s: float) -> float:
        """When the message was made, on our clock; a clock that went back forgets all that was heard before."""
        boot_s = message.time_boot_ms * 1e-3
        self._hear(boot_s, now_s)
        return self.clock.ours(boot_s, now_s)

    def _hear(self, boot_s: float, now_s: float) -> None:
        if self.clock.heard(boot_s, now_s):
            return
        log.warning("the autopilot's clock went back to %.1f s: it was restarted", boot_s)
        self.reboots += 1
        heartbeat = (self._heartbeat_s, self._mode, self._accepts, self._armed, self._failsafe)
        self._forget()
        # A heartbeat comes at once after a restart and is newer than the restart itself.
        self._heartbeat_s, self._mode, self._accepts, self._armed, self._failsafe = heartbeat

    def _heartbeat(self, message: Message, now_s: float) -> None:
        copter = message.autopilot == ids.AUTOPILOT_ARDUPILOT and message.type in ids.TYPES_COPTER
        mode = int(message.custom_mode)
        self._mode = COPTER_MODES.get(mode, f"mode {mode}") if copter else f"autopilot {message.autopilot} mode {mode}"
        self._accepts = copter and mode == MODE_GUIDED
        self._armed = bool(message.base_mode & ids.MODE_FLAG_ARMED)
        self._failsafe = message.system_status >= ids.STATE_CRITICAL
        self._heartbeat_s = now_s

    def _landed_state(self, message: Message, now_s: float) -> None:
        self._airborne = message.landed_state == ids.LANDED_STATE_IN_AIR
        self._landed_s = now_s

    def _estimator(self, message: Message, now_s: float) -> None:
        flags = int(message.flags)
        self._estimator_good = bool(flags & ids.ESTIMATOR_VELOCITY_HORIZ and flags & ids.ESTIMATOR_POSITION_HORIZ)
        self._estimator_s = now_s

    def _take_attitude(self, message: Message, now_s: float) -> None:
        self._attitude.add(self._stamp_s(message, now_s), (message.roll, message.pitch, message.yaw))

    def _take_position(self, message: Message, now_s: float) -> None:
        values = (message.x, message.y, message.z, message.vx, message.vy, message.vz)
        self._position.add(self._stamp_s(message, now_s), values)

    def _take_gimbal(self, message: Message, now_s: float) -> None:
        if message.gimbal_device_id not in (0, self._device_id):
            return
        angles = rpy_from_quaternion(np.asarray(message.q, dtype=np.float64))
        frame, t_s = yaw_frame(int(message.flags)), self._stamp_s(message, now_s)
        if frame is not self._gimbal_frame:
            self._gimbal.clear()
            self._gimbal_frame = frame
        attitude = self._attitude.at(t_s)
        if frame is GimbalFrame.VEHICLE and attitude is not None:
            if self._body_angles.update(angles[0], attitude[1][0]):
                self._gimbal.clear()  # what was kept was taken for something else
            angles = self._body_angles.levelled(angles, attitude[1])
        self._gimbal.add(t_s, (angles[1], angles[2]))

    def _gimbal_manager(self, message: Message, now_s: float) -> None:
        if message.gimbal_device_id in (0, self._device_id):
            self.gimbal_primary = (int(message.primary_control_sysid), int(message.primary_control_compid))
            self.gimbal_primary_s = now_s


def yaw_frame(flags: int) -> GimbalFrame:
    """What the yaw of a gimbal's report is measured from. The frame bits count before YAW_LOCK, for ArduPilot reports
    vehicle yaw even in lock."""
    if flags & ids.YAW_IN_VEHICLE_FRAME:
        return GimbalFrame.VEHICLE
    return GimbalFrame.EARTH if flags & (ids.YAW_IN_EARTH_FRAME | ids.YAW_LOCK) else GimbalFrame.VEHICLE
