"""The renderer's picture and truth: against an independent projection, mirrored, scaled, hidden, anywhere."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sitl.render.bench import chase_pose, street_spec
from sitl.render.geometry import GeometryCamera
from sitl.render.renderer import Picture, Renderer
from sitl.scene import CameraModel, CameraPose, ObjectTruth
from sitl.world.spec import BridgeSpec, BuildingSpec, TreeSpec
from sitl.world.world import World
from tests.sitl.world.builders import parked, small_world, walker
from tracker.box import Box

CAMERA = CameraModel()
SMALL = CameraModel(200, 150)


@pytest.fixture(scope="module")
def street() -> World:
    return World(street_spec(), 0)


@pytest.fixture(scope="module")
def street_renderer(street: World) -> Renderer:
    return Renderer(street, CAMERA, 0)


@pytest.fixture(scope="module")
def scene() -> World:
    """A house north of a car, a bridge over a second one, trees, a person in the open."""
    return World(
        small_world(
            cars=(parked(), parked("under", (18.0, 0.3), 0.4), parked("free", (-12.0, 9.0), 1.0)),
            persons=(walker(points=((-20.0, -6.0), (-8.0, -6.0))),),
            buildings=(BuildingSpec(8.0, -9.0, 10.0, 6.0, 6.0),),
            bridges=(BridgeSpec(18.0, 0.0, 16.0, 5.0, yaw_rad=math.pi / 2),),
            trees=(TreeSpec(-3.0, 6.0), TreeSpec(5.0, 7.0, 8.0, 5.0)),
        ),
        5,
    )


@pytest.fixture(scope="module")
def small_renderer(scene: World) -> Renderer:
    return Renderer(scene, SMALL, 0)


def look_at(eye: tuple[float, float, float], at: tuple[float, float, float], roll_rad: float = 0.0) -> CameraPose:
    """A pose from `eye` towards `at`, both NED."""
    n, e, d = (b - a for a, b in zip(eye, at, strict=True))
    return CameraPose(eye, roll_rad, math.atan2(-d, math.hypot(n, e)), math.atan2(e, n))


def project(camera: CameraModel, pose: CameraPose, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Independent projection: unwinds yaw, pitch and roll one after the other, by single rotations."""
    focal = camera.width_px / (2 * math.tan(camera.hfov_rad / 2))
    found = []
    for point in points:
        x, y, z = (float(p) - c for p, c in zip(point, pose.pos_ned_m, strict=True))
        x, y = (
            x * math.cos(pose.yaw_rad) + y * math.sin(pose.yaw_rad),
            y * math.cos(pose.yaw_rad) - x * math.sin(pose.yaw_rad),
        )
        x, z = (
            x * math.cos(pose.pitch_rad) - z * math.sin(pose.pitch_rad),
            z * math.cos(pose.pitch_rad) + x * math.sin(pose.pitch_rad),
        )
        y, z = (
            y * math.cos(pose.roll_rad) + z * math.sin(pose.roll_rad),
            z * math.cos(pose.roll_rad) - y * math.sin(pose.roll_rad),
        )
        found.append((camera.width_px / 2 + focal * y / x, camera.height_px / 2 + focal * z / x))
    return np.array(found)


def body_box(world: World, name: str, t_s: float, camera: CameraModel, pose: CameraPose) -> Box:
    """Box of all corners of a body, by the independent projection."""
    mover = next(m for m in world.movers if m.name == name)
    place = world.placements(t_s)[name]
    corners = []
    for x, y, z in mover.mesh_at(place, world.scale).vertices:
        corners.append(
            (
                place.north_m + x * math.cos(place.yaw_rad) - y * math.sin(place.yaw_rad),
                place.east_m + x * math.sin(place.yaw_rad) + y * math.cos(place.yaw_rad),
                z,
            )
        )
    pixels = project(camera, pose, np.array(corners))
    return Box.from_corners(*pixels.min(axis=0), *pixels.max(axis=0))


