"""A small scenario that is right, as plain data for tests to spoil."""

from __future__ import annotations

import copy
from typing import Any

_RIGHT: dict[str, Any] = {
    "schema": 1,
    "name": "small",
    "duration_s": 20,
    "target": {
        "kind": "car",
        "name": "target",
        "body": "sedan",
        "colour_rgb": [180, 20, 20],
        "path": {"points_ne_m": [[20, 1], [60, 1], [60, 50]], "speed_m_s": 3, "start_s": 3},
    },
    "distractors": [
        {
            "name": "twin",
            "body": "sedan",
            "colour_rgb": [180, 20, 20],
            "path": {"points_ne_m": [[30, -8]], "yaw_deg": 30},
        },
        {"kind": "person", "name": "walker", "colour_rgb": [1, 2, 3], "path": {"points_ne_m": [[25, 9]]}},
    ],
    "world": {
        "roads": [{"points_ne_m": [[-50, 0], [100, 0]]}],
        "buildings": [{"north_m": 30, "east_m": 20, "length_m": 8, "width_m": 8, "height_m": 6, "yaw_deg": 20}],
        "trees": [{"north_m": 40, "east_m": -9}],
    },
    "occluders": {"bridges": [{"north_m": 40, "east_m": 0, "length_m": 14, "width_m": 3, "yaw_deg": 90}]},
    "wind": {"mean_m_s": 2, "from_deg": 90, "gust_sigma_m_s": 0.5},
    "events": [{"kind": "click", "at_s": 0.5}, {"kind": "follow", "at_s": 2}],
    "criteria": [{"metric": "lock_share", "min": 0.5}],
}


def right() -> dict[str, Any]:
    return copy.deepcopy(_RIGHT)


def spoiled(path: str, value: object) -> dict[str, Any]:
    """The small scenario with one value set; `path` like `vehicle.max_tilt_deg` or `distractors.0.name`."""
    data = right()
    node: Any = data
    *sections, last = path.split(".")
    for part in sections:
        node = node[int(part)] if part.isdigit() else node.setdefault(part, {})
    node[int(last) if last.isdigit() else last] = value
    return data
