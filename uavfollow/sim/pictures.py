"""The simulator as a source of training pictures: flights round cars and people, each in a world of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

import cv2
import numpy as np

from sitl.render.geometry import GeometryCamera
from sitl.render.renderer import Renderer
from sitl.scene import ObjectTruth
from sitl.world.spec import WorldSpec
from sitl.world.world import World
from tracker.box import Box
from tracker.messages import ImageU8
from tracker.training.errors import TrainingError
from tracker.training.recipe import Simulator
from tracker.training.source_names import simulated_name
from tracker.training.types import Footage, Skipped, Track, View
from uavfollow.sim.round_flight import PICTURE_PX, RoundFlight
from uavfollow.sim.village import draw_village

JPEG_QUALITY = 95  # 130 kB and 3 ms to read; lossless takes three times as much of both
LEAST_VISIBILITY = 0.6  # share of the silhouette: below, the box of what is seen is not that of the target
MOST_TRUNCATION = 0.3  # share of the box beyond the border
FLIGHT_TRIES = 20  # drawn flights of a world, until the target is seen at begin, middle and end of one
# Stricter when a flight is chosen: rays to points on a body are coarser than pixels.
CLEAR_VISIBILITY, CLEAR_TRUNCATION = 0.8, 0.15
MOVING_SHARE, PEOPLE_SHARE = 0.6, 0.25  # of the sequences' main targets; the rest are parked cars


@dataclass(frozen=True, slots=True, eq=False)
class _Sequence:
    """Pictures as JPEG with their mean colours; truth of each mover by name (None where absent)."""

    name: str
    flight: RoundFlight
    jpegs: tuple[bytes, ...]
    fills_bgr: tuple[tuple[float, float, float], ...]
    truths: dict[str, tuple[Box | None, ...]]
    labels: dict[str, str]

    def image(self, frame: int) -> ImageU8:
        image = cv2.imdecode(np.frombuffer(self.jpegs[frame], np.uint8), cv2.IMREAD_COLOR)
        return np.asarray(image, dtype=np.uint8)


class _Images(Sequence[ImageU8]):
    """The pictures of a sequence, decoded on access."""

    def __init__(self, sequence: _Sequence) -> None:
        self._sequence = sequence

    def __len__(self) -> int:
        return len(self._sequence.jpegs)

    @overload
    def __getitem__(self, index: int) -> ImageU8: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[ImageU8]: ...

    def __getitem__(self, index: int | slice) -> ImageU8 | Sequence[ImageU8]:
        chosen = range(len(self))[index]
        if isinstance(chosen, range):
            return [self._sequence.image(frame) for frame in chosen]
        return self._sequence.image(chosen)


class SimulatorPictures:
    """Implements `tracker.training.types.Source` and `FootageSource`.

    Everything is drawn once, here, and kept as JPEG: a view costs its decoding, and a copy in another process draws
    nothing again. The same `spec` gives the same bytes. Sequence i is the world and the flight of seed `spec.seed + i`
    and bears that number, so that sources with other seeds hold other sequences. Raises TrainingError when no mover is
    usable in two pictures.
    """

    def __init__(self, spec: Simulator) -> None:
        self.name = spec.name or "simulator"
        self.frame_range = spec.frame_range
        self.skipped = Skipped()
        self._spec = spec
        seeds = range(spec.seed, spec.seed + spec.sequences)
        chosen = [s for s in seeds if _is_chosen(simulated_name(s), spec)]
        self._sequences = tuple(_draw(seed, spec.frames) for seed in chosen)
        self._where: list[tuple[int, str]] = []
        tracks: list[Track] = []
        for i, sequence in enumerate(self._sequences):
            for mover in sequence.truths:
                frames = self._usable(sequence, mover)
                if len(frames) > 1:
                    name = f"{sequence.name}/{mover}"
                    tracks.append(Track(name, frames, sequence.labels[mover], sequence.name))
                    self._where.append((i, mover))
        self.tracks: tuple[Track, ...] = tuple(tracks)
        if not tracks:
            raise TrainingError(
                f"{self.name}: no target is usable in two pictures ({'; '.join(self.skipped.lines()) or 'none seen'}); "
                "ask for more sequences or frames, or for a smaller min_side_px"
            )

    def view(self, track: int, index: int) -> View | str:
        """The picture of `tracks[track].frames[index]` with the box of what is seen of the target. Never a fault."""
        where, mover = self._where[track]
        sequence, frame = self._sequences[where], self.tracks[track].frames[index]
        box = sequence.truths[mover][frame]
        assert box is not None, "frames of a track are those with a box"
        return View(sequence.image(frame), box, sequence.fills_bgr[frame])

    def footage(self) -> Sequence[Footage]:
        """Every sequence whole, with the mover that the camera flies round; it is seen in the first picture."""
        return [Footage(s.name, s.truths[s.flight.target], _Images(s)) for s in self._sequences]

    def _usable(self, sequence: _Sequence, mover: str) -> tuple[int, ...]:
        frames = []
        for frame, box in enumerate(sequence.truths[mover]):
            if box is None or frame % self._spec.stride:
                continue
            fault = _fault(box, self._spec)
            if fault is None:
                frames.append(frame)
            else:
                self.skipped.add(fault, f"{sequence.name}/{mover} frame {frame}")
        return tuple(frames)


def _is_chosen(name: str, spec: Simulator) -> bool:
    return (not spec.only or name in spec.only) and name not in spec.exclude


def _fault(box: Box, spec: Simulator) -> str | None:
    if min(box.w_px, box.h_px) < spec.min_side_px:
        return f"box with a side below {spec.min_side_px:g} px"
    if max(box.w_px / box.h_px, box.h_px / box.w_px) > spec.max_aspect:
        return f"box with sides more than 1:{spec.max_aspect:g}"
    if box.w_px * box.h_px > spec.max_area_share * PICTURE_PX[0] * PICTURE_PX[1]:
        return f"box over more than {spec.max_area_share:g} of the picture"
    return None


def _draw(seed: int, frames: int) -> _Sequence:
    rng = np.random.default_rng([seed])
    spec = draw_village(rng)
    world = World(spec, seed)
    labels = {**{car.name: "car" for car in spec.cars}, **{person.name: "person" for person in spec.persons}}
    flight = _choose_flight(rng, spec, world, frames)
    renderer = Renderer(world, flight.camera, seed)
    truths: dict[str, list[Box | None]] = {name: [] for name in labels}
    jpegs, fills = [], []
    for k in range(frames):
        picture = renderer.render(flight.scene_s(k), flight.pose(world, k), k)
        for name in labels:
            truths[name].append(_seen(picture.truths[name]))
        jpegs.append(_jpeg(picture.image_bgr_u8))
        blue, green, red, _ = cv2.mean(picture.image_bgr_u8)
        fills.append((blue, green, red))
    told = {name: tuple(boxes) for name, boxes in truths.items()}
    return _Sequence(simulated_name(seed), flight, tuple(jpegs), tuple(fills), told, labels)


def _choose_flight(rng: np.random.Generator, spec: WorldSpec, world: World, frames: int) -> RoundFlight:
    """The first drawn flight that sees its target at begin, middle and end, else the one that saw it most often.

    A house or a tree may stand before the camera or around it; looking, without drawing, is the surest way to know.
    """
    best: tuple[int, RoundFlight] | None = None
    for _ in range(FLIGHT_TRIES):
        target = _pick_target(rng, spec)
        flight = RoundFlight.draw(rng, target, any(target == person.name for person in spec.persons))
        eyes = GeometryCamera(world, flight.camera)
        looks = [
            _is_clear(eyes.observe(flight.scene_s(k), flight.pose(world, k))[target])
            for k in (0, frames // 2, frames - 1)
        ]
        count = sum(looks) if looks[0] else 0
        if best is None or count > best[0]:
            best = (count, flight)
        if all(looks):
            break
    assert best is not None
    return best[1]


def _pick_target(rng: np.random.Generator, spec: WorldSpec) -> str:
    """Moving cars most often: parked ones and people are seen beside them anyway."""
    moving = [car.name for car in spec.cars if car.path.speed_m_s > 0]
    parked = [car.name for car in spec.cars if car.path.speed_m_s == 0]
    people = [person.name for person in spec.persons]
    kind = float(rng.random())
    names = moving if kind < MOVING_SHARE else people if kind < MOVING_SHARE + PEOPLE_SHARE else parked
    return names[int(rng.integers(len(names)))]


def _is_clear(truth: ObjectTruth) -> bool:
    return truth.visibility >= CLEAR_VISIBILITY and truth.truncation <= CLEAR_TRUNCATION


def _seen(truth: ObjectTruth) -> Box | None:
    if truth.visible is None or truth.visibility < LEAST_VISIBILITY or truth.truncation > MOST_TRUNCATION:
        return None
    return truth.visible


def _jpeg(image_bgr_u8: ImageU8) -> bytes:
    done, data = cv2.imencode(".jpg", image_bgr_u8, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    if not done:
        raise TrainingError("a picture of the simulator could not be encoded as JPEG; is OpenCV installed whole?")
    return data.tobytes()
