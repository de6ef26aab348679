"""What the camera gives the application: rendered pictures, or candidates as a tracker would find them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from sitl.drive import Seen
from sitl.feed import Exposure
from sitl.measure import MeasurementModel
from sitl.render.geometry import GeometryCamera
from sitl.render.renderer import Renderer
from sitl.scene import CameraModel, ObjectTruth

Truths = Mapping[str, ObjectTruth]
Places = Sequence[tuple[float, float]]


class Eyes(Protocol):
    """Turns an exposure into what is seen, and the truth of the same instant."""

    def look(self, exposure: Exposure, now_s: float, searched_px: Places) -> tuple[Seen, Truths]:
        """The picture (or candidates) of `exposure`, received at `now_s`.

        `searched_px`: centres of the windows that the application searches (candidates are found only in them); empty
        before a selection.
        """

    def black(self, exposure: Exposure, now_s: float) -> tuple[Seen, Truths]:
        """The same with the lens covered: nothing is seen, the truth stays."""


class PixelEyes:
    """The renderer's pictures."""

    def __init__(self, renderer: Renderer, camera: CameraModel) -> None:
        self._renderer = renderer
        self._black = np.zeros((camera.height_px, camera.width_px, 3), np.uint8)

    def look(self, exposure: Exposure, now_s: float, searched_px: Places) -> tuple[Seen, Truths]:
        """A rendered picture; the application crops it by itself."""
        picture = self._renderer.render(exposure.scene_s, exposure.pose, exposure.seq)
        return Seen(exposure.seq, exposure.t_s, now_s, image_bgr_u8=picture.image_bgr_u8), picture.truths

    def black(self, exposure: Exposure, now_s: float) -> tuple[Seen, Truths]:
        """A black picture."""
        _, truths = self.look(exposure, now_s, ())
        return Seen(exposure.seq, exposure.t_s, now_s, image_bgr_u8=self._black.copy()), truths


class GeometryEyes:
    """Candidates from the truth, with the errors of a tracker; no pixels."""

    def __init__(self, camera: GeometryCamera, errors: MeasurementModel, target: str, model: CameraModel) -> None:
        self._camera = camera
        self._errors = errors
        self._target = target
        self._size_px = (float(model.width_px), float(model.height_px))

    def look(self, exposure: Exposure, now_s: float, searched_px: Places) -> tuple[Seen, Truths]:
        """Measured boxes."""
        truths = self._camera.observe(exposure.scene_s, exposure.pose)
        found = self._errors.candidates(truths, self._target, exposure.t_s, self._size_px, searched_px)
        return Seen(exposure.seq, exposure.t_s, now_s, candidates=found), truths

    def black(self, exposure: Exposure, now_s: float) -> tuple[Seen, Truths]:
        """Nothing found."""
        truths = self._camera.observe(exposure.scene_s, exposure.pose)
        return Seen(exposure.seq, exposure.t_s, now_s, candidates=()), truths
