"""What runs the network. An engine takes uint8 crops and gives numpy maps; torch is imported only by the torch one."""

from __future__ import annotations

from typing import Protocol

from tracker.messages import ImageU8
from tracker.siamapnpp.decode import FloatMap, ResponseMaps


class Engine(Protocol):
    """Runs SiamAPN++. `name` says on what and in which precision, for reports."""

    name: str

    def set_exemplar(self, crop_bgr_u8: ImageU8) -> FloatMap | None:
        """Compute and keep the template kernels of an exemplar crop, (127, 127, 3). Gives its features as `embed`."""

    def embed(self, crop_bgr_u8: ImageU8) -> FloatMap | None:
        """Deep features (C, 6, 6) of an exemplar crop, (127, 127, 3); None from an engine that cannot give them."""

    def search(self, crop_bgr_u8: ImageU8) -> ResponseMaps:
        """Maps of a search crop, (S, S, 3). Raises RuntimeError before `set_exemplar`."""
