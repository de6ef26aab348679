from __future__ import annotations

import numpy as np
import pytest

from sitl.render.renderer import Renderer
from sitl.scene import CameraModel, CameraPose
from sitl.world.cars import car_half_size_m, car_mesh
from sitl.world.spec import CarBody, CarSpec, PathSpec, WorldSpec
from sitl.world.world import World

HEAVY = (CarBody.LORRY, CarBody.BUS, CarBody.BENDY_BUS)
RED = (200, 20, 20)


def car(name: str, body: CarBody, north_m: float, east_m: float) -> CarSpec:
    return CarSpec(name, body, RED, PathSpec(((north_m, east_m),)))


@pytest.mark.parametrize("body", HEAVY)
def test_a_car_behind_one_is_hidden_whole_and_beside_it_is_not(body: CarBody) -> None:
    """From the height of a low flight, in pixels: nothing shows under the body or over it."""
    half_length = car_half_size_m(car("x", body, 0, 0))[0]
    cars = (
        car("heavy", body, 0, 0),
        car("behind", CarBody.SEDAN, 0, 3.5),
        car("beside", CarBody.SEDAN, half_length + 6, 3.5),
    )
    world = World(WorldSpec(size_m=60, cars=cars), 1)
    renderer = Renderer(world, CameraModel(640, 480, np.radians(66.0), 0.0), 1)
    picture = renderer.render(0.0, CameraPose((0.0, -24.0, -10.5), 0.0, -0.38, np.pi / 2), 0)
    assert picture.truths["behind"].visibility == 0.0
    assert picture.truths["beside"].visibility == 1.0
    assert picture.truths["heavy"].visibility == 1.0


def test_the_cab_of_a_lorry_and_its_box_hide_each_other_as_they_stand() -> None:
    """Seen from ahead the cab is before the box, seen from behind it cannot be seen."""
    world = World(WorldSpec(size_m=60, cars=(car("lorry", CarBody.LORRY, 0, 0),)), 1)
    renderer = Renderer(world, CameraModel(640, 480, np.radians(50.0), 0.0), 1)
    shares = []
    for yaw in (np.pi, 0.0):  # from the north, where it is headed, and from the south
        north = -20.0 * np.cos(yaw)
        picture = renderer.render(0.0, CameraPose((float(north), 0.0, -2.5), 0.0, -0.05, float(yaw)), 0)
        box = picture.truths["lorry"].visible
        assert box is not None
        x0, y0, x1, y1 = (round(v) for v in box.to_corners())
        blue, green, red = np.moveaxis(picture.image_bgr_u8[y0:y1, x0:x1].astype(int), 2, 0)
        shares.append(float(((red > 1.6 * green) & (red > 1.6 * blue)).mean()))
    ahead, behind = shares
    assert ahead > 0.2
    assert behind < 0.1


def test_bellows_make_it_longer_not_other() -> None:
    bus, bendy = (car_mesh(car("x", body, 0, 0)) for body in (CarBody.BUS, CarBody.BENDY_BUS))
    assert bendy.high[0] - bendy.low[0] == pytest.approx(18.0, abs=0.1)
    assert bus.high[0] - bus.low[0] == pytest.approx(12.0, abs=0.1)
    assert bendy.low[2] == bus.low[2]
