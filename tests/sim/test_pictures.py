from __future__ import annotations

import math
import pickle
from dataclasses import replace

import cv2
import numpy as np
import pytest

from sitl.render.projection import View as CameraView
from sitl.render.renderer import Renderer
from sitl.world.checks import check_world
from sitl.world.world import World
from tracker.training.errors import TrainingError
from tracker.training.recipe import Simulator
from tracker.training.types import View
from uavfollow.sim.pictures import LEAST_VISIBILITY, SimulatorPictures, _seen
from uavfollow.sim.round_flight import PERSON_M, RoundFlight
from uavfollow.sim.village import draw_village

SPEC = Simulator(kind="simulator", sequences=2, frames=5, seed=5, min_side_px=10.0)


@pytest.fixture(scope="module")
def pictures() -> SimulatorPictures:
    return SimulatorPictures(SPEC)


@pytest.fixture(scope="module")
def again() -> SimulatorPictures:
    return SimulatorPictures(SPEC.model_copy(update={"seed": 6, "sequences": 1}))


@pytest.fixture(scope="module")
def world() -> World:
    return World(draw_village(np.random.default_rng([SPEC.seed])), SPEC.seed)


def view(source: SimulatorPictures, track: int, index: int) -> View:
    found = source.view(track, index)
    assert isinstance(found, View)
    return found


def test_a_sequence_follows_from_its_seed_alone(pictures: SimulatorPictures, again: SimulatorPictures) -> None:
    first, second = pictures.footage()
    same = again.footage()[0]
    assert (first.name, second.name, same.name) == ("sim-000005", "sim-000006", "sim-000006")
    assert second.truth == same.truth
    for k in range(SPEC.frames):
        assert np.array_equal(second.images[k], same.images[k])
    assert not np.array_equal(first.images[0], second.images[0])


def test_the_pictures_of_a_sequence_differ(pictures: SimulatorPictures) -> None:
    for item in pictures.footage():
        a, b = (cv2.GaussianBlur(item.images[k], (9, 9), 0).astype(int) for k in (0, SPEC.frames - 1))
        assert np.abs(a - b).mean() > 3.0


def test_every_view_holds_its_target_inside_of_the_picture(pictures: SimulatorPictures) -> None:
    assert {track.group for track in pictures.tracks} == {"sim-000005", "sim-000006"}
    for number, track in enumerate(pictures.tracks):
        assert list(track.frames) == sorted(set(track.frames))
        assert track.name.startswith(f"{track.group}/")
        assert track.label in ("car", "person")
        for index in range(len(track.frames)):
            found = view(pictures, number, index)
            height, width = found.image_bgr_u8.shape[:2]
            assert (width, height) == (640, 480)
            x1, y1, x2, y2 = found.box.to_corners()
            assert 0 <= x1 < x2 <= width
            assert 0 <= y1 < y2 <= height
            assert min(found.box.w_px, found.box.h_px) >= SPEC.min_side_px
            assert found.fill_bgr == pytest.approx(cv2.mean(found.image_bgr_u8)[:3], abs=1.0)


def test_the_box_is_where_the_target_is(pictures: SimulatorPictures, world: World) -> None:
    """The same picture without the target differs in its box; around it by the shadow at most."""
    sequence = pictures._sequences[0]
    flight, seed = sequence.flight, SPEC.seed
    spec = draw_village(np.random.default_rng([seed]))
    kept = replace(
        spec,
        cars=tuple(car for car in spec.cars if car.name != flight.target),
        persons=tuple(person for person in spec.persons if person.name != flight.target),
    )
    renderer = Renderer(World(kept, seed), flight.camera, seed)
    for k in (0, SPEC.frames - 1):
        box = sequence.truths[flight.target][k]
        assert box is not None
        empty = renderer.render(flight.scene_s(k), flight.pose(world, k), k).image_bgr_u8
        changed = np.abs(sequence.image(k).astype(int) - empty.astype(int)).max(axis=2) > 25
        x1, y1, x2, y2 = (round(v) for v in box.to_corners())
        inside = changed[y1:y2, x1:x2]
        assert inside.mean() > 0.5
        for edge in (inside[:3], inside[-3:], inside[:, :3], inside[:, -3:]):  # the box is tight
            assert edge.any()
        assert (changed.sum() - inside.sum()) < 0.8 * inside.sum()


