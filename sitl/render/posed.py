"""Where cars and persons are at a time, corners and boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sitl.world.mesh import Mesh
from sitl.world.motion import Placement
from sitl.world.world import World

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """A mover at one time: body, place, and its corners in NED (V, 3)."""

    name: str
    number: int
    placement: Placement
    mesh: Mesh
    corners: FloatArray
    origin: FloatArray  # NED (3,)
    middle: FloatArray  # of the upright box, NED (3,)
    half: FloatArray  # its half sizes, along its own axes
    turn: FloatArray  # (3, 3): body coordinates @ turn = NED directions

    @property
    def box(self) -> tuple[FloatArray, FloatArray, float]:
        """Middle (NED), half sizes and yaw of its upright box."""
        return self.middle, self.half, self.placement.yaw_rad


def pose_movers(world: World, t_s: float) -> list[Posed]:
    """All cars and persons at a time, numbered from 1."""
    if not world.movers:
        return []
    placements = list(world.placements(t_s).values())
    meshes = [mover.mesh_at(place, world.scale) for mover, place in zip(world.movers, placements, strict=True)]
    yaws = np.array([place.yaw_rad for place in placements])
    turns = np.zeros((len(meshes), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(yaws)
    turns[:, 0, 1] = np.sin(yaws)
    turns[:, 1, 0] = -turns[:, 0, 1]
    turns[:, 2, 2] = 1.0
    origins = np.array([(place.north_m, place.east_m, 0.0) for place in placements])
    middles = (np.array([mesh.middle for mesh in meshes])[:, None] @ turns)[:, 0] + origins
    posed = []
    for k, (mover, place, mesh) in enumerate(zip(world.movers, placements, meshes, strict=True)):
        corners = mesh.vertices @ turns[k] + origins[k]
        posed.append(Posed(mover.name, k + 1, place, mesh, corners, origins[k], middles[k], mesh.half, turns[k]))
    return posed
