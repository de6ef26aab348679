"""The simulated vehicle with its autopilot, gimbal and world, made from a scenario and a seed."""

from __future__ import annotations

import math

from sitl.autopilot.arducopter import ArduCopter
from sitl.autopilot.config import ArduCopterConfig
from sitl.feed import Exposure
from sitl.plant.gimbal import GimbalPlant
from sitl.plant.pose import camera_pose
from sitl.plant.quadrotor import Quadrotor
from sitl.scenario.build import gimbal_params, quadrotor_params, wind, world_spec
from sitl.scenario.schema import Scenario, Vary
from sitl.scenario.seeds import seed_for
from sitl.scene import Vector
from sitl.world.world import World

PHYSICS_HZ = 400
# MNT1_TYPE: a servo mount reports what it was told, a MAVLink gimbal what its encoders say.
MOUNT_TYPES = {"commanded": 1.0, "measured": 6.0}


class Flight:
    """Everything physical of a run."""

    def __init__(self, scenario: Scenario, seed: int, world: World, physics_hz: int = PHYSICS_HZ) -> None:
        v = scenario.vehicle
        self.world = world
        self.vehicle = Quadrotor(
            quadrotor_params(scenario),
            wind(scenario, seed),
            (v.start_north_m, v.start_east_m, 0.0),
            math.radians(v.start_yaw_deg),
        )
        self.gimbal = GimbalPlant(gimbal_params(scenario))
        config = ArduCopterConfig(physics_hz=physics_hz, parameters={"MNT1_TYPE": MOUNT_TYPES[scenario.gimbal.report]})
        self.autopilot = ArduCopter(self.vehicle, self.gimbal, config, seed_for(scenario, seed, Vary.NOISE))

    def exposure(self, seq: int, now_s: float, scene_s: float, available_s: float) -> Exposure:
        """What the shutter catches now."""
        return Exposure(
            seq=seq,
            t_s=now_s,
            scene_s=scene_s,
            available_s=available_s,
            pose=camera_pose(self.vehicle, self.gimbal),
            vehicle_pos_ned_m=self.vehicle.pos_ned_m,
            vehicle_vel_ned_m_s=self.vehicle.vel_ned_m_s,
            vehicle_yaw_rad=self.vehicle.yaw_rad,
        )

    def target_at(self, name: str, scene_s: float) -> tuple[Vector, Vector]:
        """True place (on the ground) and velocity of a mover."""
        place = self.world.placements(scene_s)[name]
        velocity = (place.speed_m_s * math.cos(place.yaw_rad), place.speed_m_s * math.sin(place.yaw_rad), 0.0)
        return (place.north_m, place.east_m, 0.0), velocity


def build_world(scenario: Scenario, seed: int) -> World:
    """The world of a run; raises WorldError (ValueError) when it is impossible."""
    return World(world_spec(scenario, seed), seed_for(scenario, seed, Vary.TEXTURE))
