from __future__ import annotations

import math

import pytest

from sitl.autopilot.modes import ModeReason
from tests.sitl.autopilot.rig import (
    ACCEPTED,
    ALT_HOLD,
    AUTO,
    BRAKE,
    GUIDED,
    LAND,
    LOITER,
    RTL,
    STABILIZE,
    STICKS,
    Rig,
    Station,
)

ROLL, PITCH, THROTTLE, YAW, SWITCH = range(5)


def flying(height_m: float = 5.0, yaw_rad: float = 0.0, **parameters: float) -> Rig:
    rig = Rig(yaw_rad=yaw_rad, **parameters)
    rig.take_off(height_m)
    return rig


def sticks(**moved: int) -> tuple[int, ...]:
    names = {"roll": ROLL, "pitch": PITCH, "throttle": THROTTLE, "yaw": YAW, "switch": SWITCH}
    values = list(STICKS)
    for name, value in moved.items():
        values[names[name]] = value
    return tuple(values)


def override(who: Station, **moved: int) -> None:
    values = [moved.get(name, 65535) for name in ("roll", "pitch", "throttle", "yaw", "switch")]
    who.mav.rc_channels_override_send(1, 1, *values, 65535, 65535, 65535)


def beat(who: Station) -> None:
    who.mav.heartbeat_send(6, 8, 0, 0, 4)


@pytest.mark.parametrize("mode", [LOITER, 16])
def test_loiter_with_centred_sticks_holds(mode):
    rig = flying()
    rig.fly(3.0, (3.0, 1.0, 0.0))
    rig.mode(mode)
    rig.run(4.0)
    place = rig.vehicle.pos_ned_m
    rig.run(4.0)
    assert rig.vehicle.pos_ned_m == pytest.approx(place, abs=0.1)


@pytest.mark.parametrize(
    ("moved", "axis", "sign"),
    [({"pitch": 1300}, 0, 1), ({"pitch": 1700}, 0, -1), ({"roll": 1700}, 1, 1), ({"roll": 1300}, 1, -1)],
)
def test_loiter_obeys_the_sticks(moved, axis, sign):
    """Pitch stick forward is a short pulse and flies along the nose, roll stick right is to its right."""
    yaw_rad = 0.7
    rig = flying(yaw_rad=yaw_rad)
    rig.mode(LOITER)
    rig.autopilot.set_rc(sticks(**moved))
    rig.run(3.0)
    north, east, _ = rig.vehicle.vel_ned_m_s
    forward = math.cos(yaw_rad) * north + math.sin(yaw_rad) * east
    right = -math.sin(yaw_rad) * north + math.cos(yaw_rad) * east
    assert sign * (forward, right)[axis] > 2.0
    assert abs((right, forward)[axis]) < 0.3


def test_loiter_yaw_and_throttle():
    rig = flying()
    rig.mode(LOITER)
    rig.autopilot.set_rc(sticks(yaw=1600))
    rig.run(1.0)
    assert rig.vehicle.rates_rad_s[2] > 0.2
    rig.autopilot.set_rc(sticks(throttle=2000))
    rig.run(3.0)
    assert rig.vehicle.vel_ned_m_s[2] == pytest.approx(-2.5, abs=0.1)
    rig.autopilot.set_rc(STICKS)
    rig.run(4.0)
    height = rig.vehicle.pos_ned_m[2]
    rig.run(2.0)
    assert rig.vehicle.pos_ned_m[2] == pytest.approx(height, abs=0.05)


@pytest.mark.parametrize("mode", [LOITER, ALT_HOLD])
def test_a_throttle_left_down_descends(mode):
    rig = flying(8.0)
    rig.autopilot.set_rc(sticks(throttle=1000))
    rig.mode(mode)
    rig.run(2.5)
    assert rig.vehicle.vel_ned_m_s[2] == pytest.approx(2.5, abs=0.1)


def test_alt_hold_drifts_and_keeps_the_height():
    rig = flying()
    rig.mode(ALT_HOLD)
    rig.autopilot.set_rc(sticks(pitch=1400))
    rig.run(3.0)
    rig.autopilot.set_rc(STICKS)
    rig.run(1.0)
    assert rig.vehicle.vel_ned_m_s[0] > 0.8
    assert rig.vehicle.pos_ned_m[2] == pytest.approx(-5.0, abs=0.2)


def test_the_pilot_can_take_off_and_land():
    rig = Rig()
    rig.mode(LOITER)
    rig.arm()
    rig.autopilot.set_rc(sticks(throttle=1800))
    rig.run(7.0)
    assert rig.vehicle.pos_ned_m[2] < -3.0
    rig.autopilot.set_rc(sticks(throttle=1000))
    rig.run(12.0)
    assert rig.vehicle.on_ground
    assert rig.autopilot.state.landed_state == 1
    rig.run(12.0)
    assert not rig.autopilot.state.armed


def test_stabilize_has_no_height_control():
    rig = flying()
    rig.mode(STABILIZE)
    rig.autopilot.set_rc(sticks(throttle=1400))
    rig.run(2.0)
    assert rig.vehicle.vel_ned_m_s[2] == pytest.approx(1.0, abs=0.2)


def test_brake_stops_and_holds():
    rig = flying()
    rig.fly(4.0, (5.0, 0.0, 0.0))
    rig.mode(BRAKE)
    rig.run(2.5)
    assert rig.speed < 0.3
    rig.run(2.0)
    place = rig.vehicle.pos_ned_m
    rig.run(3.0)
    assert rig.vehicle.pos_ned_m == pytest.approx(place, abs=0.1)


