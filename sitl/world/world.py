"""The world of a scenario: everything that stands or moves in it, ready to be drawn or cast rays at."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sitl.world.cars import car_mesh
from sitl.world.checks import WorldError, check_world
from sitl.world.facade import Painter
from sitl.world.ground import Ground, build_ground
from sitl.world.light import Light
from sitl.world.mesh import Mesh
from sitl.world.motion import Path, Placement
from sitl.world.noise import Grain
from sitl.world.person import person_meshes, pose_index
from sitl.world.solid import Solid
from sitl.world.spec import PersonSpec, WorldSpec
from sitl.world.structures import bridge_solids, building_solids
from sitl.world.trees import crown_sprites, make_tree

__all__ = ["Mover", "World", "WorldError", "check_world"]

# One stream of random numbers each, so that a further tree does not change the houses.
LIGHT, GRAIN, GROUND, HOUSES, BRIDGES, TREES = range(6)


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """A car or person: its way and its body, in as many poses as it has (1 for a car)."""

    name: str
    path: Path
    meshes: tuple[Mesh, ...]
    person: PersonSpec | None = None

    def mesh_at(self, placement: Placement, scale: float) -> Mesh:
        """The body in the pose that belongs to the way gone so far, in a world `scale` times as large."""
        if self.person is None:
            return self.meshes[0]
        return self.meshes[pose_index(self.person, placement.travelled_m / scale)]


class World:
    """Built once for a specification and a seed: the seed draws textures, light, brightness and tints.

    Raises `WorldError` (a ValueError) when the specification cannot be. All positions are NED metres.
    """

    def __init__(self, spec: WorldSpec, seed: int) -> None:
        check_world(spec)
        self.spec, self.seed = spec, seed
        self.scale, self.is_mirrored = 1.0, False
        self.light = Light.draw(_stream(seed, LIGHT))
        grain = Grain(_stream(seed, GRAIN))
        solids: list[Solid] = []
        for i, house in enumerate(spec.buildings):
            solids += building_solids(house, f"building {i}", self.light, Painter(_stream(seed, HOUSES, i), grain))
        for i, bridge in enumerate(spec.bridges):
            solids += bridge_solids(bridge, f"bridge {i}", self.light, Painter(_stream(seed, BRIDGES, i), grain))
        rng = _stream(seed, TREES)
        sprites = crown_sprites(self.light, rng) if spec.trees else []
        trees = [
            make_tree(tree, sprites[int(rng.integers(len(sprites)))], bool(rng.random() < 0.5)) for tree in spec.trees
        ]
        self.solids, self.trees = tuple(solids), tuple(trees)
        self.ground: Ground = build_ground(spec, self.light, Painter(_stream(seed, GROUND), grain), solids, trees)
        self.movers = (
            *(Mover(car.name, Path(car.path), (car_mesh(car),)) for car in spec.cars),
            *(Mover(person.name, Path(person.path), person_meshes(person), person) for person in spec.persons),
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of everything that can move: cars, then persons."""
        return tuple(mover.name for mover in self.movers)

    def placements(self, t_s: float) -> dict[str, Placement]:
        """Where every car and person is at a time."""
        places = {m.name: m.path.at(t_s) for m in self.movers}
        if self.scale == 1.0 and not self.is_mirrored:
            return places
        return {name: place.mapped(self.scale, self.is_mirrored) for name, place in places.items()}

    def mirrored(self) -> World:
        """The same world with east and west exchanged, pictures of all surfaces included."""
        return self._mapped(1.0, True)

    def scaled(self, factor: float) -> World:
        """The same world `factor` times as large, texels and speeds included."""
        if not 0 < factor < float("inf"):
            raise ValueError(f"factor is {factor}, must be above 0 and finite")
        return self._mapped(factor, False)

    def _mapped(self, scale: float, mirror: bool) -> World:
        other = object.__new__(World)
        other.spec, other.seed = self.spec, self.seed
        other.scale, other.is_mirrored = self.scale * scale, self.is_mirrored != mirror
        other.light = self.light.mapped(mirror)
        other.ground = self.ground.mapped(scale, mirror)
        other.solids = tuple(solid.mapped(scale, mirror) for solid in self.solids)
        other.trees = tuple(tree.mapped(scale, mirror) for tree in self.trees)
        other.movers = tuple(
            replace(m, meshes=tuple(mesh.mapped(scale, mirror) for mesh in m.meshes)) for m in self.movers
        )
        return other


def _stream(seed: int, *path: int) -> np.random.Generator:
    return np.random.default_rng([seed, *path])
