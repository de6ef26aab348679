"""The plant behind the shaping of ArduPilot against a recorded flight of ArduCopter 4.7.0-dev (SITL, default tune).

The tables are LOCAL_POSITION_NED and ATTITUDE of `arducopter-guided.tlog` (tests' data of the autopilot), interpolated
at the time in the first column: seconds since the first message of the recording, as stamped by the companion.
"""

from __future__ import annotations

import math

import pytest

from sitl.plant.quadrotor import Quadrotor
from sitl.plant.shaping import VelocityShaper

DT_S = 1.0 / 400.0
# Velocity setpoints (NED, yaw rate) as the companion sent them, at 20 Hz, from these times on.
SETPOINTS = (
    (61.99, (3.0, 0.0, 0.0), 0.0),
    (66.99, (0.0, 0.0, 0.0), 0.0),
    (71.99, (0.0, 5.0, 0.0), 0.0),
    (76.99, (0.0, 0.0, 0.0), 0.0),
    (81.99, (0.0, 0.0, 0.0), 0.5),
    (86.99, (0.0, 0.0, 0.0), 0.0),
    (91.99, (0.0, 0.0, -1.0), 0.0),
    (96.99, (0.0, 0.0, 0.0), 0.0),
)
END_S = 102.0
# WPNAV_ACCEL, WPNAV_ACCEL_Z and PSC_JERK_XY, PSC_JERK_Z of the recorded vehicle.
ACCEL_M_S2, ACCEL_UP_M_S2, JERK_M_S3 = 2.5, 1.0, 5.0

# t_s, velocity north m/s, pitch rad: 3 m/s north, then stop
NORTH = (
    (62.25, 0.053, -0.073),
    (62.50, 0.411, -0.222),
    (62.75, 1.054, -0.303),
    (63.00, 1.739, -0.313),
    (63.25, 2.301, -0.246),
    (63.50, 2.601, -0.173),
    (63.75, 2.749, -0.133),
    (64.00, 2.820, -0.116),
    (64.50, 2.888, -0.107),
    (65.00, 2.935, -0.108),
    (65.50, 2.979, -0.109),
    (66.00, 3.009, -0.106),
    (66.50, 3.018, -0.103),
    (67.00, 3.015, -0.102),
    (67.25, 2.948, -0.028),
    (67.50, 2.601, 0.126),
    (67.75, 1.961, 0.217),
    (68.00, 1.295, 0.232),
    (68.25, 0.726, 0.165),
    (68.50, 0.398, 0.090),
    (68.75, 0.226, 0.048),
    (69.00, 0.138, 0.026),
    (69.50, 0.051, 0.013),
    (70.00, 0.001, 0.010),
    (70.50, -0.032, 0.007),
    (71.00, -0.051, 0.005),
    (71.50, -0.056, 0.002),
    (72.00, -0.050, 0.0),
)

# t_s, velocity east m/s, roll rad: 5 m/s east, then stop
EAST = (
    (72.25, 0.074, 0.076),
    (72.50, 0.420, 0.225),
    (72.75, 1.072, 0.310),
    (73.00, 1.767, 0.322),
    (73.25, 2.409, 0.330),
    (73.50, 3.028, 0.344),
    (73.75, 3.620, 0.364),
    (74.00, 4.154, 0.333),
    (74.25, 4.489, 0.276),
    (74.50, 4.663, 0.243),
    (74.75, 4.769, 0.231),
    (75.00, 4.847, 0.227),
    (75.50, 4.970, 0.227),
    (76.00, 5.060, 0.223),
    (76.50, 5.110, 0.218),
    (77.00, 5.121, 0.212),
    (77.25, 5.055, 0.138),
    (77.50, 4.708, -0.016),
    (77.75, 4.085, -0.114),
    (78.00, 3.433, -0.141),
    (78.25, 2.794, -0.162),
    (78.50, 2.166, -0.187),
    (78.75, 1.534, -0.214),
    (79.00, 0.942, -0.179),
    (79.25, 0.543, -0.109),
    (79.50, 0.318, -0.062),
    (79.75, 0.183, -0.038),
    (80.00, 0.095, -0.025),
    (80.50, -0.009, -0.012),
    (81.00, -0.058, -0.004),
    (81.50, -0.071, 0.002),
    (82.00, -0.058, 0.005),
)

# t_s, velocity up m/s: 1 m/s up, then stop
UP = (
    (92.20, 0.048),
    (92.40, 0.216),
    (92.60, 0.423),
    (92.80, 0.647),
    (93.00, 0.867),
    (93.20, 1.008),
    (93.40, 1.066),
    (93.60, 1.078),
    (93.80, 1.064),
    (94.00, 1.040),
    (94.20, 1.017),
    (95.00, 0.975),
    (96.00, 0.986),
    (97.00, 0.992),
    (97.20, 0.944),
    (97.40, 0.774),
    (97.60, 0.566),
    (97.80, 0.344),
    (98.00, 0.122),
    (98.20, -0.016),
    (98.40, -0.073),
    (98.60, -0.083),
    (98.80, -0.067),
    (99.00, -0.043),
    (99.20, -0.019),
    (100.00, 0.022),
    (101.00, 0.010),
)

