from __future__ import annotations

import math
from dataclasses import replace

import pytest

from sitl.render.bench import street_spec
from sitl.world.checks import WorldError, check_world
from sitl.world.spec import (
    BridgeSpec,
    BuildingSpec,
    CarBody,
    CarSpec,
    PathSpec,
    PersonSpec,
    RoadSpec,
    TreeSpec,
    WorldSpec,
)
from tests.sitl.world.builders import parked, small_world, walker

WAY = PathSpec(((-20.0, 0.0), (20.0, 0.0)), 5.0)
CAR = CarSpec("car", CarBody.SEDAN, (1, 2, 3), WAY)


def test_the_street_and_the_empty_world_are_possible() -> None:
    check_world(street_spec())
    check_world(WorldSpec())


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        (
            small_world(cars=(CAR,), buildings=(BuildingSpec(0.0, 3.0, 8.0, 5.0, 6.0),)),
            ("car", "through", "building 0"),
        ),
        (small_world(buildings=(BuildingSpec(0.0, 0.0, 8.0, 5.0, 6.0),)), ("car", "starts in", "building 0")),
        (small_world(cars=(CAR,), trees=(TreeSpec(5.0, 0.5),)), ("car", "through", "trunk of tree 0", "north 5 m")),
        (small_world(persons=(walker(),), trees=(TreeSpec(9.0, 4.2),)), ("walker", "trunk")),
        (small_world(cars=(CAR,), bridges=(BridgeSpec(4.0, 6.0, 14.0, 3.0, yaw_rad=math.pi / 2),)), ("pillar",)),
        (small_world(cars=(CAR,), bridges=(BridgeSpec(4.0, 0.0, 18.0, 3.0, 1.2, yaw_rad=1.57),)), ("bridge 0",)),
        (small_world(cars=(parked("a"), parked("a", (9.0, 0.0)))), ("'a'", "twice")),
        (small_world(cars=(parked(""),)), ("no name",)),
        (small_world(cars=(replace(CAR, scale=0.0),)), ("car", "scale")),
        (small_world(cars=(replace(CAR, path=replace(WAY, speed_m_s=math.nan)),)), ("speed_m_s", "finite")),
        (small_world(cars=(replace(CAR, path=replace(WAY, speed_m_s=0.0)),)), ("car", "speed_m_s is 0")),
        (small_world(cars=(replace(CAR, path=PathSpec(())),)), ("car", "no point")),
        (small_world(persons=(PersonSpec("p", (1, 1, 1), WAY, -1.0),)), ("'p'", "height_m")),
        (small_world(buildings=(BuildingSpec(20.0, 20.0, 8.0, math.inf, 6.0),)), ("width_m", "finite")),
        (small_world(roads=(RoadSpec(((0.0, 0.0),)),)), ("road 0", "two points")),
        (small_world(size_m=0.0), ("size_m",)),
    ],
)
def test_what_cannot_be_is_one_line_with_object_and_place(spec: WorldSpec, words: tuple[str, ...]) -> None:
    with pytest.raises(WorldError) as caught:
        check_world(spec)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


def test_a_tree_or_house_beside_the_way_is_fine() -> None:
    check_world(
        small_world(cars=(CAR,), trees=(TreeSpec(5.0, 1.4),), buildings=(BuildingSpec(0.0, 4.0, 8.0, 5.0, 6.0),))
    )


def test_a_turned_house_is_seen_as_it_stands() -> None:
    house = BuildingSpec(0.0, 8.0, 18.0, 4.0, 6.0)
    check_world(small_world(cars=(CAR,), buildings=(house,)))
    with pytest.raises(WorldError):
        check_world(small_world(cars=(CAR,), buildings=(replace(house, yaw_rad=math.pi / 2),)))