def near(a: Box, b: Box, tolerance_px: float) -> bool:
    return max(abs(p - q) for p, q in zip(a.to_corners(), b.to_corners(), strict=True)) <= tolerance_px


POSES = (
    look_at((-16.0, 3.0, -12.0), (0.0, 0.0, 0.0)),
    look_at((-2.0, -1.0, -15.0), (0.0, 0.0, 0.0), 0.3),
    look_at((14.0, 12.0, -9.0), (0.0, 1.0, 0.0), -0.2),
    look_at((-9.0, -8.0, -3.0), (0.0, 0.0, -1.0)),
)


@pytest.mark.parametrize("pose", POSES)
def test_truth_agrees_with_an_independent_projection(scene: World, pose: CameraPose) -> None:
    truths = Renderer(scene, CAMERA, 0).render(2.0, pose, 0).truths
    assert set(truths) == {"car", "under", "free", "walker"}
    for name, truth in truths.items():
        if truth.amodal is not None and truth.truncation < 1:
            assert near(truth.amodal, body_box(scene, name, 2.0, CAMERA, pose), 0.5)
    assert truths["car"].amodal is not None
    middle = np.array([0.0, 0.0, -0.72])
    assert truths["car"].range_m == pytest.approx(float(np.linalg.norm(middle - pose.pos_ned_m)), abs=0.02)
    centre = project(CAMERA, pose, middle[None])[0]
    assert truths["car"].centre_px == pytest.approx(tuple(centre), abs=1.0)


def test_the_pixels_are_where_the_truth_says(scene: World) -> None:
    """The same picture with and without the car differs in its box and (shadow apart) nowhere else."""
    pose = look_at((-12.0, -9.0, -9.0), (-12.0, 9.0, 0.0))
    bare = World(replace(scene.spec, cars=scene.spec.cars[:2]), 5)
    with_car, without = (Renderer(w, CAMERA, 0).render(0.0, pose, 0) for w in (scene, bare))
    box = with_car.truths["free"].amodal
    assert box is not None
    assert with_car.truths["free"].visibility == 1.0
    visible = with_car.truths["free"].visible
    assert visible is not None
    assert near(visible, box, 1.0)
    difference = np.abs(with_car.image_bgr_u8.astype(int) - without.image_bgr_u8).max(axis=2)
    x0, y0, x1, _ = (round(v) for v in box.to_corners())
    assert difference[: y0 - 3].max() <= 1  # above the car nothing has changed
    assert difference[y0 : y0 + 4, x0:x1].max() > 20


def test_same_arguments_give_the_same_bytes_in_any_order(scene: World) -> None:
    first, second = Renderer(scene, SMALL, 4), Renderer(World(scene.spec, 5), SMALL, 4)
    there = [first.render(i / 30, POSES[i % 4], i) for i in range(6)]
    back = {i: second.render(i / 30, POSES[i % 4], i) for i in reversed(range(6))}
    for i, picture in enumerate(there):
        assert np.array_equal(picture.image_bgr_u8, back[i].image_bgr_u8)
        assert picture.truths == back[i].truths
    other = first.render(0.0, POSES[0], 1)
    assert not np.array_equal(there[0].image_bgr_u8, other.image_bgr_u8)  # the noise follows the frame's number


def mirrored_pose(pose: CameraPose) -> CameraPose:
    (n, e, d), (p, q, r), (vn, ve, vd) = pose.pos_ned_m, pose.rates_rad_s, pose.vel_ned_m_s
    return CameraPose((n, -e, d), -pose.roll_rad, pose.pitch_rad, -pose.yaw_rad, (-p, q, -r), (vn, -ve, vd))