# t_s, yaw rate rad/s, yaw rad (continuous): 0.5 rad/s, then stop
YAW = (
    (82.10, 0.023, 0.0),
    (82.20, 0.165, 0.010),
    (82.30, 0.349, 0.037),
    (82.40, 0.494, 0.081),
    (82.50, 0.579, 0.136),
    (82.60, 0.612, 0.196),
    (82.70, 0.609, 0.257),
    (82.80, 0.587, 0.316),
    (82.90, 0.557, 0.373),
    (83.00, 0.530, 0.427),
    (83.10, 0.510, 0.478),
    (83.20, 0.498, 0.529),
    (83.30, 0.493, 0.578),
    (83.40, 0.492, 0.627),
    (83.50, 0.494, 0.676),
    (84.00, 0.505, 0.927),
    (85.00, 0.504, 1.431),
    (86.00, 0.504, 1.932),
    (87.00, 0.504, 2.436),
    (87.10, 0.479, 2.485),
    (87.20, 0.342, 2.524),
    (87.30, 0.156, 2.547),
    (87.40, 0.009, 2.553),
    (87.50, -0.076, 2.548),
    (87.60, -0.108, 2.538),
    (87.70, -0.104, 2.528),
    (87.80, -0.081, 2.518),
    (87.90, -0.053, 2.512),
    (88.00, -0.026, 2.508),
    (88.10, -0.007, 2.507),
    (88.20, 0.005, 2.507),
    (88.30, 0.010, 2.508),
    (88.40, 0.011, 2.509),
    (88.50, 0.009, 2.510),
    (89.00, -0.001, 2.511),
    (90.00, -0.001, 2.509),
)


def _moment(quad: Quadrotor) -> dict[str, float]:
    north, east, down = quad.vel_ned_m_s
    return {
        "north": north,
        "east": east,
        "up": -down,
        "roll": quad.roll_rad,
        "pitch": quad.pitch_rad,
        "yaw": quad.yaw_rad,
        "yaw_rate": quad.euler_rates_rad_s[2],
        "height": -quad.pos_ned_m[2],
    }


@pytest.fixture(scope="module")
def flight() -> dict[float, dict[str, float]]:
    """The flight again: the state of the vehicle by time, 400 times a second."""
    quad = Quadrotor(pos_ned_m=(0.0, 0.0, -12.0))
    quad.hover()
    horizontal, vertical = VelocityShaper(ACCEL_M_S2, JERK_M_S3, 2), VelocityShaper(ACCEL_UP_M_S2, JERK_M_S3)
    start_s = SETPOINTS[0][0] - 1.0
    setpoints = list(SETPOINTS)
    target, yaw_rate = (0.0, 0.0, 0.0), 0.0
    states = {}
    for index in range(round((END_S - start_s) / DT_S)):
        t_s = start_s + index * DT_S
        if setpoints and t_s >= setpoints[0][0] - 1e-6:
            _, target, yaw_rate = setpoints.pop(0)
        north, east = horizontal.step(target[:2], DT_S)
        (down,) = vertical.step(target[2:], DT_S)
        quad.command((north, east, down), yaw_rate, t_s, (*horizontal.accel, *vertical.accel))
        quad.step(t_s, DT_S)
        states[round(t_s + DT_S, 4)] = _moment(quad)
    assert not setpoints
    return states


def _differences(
    flight: dict[float, dict[str, float]], table: tuple[tuple[float, ...], ...], column: int, name: str
) -> list[float]:
    return [flight[row[0]][name] - row[column] for row in table]


def _rms(values: list[float]) -> float:
    return math.sqrt(sum(v * v for v in values) / len(values))


# The attitude of the recording has a trim of up to 0.3 degrees, and its air is not quite still.
@pytest.mark.parametrize(
    ("table", "column", "name", "rms", "most"),
    [
        (NORTH, 1, "north", 0.05, 0.09),
        (EAST, 1, "east", 0.06, 0.11),
        (UP, 1, "up", 0.06, 0.11),
        (NORTH, 2, "pitch", math.radians(0.7), math.radians(1.8)),
        (EAST, 2, "roll", math.radians(0.8), math.radians(1.8)),
        (YAW, 1, "yaw_rate", 0.012, 0.03),
        (YAW, 2, "yaw", math.radians(1.0), math.radians(1.5)),
    ],
)
def test_agrees_with_the_recording(
    flight: dict[float, dict[str, float]],
    table: tuple[tuple[float, ...], ...],
    column: int,
    name: str,
    rms: float,
    most: float,
) -> None:
    differences = _differences(flight, table, column, name)
    assert _rms(differences) < rms
    assert max(abs(d) for d in differences) < most


@pytest.mark.parametrize(("t_s", "name"), [(71.98, "north"), (81.98, "east"), (101.98, "up")])
def test_less_residue_than_recorded_five_seconds_after_a_stop(
    flight: dict[float, dict[str, float]], t_s: float, name: str
) -> None:
    assert abs(flight[t_s][name]) < 0.03


def test_height_is_kept_while_it_accelerates(flight: dict[float, dict[str, float]]) -> None:
    heights = [state["height"] for t_s, state in flight.items() if t_s < SETPOINTS[6][0]]
    assert max(heights) - 12.0 < 0.03
    assert 12.0 - min(heights) < 0.03


def test_yaw_overshoots_as_recorded(flight: dict[float, dict[str, float]]) -> None:
    peak = max(state["yaw_rate"] for state in flight.values())
    rebound = min(state["yaw_rate"] for state in flight.values())
    assert peak == pytest.approx(0.614, abs=0.03)
    assert rebound == pytest.approx(-0.110, abs=0.03)
