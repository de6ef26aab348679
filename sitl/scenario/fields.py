"""The numbers of a scenario and their ranges."""

from __future__ import annotations

from typing import Annotated

from tracker.config.fields import Bounds

# A town of 2 km: beyond it the float32 depth and the tiled ground of the renderer lose their centimetres.
Coordinate = Annotated[float, Bounds(-2000.0, 2000.0)]
Extent = Annotated[float, Bounds(0.2, 500.0)]
Angle = Annotated[float, Bounds(-360.0, 360.0)]
Seconds = Annotated[float, Bounds(0.0, 3600.0)]
Share = Annotated[float, Bounds(0.0, 1.0)]
# More than any delay of a camera, a link or an actuator that a vehicle could be flown with.
Milliseconds = Annotated[float, Bounds(0.0, 2000.0)]
Channel = Annotated[int, Bounds(0, 255, whole=True)]
Colour = tuple[Channel, Channel, Channel]
Point = tuple[Coordinate, Coordinate]