def test_a_copy_in_another_process_draws_nothing_again(
    pictures: SimulatorPictures, monkeypatch: pytest.MonkeyPatch
) -> None:
    packed = pickle.dumps(pictures)
    monkeypatch.setattr("uavfollow.sim.pictures._draw", lambda *_: pytest.fail("drawn again"))
    copy = pickle.loads(packed)
    assert copy.tracks == pictures.tracks
    assert np.array_equal(view(copy, 0, 1).image_bgr_u8, view(pictures, 0, 1).image_bgr_u8)
    assert view(copy, 0, 1).box == view(pictures, 0, 1).box


def test_footage_is_whole_and_begins_with_the_target(pictures: SimulatorPictures) -> None:
    for item in pictures.footage():
        assert len(item.images) == len(item.truth) == SPEC.frames
        assert item.truth[0] is not None
        assert np.array_equal(item.images[1:3][1], item.images[-3])
        with pytest.raises(IndexError):
            item.images[SPEC.frames]


def test_hidden_and_cut_targets_are_absent(pictures: SimulatorPictures, world: World) -> None:
    sequence = pictures._sequences[0]
    renderer = Renderer(world, sequence.flight.camera, SPEC.seed)
    truth = renderer.render(sequence.flight.scene_s(0), sequence.flight.pose(world, 0), 0).truths[
        sequence.flight.target
    ]
    assert _seen(truth) == sequence.truths[sequence.flight.target][0]
    assert _seen(replace(truth, visibility=LEAST_VISIBILITY - 0.01)) is None
    assert _seen(replace(truth, truncation=0.31)) is None
    assert _seen(replace(truth, visible=None)) is None


def test_bounds_of_the_recipe_hold(again: SimulatorPictures, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = again._sequences[0]
    monkeypatch.setattr("uavfollow.sim.pictures._draw", lambda seed, frames: replace(drawn, name=f"sim-{seed:06d}"))
    thinned = SimulatorPictures(SPEC.model_copy(update={"stride": 2, "name": "drawn"}))
    assert thinned.name == "drawn"
    assert {frame for track in thinned.tracks for frame in track.frames} <= {0, 2, 4}
    only = SimulatorPictures(SPEC.model_copy(update={"sequences": 3, "only": ("sim-000007",)}))
    assert {track.group for track in only.tracks} == {"sim-000007"}
    rest = SimulatorPictures(SPEC.model_copy(update={"sequences": 3, "exclude": ("sim-000007",)}))
    assert {track.group for track in rest.tracks} == {"sim-000005", "sim-000006"}
    with pytest.raises(TrainingError, match=r"no target is usable.*a side below 500 px: sim-000005/.*min_side_px"):
        SimulatorPictures(SPEC.model_copy(update={"min_side_px": 500.0}))


def test_no_way_of_a_village_leads_through_an_obstacle() -> None:
    for seed in range(25):
        spec = draw_village(np.random.default_rng([seed]))
        check_world(spec)
        assert draw_village(np.random.default_rng([seed])) == spec


def test_the_camera_keeps_its_target_in_the_picture_at_many_sizes(world: World) -> None:
    rng = np.random.default_rng(1)
    sizes = []
    for _ in range(40):
        name = world.names[int(rng.integers(len(world.names)))]
        flight = RoundFlight.draw(rng, name, name == "walker")
        for k in (0, 11, 23, 400):
            pose = flight.pose(world, k)
            place = world.placements(flight.scene_s(k))[name]
            seen = CameraView(flight.camera, pose)
            point = seen.to_camera(np.array([place.north_m, place.east_m, -PERSON_M[1]]))
            assert point[2] > 1.0
            x, y = seen.pixels(point)
            assert 0.15 * 640 < x < 0.85 * 640
            assert 0.1 * 480 < y < 0.9 * 480
            assert seen.height_m > 0.5
            sizes.append(flight.camera.width_px / math.tan(flight.camera.hfov_rad / 2) / float(point[2]))
    assert max(sizes) > 5 * min(sizes)
