"""The flight side of the autopilot: mode, arming, take-off and landing, one tick after the other. No MAVLink."""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum

from sitl.autopilot.automatic import AutomaticModes, RtlState
from sitl.autopilot.failsafe import Failsafes
from sitl.autopilot.guided import Guided
from sitl.autopilot.modes import ARMABLE, NEEDS_POSITION, Mode, ModeReason
from sitl.autopilot.motion import Motion
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.pilot import PilotModes
from sitl.autopilot.ports import Vehicle
from sitl.autopilot.rc import THROTTLE_CLOSED_US, RcInput

# MAV_SEVERITY
CRITICAL, WARNING, INFO = 2, 4, 6
# ArduPilot's ARMING_DELAY_SEC: motors stand still after arming.
ARMING_DELAY_S = 2.0
# MOT_SPOOL_TIME to ground idle, then the same again and the throttle's slew until the skids leave the ground:
# recorded, the vehicle lifts 1.3 s after the arming delay when the take-off was already asked for.
GROUND_IDLE_S = 0.5
LIFT_S = 0.8
# On the ground this long counts as landed, and LAND disarms this long after (both as recorded).
LANDED_AFTER_S = 1.58
DISARM_AFTER_LANDED_S = 0.5
# The mode switch must rest in a position this long.
SWITCH_DEBOUNCE_S = 0.2
# Sticks, switch and failsafes are looked at this often, a receiver's frame time.
WATCH_S = 0.02
# Times are sums of intervals: rounding must not cost a tick.
TIME_SLACK_S = 1e-9
# MAV_CMD_COMPONENT_ARM_DISARM, param2: do it whatever the checks say.
FORCE_MAGIC = 21196

Say = Callable[[int, str], None]


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