@pytest.mark.parametrize("base", POSES)
def test_mirrored_world_gives_the_mirrored_picture(scene: World, base: CameraPose) -> None:
    pose = replace(base, rates_rad_s=(0.0, 0.6, 0.9), vel_ned_m_s=(3.0, -4.0, 1.0))
    picture = Renderer(scene, CAMERA, 1).render(2.0, pose, 7)
    mirror = Renderer(scene.mirrored(), CAMERA, 1).render(2.0, mirrored_pose(pose), 7)
    difference = np.abs(picture.image_bgr_u8[:, ::-1].astype(int) - mirror.image_bgr_u8)
    assert difference.mean() < 0.6
    for name, truth in picture.truths.items():
        other = mirror.truths[name]
        assert other.range_m == pytest.approx(truth.range_m)
        assert other.visibility == pytest.approx(truth.visibility, abs=0.05)
        assert other.truncation == pytest.approx(truth.truncation, abs=1e-6)
        if truth.amodal is not None:
            assert other.amodal is not None
            flipped = replace(other.amodal, cx_px=CAMERA.width_px - other.amodal.cx_px)
            assert near(flipped, truth.amodal, 1e-6)


@pytest.mark.parametrize("base", POSES[:2])
def test_twice_as_large_and_twice_as_far_is_the_same_picture(scene: World, base: CameraPose) -> None:
    pose = replace(base, rates_rad_s=(0.0, 0.5, 0.2), vel_ned_m_s=(9.0, 4.0, -1.0))
    n, e, d = pose.pos_ned_m
    vn, ve, vd = pose.vel_ned_m_s
    far = replace(pose, pos_ned_m=(2 * n, 2 * e, 2 * d), vel_ned_m_s=(2 * vn, 2 * ve, 2 * vd))
    picture = Renderer(scene, CAMERA, 1).render(2.0, pose, 7)
    large = Renderer(scene.scaled(2.0), CAMERA, 1).render(2.0, far, 7)
    assert np.abs(picture.image_bgr_u8.astype(int) - large.image_bgr_u8).mean() < 0.3
    for name, truth in picture.truths.items():
        other = large.truths[name]
        assert other.range_m == pytest.approx(2 * truth.range_m)
        assert other.visibility == pytest.approx(truth.visibility, abs=0.02)
        if truth.amodal is not None:
            assert other.amodal is not None
            assert near(other.amodal, truth.amodal, 1e-6)


def observers(world: World, pose: CameraPose, t_s: float = 0.0) -> tuple[dict[str, ObjectTruth], ...]:
    return Renderer(world, CAMERA, 0).render(t_s, pose, 0).truths, GeometryCamera(world, CAMERA).observe(t_s, pose)


def test_hidden_behind_a_house_and_under_a_bridge_seen_in_the_open(scene: World) -> None:
    house = World(small_world(buildings=(BuildingSpec(-8.0, 0.0, 4.0, 12.0, 6.0),)), 0)
    for truths in observers(house, look_at((-22.0, 0.0, -4.0), (0.0, 0.0, 0.0))):
        assert truths["car"].visibility == 0.0
        assert truths["car"].visible is None
        assert truths["car"].amodal is not None
        assert truths["car"].truncation == 0.0
    for truths in observers(scene, look_at((17.9, 0.2, -24.0), (18.0, 0.3, 0.0))):
        assert truths["under"].visibility < 0.05
    for truths in observers(scene, look_at((-25.0, 9.0, -12.0), (-12.0, 9.0, 0.0))):
        assert truths["free"].visibility == 1.0
        assert truths["free"].visible is not None


def test_behind_the_camera_and_beyond_the_border(scene: World) -> None:
    for truths in observers(scene, look_at((-4.0, 0.0, -2.0), (-20.0, 0.0, 0.0))):
        assert truths["car"].amodal is None
        assert truths["car"].centre_px is None
        assert (truths["car"].visibility, truths["car"].truncation) == (0.0, 1.0)
    for truths in observers(scene, look_at((-12.0, -20.0, -10.0), (40.0, 9.0, 0.0))):
        assert truths["free"].amodal is not None
        assert truths["free"].truncation == 1.0
        assert truths["free"].visible is None
        assert truths["free"].visibility == 0.0