def test_return_to_launch():
    rig = flying(5.0)
    rig.fly(8.0, (5.0, 2.0, 0.0))
    assert rig.command(20) == ACCEPTED
    assert rig.autopilot.state.mode == RTL
    far_m = math.hypot(*rig.vehicle.pos_ned_m[:2])
    highest_m = 0.0
    while rig.autopilot.state.armed:
        rig.run(0.5)
        highest_m = max(highest_m, -rig.vehicle.pos_ned_m[2])
        assert rig.t_s < 150.0
    assert far_m > 25.0
    assert highest_m == pytest.approx(15.0, abs=0.4)
    assert math.hypot(*rig.vehicle.pos_ned_m[:2]) < 1.0
    assert rig.vehicle.on_ground


# --- switch and override -----------------------------------------------------------------------------------------


def test_the_mode_switch():
    rig = flying()
    rig.autopilot.set_rc(sticks(switch=1700))  # fifth position: LOITER
    before_s = rig.t_s
    rig.run(0.1)
    assert rig.autopilot.state.mode == GUIDED  # not yet: it has to rest there
    rig.run(0.3)
    assert rig.autopilot.state.mode == LOITER
    assert rig.autopilot.state.mode_reason is ModeReason.RC_SWITCH
    assert rig.companion.of("HEARTBEAT", before_s)[-1].custom_mode == LOITER
    assert rig.mode(GUIDED) == ACCEPTED  # accepted while the switch is not touched
    rig.run(1.0)
    assert rig.autopilot.state.mode == GUIDED


def test_a_switch_to_a_mode_that_cannot_start_changes_nothing():
    rig = flying(FLTMODE4=AUTO)
    rig.autopilot.set_rc(sticks(switch=1550))
    rig.run(0.5)
    assert rig.autopilot.state.mode == GUIDED
    assert any(t.startswith("Mode change to AUTO failed") for t in rig.texts())


def test_an_override_runs_out_and_the_switch_below_shows():
    rig = flying()
    rig.companion.heard.clear()
    rig.command(511, 65, 200_000)
    rig.run(1.0, lambda: override(rig.station, switch=1700, throttle=1500))
    assert rig.autopilot.state.mode == LOITER
    assert rig.companion.last("RC_CHANNELS").chan5_raw == 1700
    rig.run(2.9)
    assert rig.autopilot.state.mode == LOITER
    rig.run(0.5)
    assert rig.autopilot.state.mode == STABILIZE  # the sixth position


def test_an_override_can_be_given_back():
    rig = flying()
    rig.mode(LOITER)
    rig.run(1.0, lambda: override(rig.station, pitch=1300))
    assert rig.speed > 0.5
    override(rig.station, pitch=0)
    rig.run(4.0)
    assert rig.speed < 0.2


def test_only_the_ground_station_may_override():
    rig = flying()
    rig.mode(LOITER)
    rig.run(2.0, lambda: override(rig.companion, pitch=1300))
    assert rig.speed < 0.1


# --- failsafes ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pwm", [sticks(throttle=950), None], ids=["throttle low", "no receiver"])
def test_radio_failsafe_returns_and_is_not_undone(pwm):
    rig = flying()
    rig.autopilot.set_rc(pwm)
    rig.run(0.1 if pwm else 1.2)
    assert rig.autopilot.state.mode == RTL
    assert rig.autopilot.state.mode_reason is ModeReason.RADIO_FAILSAFE
    assert rig.companion.last("HEARTBEAT").system_status == 5
    assert any("Radio Failsafe" in t for t in rig.texts())
    rig.autopilot.set_rc(STICKS)
    rig.run(1.2)
    assert rig.autopilot.state.mode == RTL
    assert rig.companion.last("HEARTBEAT").system_status == 4
    assert rig.mode(GUIDED) == ACCEPTED


def test_radio_failsafe_can_land_or_be_off():
    rig = flying(FS_THR_ENABLE=3)
    rig.autopilot.set_rc(None)
    rig.run(1.2)
    assert rig.autopilot.state.mode == LAND
    rig = flying(FS_THR_ENABLE=0)
    rig.autopilot.set_rc(None)
    rig.run(3.0)
    assert rig.autopilot.state.mode == GUIDED


def test_radio_failsafe_on_the_ground_disarms_and_keeps_from_arming():
    rig = Rig()
    rig.mode(GUIDED)
    rig.arm()
    rig.run(1.0)
    rig.autopilot.set_rc(None)
    rig.run(1.5)
    assert not rig.autopilot.state.armed
    rig.arm()
    assert not rig.autopilot.state.armed
    assert "Arm: Radio failsafe on" in rig.texts()


def test_gcs_failsafe():
    rig = flying(FS_GCS_ENABLE=1)
    rig.fly(3.0, (1.0, 0.0, 0.0))
    assert rig.autopilot.state.mode == GUIDED  # never heard, so never missed
    rig.run(6.0, lambda: (beat(rig.station), beat(rig.companion)))
    assert rig.autopilot.state.mode == GUIDED
    rig.run(4.8, lambda: beat(rig.companion))
    assert rig.autopilot.state.mode == GUIDED
    rig.run(0.4, lambda: beat(rig.companion))  # the companion's heartbeat does not stand in
    assert rig.autopilot.state.mode == RTL
    assert rig.autopilot.state.mode_reason is ModeReason.GCS_FAILSAFE
    rig.run(1.0)
    assert rig.companion.last("HEARTBEAT").system_status == 5
    assert rig.mode(GUIDED) == ACCEPTED  # it could be overridden (and must not be)
    rig.run(2.0)
    assert rig.autopilot.state.mode == GUIDED


def test_losing_the_companion_or_a_gcs_without_the_failsafe_does_nothing():
    rig = flying()
    rig.run(2.0, lambda: (beat(rig.station), beat(rig.companion)))
    rig.run(10.0)
    assert rig.autopilot.state.mode == GUIDED
    assert not rig.autopilot.state.failsafe
