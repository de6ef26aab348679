"""One run of the suite in a process of its own: flown, judged, and a strip of pictures of it made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from sitl.run import Step
from sitl.scenario import load_scenario
from tracker.messages import ImageU8
from uavfollow.errors import InputError
from uavfollow.sim.session import SimOptions, run_sim
from uavfollow.video.overlay import draw_state
from uavfollow.workers import JobError, Tick

THUMB_PX = (320, 240)
THUMB_EVERY_S = 0.25
STRIP = 8  # pictures in a strip


@dataclass(frozen=True, slots=True)
class SuiteJob:
    """What is run. `model` None: by the geometry camera. `key`: what its result depends on. `strip`: with pictures."""

    scenario: str
    seed: int
    model: str | None
    precision: str
    device: str
    key: str
    strip: bool = False

    @property
    def name(self) -> str:
        """For files and messages."""
        return f"{self.scenario}-{self.seed:03d}"


@dataclass(frozen=True, slots=True, eq=False)
class Flown:
    """What became of a job: run.json, how long it took, and pictures side by side (None without pixels)."""

    run: dict[str, Any]
    wall_s: float
    strip_bgr_u8: ImageU8 | None


def fly(job: SuiteJob, tick: Tick) -> Flown | None:
    """Fly it by one thread. None when `tick`, asked at every picture, wanted an end. Raises JobError."""
    film = _Film(job) if job.strip and job.model is not None else None

    def step(made: Step, scene_s: float) -> None:
        if tick():
            raise KeyboardInterrupt  # the run ends in order
        if film is not None:
            film.take(made, scene_s)

    options = SimOptions(
        seed=job.seed, model=job.model, precision=job.precision, device=job.device, threads=1, out=None, video=False,
        realtime=False,
    )  # fmt: skip
    try:
        result = run_sim(load_scenario(job.scenario), options, step)
    except InputError as error:
        raise JobError(str(error)) from None
    except Exception as error:  # whatever breaks, the other runs go on
        raise JobError(" ".join(f"{type(error).__name__}: {error}".split())) from None
    if result.log.interrupted:
        return None
    return Flown(result.as_json(), result.wall_s, film.strip() if film is not None else None)


class _Film:
    """Small pictures with the state drawn in, a few a second."""

    def __init__(self, job: SuiteJob) -> None:
        self._job = job
        self._images: list[ImageU8] = []

    def take(self, made: Step, scene_s: float) -> None:
        """Keep the picture of a step when it is time for one."""
        image = made.seen.image_bgr_u8
        if image is None or scene_s < len(self._images) * THUMB_EVERY_S:
            return
        truth = made.sample.truth.visible if made.sample.truth is not None else None
        label = f"{self._job.name}  {scene_s:.1f} s  visible {made.sample.visibility:.2f}"
        drawn = draw_state(image, made.decision.record.step.target, truth, label)
        thumb = np.asarray(cv2.resize(drawn, THUMB_PX, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        missing = int(scene_s / THUMB_EVERY_S) + 1 - len(self._images)
        self._images += [thumb] * missing

    def strip(self) -> ImageU8 | None:
        """Pictures at even times from the click to the end, side by side."""
        if not self._images:
            return None
        chosen = np.linspace(0, len(self._images) - 1, STRIP).round().astype(int)
        return np.hstack([self._images[i] for i in chosen])