def test_geometry_camera_agrees_with_the_renderer(street: World, street_renderer: Renderer) -> None:
    """On the way behind trees, bridge and cars: same boxes, visibility alike on average and mostly one by one."""
    geometry = GeometryCamera(street, CAMERA)
    gaps, partial = [], 0
    for i in range(40):
        t = 0.45 * i
        pose = chase_pose(street, t, 18.0 + i % 5, 8.0 + i % 7)
        pose = replace(pose, pos_ned_m=(pose.pos_ned_m[0], pose.pos_ned_m[1] + (i % 3 - 1) * 9.0, pose.pos_ned_m[2]))
        at = street.placements(t)["target"]
        pose = look_at(pose.pos_ned_m, (at.north_m, at.east_m, -0.7))
        seen, cast = street_renderer.render(t, pose, i).truths, geometry.observe(t, pose)
        for name, truth in seen.items():
            assert cast[name].amodal == truth.amodal
            assert cast[name].truncation == truth.truncation
            if truth.amodal is not None and truth.truncation < 0.5 and truth.amodal.w_px > 8:
                gaps.append(abs(cast[name].visibility - truth.visibility))
                partial += 0.05 < truth.visibility < 0.95
    assert len(gaps) > 80
    assert partial >= 8
    assert float(np.mean(gaps)) < 0.06
    assert float(np.mean([g for g in gaps if g > 0.02] or [0.0])) < 0.25


def test_spectrum_falls_as_in_photographs(street: World, street_renderer: Renderer) -> None:
    slopes = []
    for i in (0, 120, 300):
        image = street_renderer.render(i / 30, chase_pose(street, i / 30), i).image_bgr_u8
        slopes.append(spectral_slope(image.mean(axis=2)))
    assert -2.8 <= float(np.mean(slopes)) <= -2.0, slopes


def spectral_slope(grey: npt.NDArray[np.float64]) -> float:
    """Slope of log power over log frequency, averaged over directions, from 4 periods a picture to 0.4 a pixel."""
    side = min(grey.shape)
    top, left = (grey.shape[0] - side) // 2, (grey.shape[1] - side) // 2
    square = grey[top : top + side, left : left + side]
    window = np.hanning(side)[:, None] * np.hanning(side)[None]
    power = np.abs(np.fft.fftshift(np.fft.fft2((square - square.mean()) * window))) ** 2
    y, x = np.indices(power.shape) - side // 2
    ring = np.hypot(x, y).astype(int)
    radial = np.bincount(ring.ravel(), power.ravel()) / np.bincount(ring.ravel())
    frequencies = np.arange(4, int(0.4 * side))
    # Rings evenly spread over the logarithm, else the many high frequencies rule.
    edges = np.geomspace(4, 0.4 * side, 16)
    which = np.digitize(frequencies, edges)
    points = [
        (np.log(frequencies[which == k]).mean(), np.log(radial[frequencies[which == k]]).mean())
        for k in np.unique(which)
    ]
    return float(np.polyfit(*np.array(points).T, 1)[0])


COORDINATE = st.floats(-60, 60)
ANGLE = st.floats(-10, 10)


@settings(max_examples=60)
@given(
    st.tuples(COORDINATE, COORDINATE, st.floats(-40, 5)),
    st.tuples(ANGLE, ANGLE, ANGLE),
    st.tuples(ANGLE, ANGLE, ANGLE),
    st.floats(-10, 100),
)
def test_any_pose_gives_a_picture(
    scene: World,
    small_renderer: Renderer,
    position: tuple[float, float, float],
    angles: tuple[float, float, float],
    rates: tuple[float, float, float],
    t_s: float,
) -> None:
    pose = CameraPose(position, *angles, rates, rates)
    picture = small_renderer.render(t_s, pose, 3)
    check_picture(picture, SMALL)
    for name, truth in GeometryCamera(scene, SMALL).observe(t_s, pose).items():
        assert truth.amodal == picture.truths[name].amodal
        check_truth(truth, SMALL)