class Flight:
    """Mode, arming and the tick. `say(severity, text)` gets what a ground station would read."""

    def __init__(
        self, vehicle: Vehicle, parameters: Parameters, rc: RcInput, say: Say, now_s: float, ready_at_s: float
    ) -> None:
        self.vehicle = vehicle
        self.parameters = parameters
        self.rc = rc
        self.motion = Motion(vehicle, parameters)
        self.guided = Guided(self.motion, parameters)
        self.failsafes = Failsafes(parameters, rc)
        self._pilot = PilotModes(self.motion, parameters, rc)
        self._automatic = AutomaticModes(self.motion, parameters)
        self._say = say
        self.t_s = now_s
        self.ready_at_s = ready_at_s
        self.mode = Mode.STABILIZE
        self.mode_reason = ModeReason.BOOT
        self.armed = False
        self.land_complete = True
        self._armed_at_s = 0.0
        self._spinning = False
        self._lift_at_s: float | None = None
        self._ground_since_s: float | None = now_s
        self._landed_at_s = now_s
        self._throttle_up_at_s = now_s
        self._watch_due_s = now_s
        self._switch = rc.switch_position(now_s)
        self._switch_seen = (self._switch, now_s)
        vehicle.idle()

    # --- what others ask -----------------------------------------------------------------------------------------

    @property
    def has_position(self) -> bool:
        """The estimator is ready."""
        return self.t_s >= self.ready_at_s

    @property
    def landed_state(self) -> LandedState:
        """As EXTENDED_SYS_STATE says it."""
        if self.land_complete:
            return LandedState.ON_GROUND
        if self.mode is Mode.LAND or (self.mode is Mode.RTL and self._automatic.rtl is RtlState.DESCEND):
            return LandedState.LANDING
        if self.mode is Mode.GUIDED and self.guided.climbing:
            return LandedState.TAKEOFF
        return LandedState.IN_AIR

    def request_mode(self, number: int, reason: ModeReason) -> bool:
        """Change the mode; False, and a text that says why, when it cannot be."""
        try:
            mode = Mode(number)
        except ValueError:
            self._say(WARNING, f"No such mode {number}")
            return False
        if mode is self.mode:
            self.mode_reason = reason
            return True
        if mode in NEEDS_POSITION and not self.has_position:
            self._say(WARNING, f"Mode change to {mode.name} failed: requires position")
            return False
        if mode is Mode.AUTO:  # there is no mission
            self._say(WARNING, "Mode change to AUTO failed: init failed")
            return False
        self.mode, self.mode_reason = mode, reason
        self.motion.release()
        self._lift_at_s = None
        if mode is Mode.GUIDED:
            self.guided.stop()
        elif mode is Mode.RTL:
            self._automatic.enter_rtl()
        else:
            self._pilot.enter()
        return True

    def arm(self, force: bool) -> bool:
        """Arm; False, and a text, when a check fails."""
        if self.armed:
            return True
        fault = None if force else self._arming_fault()
        if fault is not None:
            self._say(CRITICAL, f"Arm: {fault}")
            return False
        self.armed = True
        self._armed_at_s = self._throttle_up_at_s = self.t_s
        self._say(INFO, "Arming motors")
        return True

    def _arming_fault(self) -> str | None:
        if self.mode not in ARMABLE:
            return f"{self.mode.name} mode not armable"
        if self.mode in NEEDS_POSITION and not self.has_position:
            return "GPS 1: Bad fix"
        if self.failsafes.radio:
            return "Radio failsafe on"
        if self.rc.throttle_us(self.t_s) > THROTTLE_CLOSED_US:
            return "Throttle (RC3) is not neutral"
        return None

    def disarm(self, force: bool) -> bool:
        """Disarm; False in flight unless forced, and then it falls."""
        if not self.armed:
            return True
        if not (force or self.land_complete):
            return False
        self.armed = False
        self._spinning = False
        self._lift_at_s = None
        self.land_complete = True
        self.vehicle.idle()
        self._say(INFO, "Disarming motors")
        return True

    def take_off(self, height_m: float) -> bool:
        """NAV_TAKEOFF to a height above home: only armed, on the ground and in GUIDED."""
        if not (self.armed and self.land_complete and self.mode is Mode.GUIDED and height_m > self.motion.height_m):
            return False
        self.guided.take_off(height_m)
        self._lift_at_s = max(self.t_s, self._armed_at_s + ARMING_DELAY_S + GROUND_IDLE_S) + LIFT_S
        return True

    # --- one tick ------------------------------------------------------------------------------------------------

    def tick(self, next_s: float, dt_s: float) -> None:
        """Advance by `dt_s` to `next_s`, the vehicle included."""
        if self.t_s >= self._watch_due_s - TIME_SLACK_S:
            self._watch_due_s += WATCH_S
            self._watch()
        if self.armed:
            if self.land_complete:
                self._wait_on_ground()
            if not self.land_complete:
                self._fly(dt_s)
        standing, down_m_s = self.vehicle.on_ground, self.vehicle.vel_ned_m_s[2]
        self.vehicle.step(self.t_s, dt_s)
        self.t_s = next_s
        if self.vehicle.on_ground and not standing:
            self._say(INFO, f"SIM Hit ground at {down_m_s:.6f} m/s")
        self._detect_landing()

    def _watch(self) -> None:
        for wanted, reason, text in (
            (self.failsafes.check_radio(self.t_s), ModeReason.RADIO_FAILSAFE, "Radio Failsafe"),
            (self.failsafes.check_gcs(self.t_s), ModeReason.GCS_FAILSAFE, "GCS Failsafe"),
        ):
            if wanted is None or not self.armed:
                continue
            self._say(WARNING, text)
            if self.land_complete:
                self.disarm(force=True)
            elif not self.request_mode(wanted, reason):
                self.request_mode(Mode.LAND, reason)
        self._watch_switch()

    def _watch_switch(self) -> None:
        """A moved mode switch changes the mode, once it rests; a mode that cannot start leaves the old one."""
        position = self.rc.switch_position(self.t_s)
        if position != self._switch_seen[0]:
            self._switch_seen = (position, self.t_s)
        if position != self._switch and self.t_s - self._switch_seen[1] >= SWITCH_DEBOUNCE_S:
            self._switch = position
            self.request_mode(int(self.parameters[f"FLTMODE{position}"]), ModeReason.RC_SWITCH)

    def _wait_on_ground(self) -> None:
        t_s = self.t_s
        if not self._spinning and t_s >= self._armed_at_s + ARMING_DELAY_S:
            self._spinning = True
            self.vehicle.spin()
        if self.mode in ARMABLE and self.mode is not Mode.GUIDED:
            if not self._pilot.wants_to_lift(self.mode, t_s):
                self._lift_at_s = None
            elif self._lift_at_s is None:
                self._lift_at_s = max(t_s, self._armed_at_s + ARMING_DELAY_S + GROUND_IDLE_S) + LIFT_S
        elif self.mode is Mode.GUIDED and not self.guided.climbing:
            self._lift_at_s = None
        if self._lift_at_s is not None and t_s >= self._lift_at_s:
            self._lift_at_s = None
            self.land_complete = False
            self._ground_since_s = t_s
            self.motion.restart()
            self._pilot.enter()
            return
        self._disarm_on_ground(t_s)

    def _disarm_on_ground(self, t_s: float) -> None:
        """After a landing, or when nobody takes off."""
        landing = self.mode in (Mode.LAND, Mode.RTL)
        if landing and t_s - max(self._landed_at_s, self._armed_at_s) >= DISARM_AFTER_LANDED_S:
            self.disarm(force=True)
            return
        if self.rc.throttle_us(t_s) > THROTTLE_CLOSED_US or self._lift_at_s is not None:
            self._throttle_up_at_s = t_s
        delay_s = self.parameters["DISARM_DELAY"]
        if delay_s > 0 and t_s - max(self._throttle_up_at_s, self._landed_at_s) >= delay_s:
            self.disarm(force=True)

    def _fly(self, dt_s: float) -> None:
        if self.mode is Mode.GUIDED:
            self.guided.run(self.t_s, dt_s)
        elif self.mode is Mode.LAND:
            self._automatic.land(self.t_s, dt_s)
        elif self.mode is Mode.RTL:
            self._automatic.return_home(self.t_s, dt_s)
        elif self.mode is Mode.BRAKE:
            self._automatic.brake(self.t_s, dt_s)
        else:
            self._pilot.run(self.mode, self.t_s, dt_s)

    def _detect_landing(self) -> None:
        """On the ground for a while: landed, motors back to idle."""
        if self.land_complete or not self.vehicle.on_ground:
            self._ground_since_s = None
            return
        if self._ground_since_s is None:
            self._ground_since_s = self.t_s
        elif self.t_s - self._ground_since_s >= LANDED_AFTER_S:
            self.land_complete = True
            self._landed_at_s = self.t_s
            self.vehicle.spin()
