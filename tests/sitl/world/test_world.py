from __future__ import annotations

import numpy as np
import pytest

from sitl.world.cars import car_half_size_m, car_mesh
from sitl.world.mesh import Mesh
from sitl.world.person import POSES, person_meshes
from sitl.world.spec import BuildingSpec, CarBody, CarSpec, PathSpec, TreeSpec
from sitl.world.world import World, WorldError
from tests.sitl.world.builders import parked, small_world, walker


@pytest.fixture(scope="module")
def world() -> World:
    house = BuildingSpec(12.0, 14.0, 9.0, 8.0, 7.0, 0.2)
    return World(small_world(buildings=(house,), trees=(TreeSpec(-9.0, 8.0),), persons=(walker(),)), 3)


def test_names_are_cars_then_persons(world: World) -> None:
    assert world.names == ("car", "walker")
    assert set(world.placements(1.0)) == {"car", "walker"}


def test_seed_alone_decides_the_looks() -> None:
    spec = small_world()
    a, b, c = World(spec, 1), World(spec, 1), World(spec, 2)
    assert np.array_equal(a.ground.levels[0], b.ground.levels[0])
    assert a.light == b.light
    assert a.light != c.light
    assert not np.array_equal(a.ground.levels[0], c.ground.levels[0])


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(WorldError, match="building 0"):
        World(small_world(buildings=(BuildingSpec(0.0, 0.0, 9.0, 8.0, 7.0),)), 0)


def test_mirror_twice_is_the_world_itself(world: World) -> None:
    twice = world.mirrored().mirrored()
    assert not twice.is_mirrored
    assert twice.placements(3.0) == world.placements(3.0)
    assert np.array_equal(twice.ground.u, world.ground.u)
    assert np.array_equal(twice.solids[0].faces[0].polygon, world.solids[0].faces[0].polygon)
    assert twice.light == world.light


def test_mirrored_and_scaled_placements(world: World) -> None:
    place, other = world.placements(4.0)["walker"], world.mirrored().scaled(2.0).placements(4.0)["walker"]
    assert (other.north_m, other.east_m) == pytest.approx((2 * place.north_m, -2 * place.east_m))
    assert other.speed_m_s == pytest.approx(2 * place.speed_m_s)


def test_scale_must_be_a_size(world: World) -> None:
    with pytest.raises(ValueError, match="factor"):
        world.scaled(0.0)


def _all_meshes() -> list[Mesh]:
    cars = [car_mesh(CarSpec("c", body, (90, 90, 90), PathSpec(((0.0, 0.0),)), 1.3)) for body in CarBody]
    return [*cars, *person_meshes(walker())]


@pytest.mark.parametrize("mesh", _all_meshes())
def test_faces_lie_on_their_planes_and_bodies_stand_on_the_ground(mesh: Mesh) -> None:
    for face, normal, offset in zip(mesh.faces, mesh.normals, mesh.offsets, strict=True):
        assert np.linalg.norm(normal) == pytest.approx(1.0)
        # Faces between rounded outlines are a little warped, by less than a centimetre or two.
        assert np.abs(mesh.vertices[face] @ normal - offset).max() < 0.03
    assert mesh.high[2] == pytest.approx(0.0, abs=0.16)
    assert mesh.samples.shape == mesh.sample_normals.shape
    inside = (mesh.samples >= mesh.low - 1e-9) & (mesh.samples <= mesh.high + 1e-9)
    assert inside.all()


@pytest.mark.parametrize("body", CarBody)
def test_a_car_is_as_large_as_it_says(body: CarBody) -> None:
    spec = CarSpec("c", body, (90, 90, 90), PathSpec(((0.0, 0.0),)), 1.2)
    mesh, (half_length, half_width, height) = car_mesh(spec), car_half_size_m(spec)
    assert mesh.high - mesh.low == pytest.approx([2 * half_length, 2 * half_width, height], abs=0.03)


def test_a_person_walks() -> None:
    poses = person_meshes(walker())
    assert len(poses) == POSES
    lengths = [float(mesh.high[0] - mesh.low[0]) for mesh in poses]
    assert max(lengths) > min(lengths) + 0.3
    assert poses[0].low[2] == pytest.approx(-1.75, abs=0.02)


def test_shade_under_a_tree_and_sun_beside_it(world: World) -> None:
    tree = world.trees[0]
    north, east = tree.base[:2] + np.array(world.light.shadow_per_height) * -tree.crown_centre[2]
    assert world.ground.sunlit_at(float(north), float(east)) < 0.5
    assert world.ground.sunlit_at(-25.0, -25.0) > 0.8
    assert world.ground.sunlit_at(1e6, 0.0) == 1.0
    mirrored = world.mirrored()
    assert mirrored.ground.sunlit_at(float(north), -float(east)) == world.ground.sunlit_at(float(north), float(east))


def test_parked_car_stays(world: World) -> None:
    assert world.placements(0.0)["car"] == world.placements(99.0)["car"]
    assert parked().path.points == ((0.0, 0.0),)