@pytest.mark.parametrize(
    "pose",
    [
        CameraPose((0.0, 0.0, -0.5), 0.0, 0.0, 0.0),  # inside of a car
        CameraPose((8.0, -9.0, -2.0), 0.3, 0.1, 2.0),  # inside of a house
        CameraPose((-3.0, 6.0, -5.0), 0.0, 0.0, 1.0),  # inside of a crown
        CameraPose((0.0, 0.0, 0.0), 0.0, 0.0, 0.0),
        CameraPose((0.0, 0.0, 1e-9), 0.0, -1.0, 0.0),
        CameraPose((0.0, 0.0, -1e-9), 0.0, 0.0, 0.0),
        CameraPose((0.0, 0.0, -20.0), 0.0, math.pi / 2, 0.0),
        CameraPose((0.0, 0.0, -20.0), 0.0, -math.pi / 2, 0.0),
        CameraPose((0.0, 0.0, -20.0), math.pi, 0.2, 0.0),
        CameraPose((1e9, -1e12, -1e7), 0.0, -0.5, 0.0, (1e6, 1e6, -1e6), (1e9, 0.0, 0.0)),
        CameraPose((1e300, 1e300, -1e300), 1e9, 1e15, -1e12, (1e300, 1e300, 1e300), (1e300, 1e300, 1e300)),
        CameraPose((-2.4, 0.0, -0.7), 0.0, 0.0, 0.0),  # a hand's breadth behind a car
    ],
)
def test_odd_places_give_a_picture(scene: World, small_renderer: Renderer, pose: CameraPose) -> None:
    picture = small_renderer.render(1.0, pose, -1)
    check_picture(picture, SMALL)
    for truth in GeometryCamera(scene, SMALL).observe(1.0, pose).values():
        check_truth(truth, SMALL)


def check_picture(picture: Picture, camera: CameraModel) -> None:
    assert picture.image_bgr_u8.shape == (camera.height_px, camera.width_px, 3)
    assert picture.image_bgr_u8.dtype == np.uint8
    for truth in picture.truths.values():
        check_truth(truth, camera)


def check_truth(truth: ObjectTruth, camera: CameraModel) -> None:
    assert 0.0 <= truth.visibility <= 1.0
    assert 0.0 <= truth.truncation <= 1.0
    assert math.isfinite(truth.range_m)
    assert (truth.visible is not None) == (truth.visibility > 0)
    if truth.amodal is not None:
        assert truth.amodal.is_valid
    if truth.visible is not None:
        x0, y0, x1, y1 = truth.visible.to_corners()
        assert x0 >= -1
        assert y0 >= -1
        assert x1 <= camera.width_px + 1
        assert y1 <= camera.height_px + 1


def test_under_the_ground_it_is_dark_and_nothing_is_seen(scene: World) -> None:
    pose = CameraPose((-8.0, 0.0, 2.0), 0.0, 0.3, 0.0)
    picture = Renderer(scene, SMALL, 0).render(0.0, pose, 0)
    assert picture.image_bgr_u8.mean() < 60
    for truths in (picture.truths, GeometryCamera(scene, SMALL).observe(0.0, pose)):
        assert all(t.visibility == 0.0 for t in truths.values())


def test_sky_is_above_the_horizon_whichever_way_the_camera_rolls(scene: World) -> None:
    renderer = Renderer(scene, CAMERA, 0)
    level = renderer.render(0.0, CameraPose((-25.0, 0.0, -30.0), 0.0, 0.0, math.pi), 0).image_bgr_u8
    assert level[:200].mean(axis=(0, 1))[0] > level[300:].mean(axis=(0, 1))[0] + 30  # blue sky over green
    over = renderer.render(0.0, CameraPose((-25.0, 0.0, -30.0), math.pi, 0.0, math.pi), 0).image_bgr_u8
    assert over[300:].mean(axis=(0, 1))[0] > over[:200].mean(axis=(0, 1))[0] + 30
