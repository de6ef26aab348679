"""Scenarios made from scenarios, for tests that compare two runs: mirrored in east, and scaled in size."""

from __future__ import annotations

from sitl.scenario.schema import Scenario

# Keys by what the change does to their value; a new key with a side or a length must enter here (a test compares).
_EAST_KEYS = frozenset({"east_m", "start_east_m"})
_SIDE_KEYS = frozenset(
    {
        "yaw_deg",
        "start_yaw_deg",
        "from_deg",
        "misalignment_yaw_deg",
        "misalignment_roll_deg",
        "bearing_deg",
        "background_deg",
    },
)
_POINT_KEYS = frozenset({"points_ne_m", "centre_ne_m", "about_ne_m"})
_WORLD_LENGTHS = frozenset(
    {
        "north_m", "east_m", "length_m", "width_m", "height_m", "crown_m", "clearance_m", "thickness_m", "size_m",
        "corner_radius_m", "scale", "background_m", "speed_m_s", "takeoff_height_m", "start_north_m", "start_east_m",
        "standoff_m",
    }
)  # fmt: skip


def mirrored(scenario: Scenario) -> Scenario:
    """East and west exchanged: roads, objects, paths, wind, start, misalignment, and the side of every chance."""
    data = _mirror(scenario.model_dump(mode="json", by_alias=True))
    assert isinstance(data, dict)
    return Scenario.model_validate({**data, "mirrored": not scenario.mirrored})


def scaled(scenario: Scenario, factor: float) -> Scenario:
    """Every place, size and speed of the world, the start and the standoff times `factor`: the same pictures from afar.

    Not scaled: what vehicle, gimbal, wind and limits can do, for accelerations do not scale. Raises pydantic's
    ValidationError (a ValueError) when a value leaves its range.
    """
    return Scenario.model_validate(_scale(scenario.model_dump(mode="json", by_alias=True), factor))


def _mirror(node: object, key: str = "") -> object:
    if isinstance(node, dict):
        return {name: _mirror(value, name) for name, value in node.items()}
    if isinstance(node, list):
        if key in _POINT_KEYS and len(node) == 2 and all(isinstance(v, (int, float)) for v in node):
            return [node[0], _negated(node[1])]
        return [_mirror(value, key) for value in node]
    return _negated(node) if key in _EAST_KEYS | _SIDE_KEYS else node


def _negated(value: object) -> float:
    assert isinstance(value, (int, float))
    return 0.0 - value  # not -0.0: a mirrored mirror image must equal the original to the bit


def _scale(node: object, factor: float, key: str = "") -> object:
    if isinstance(node, dict):
        # A person's height is a length like any other; the box of the ground grows with what stands on it.
        return {name: _scale(value, factor, name) for name, value in node.items()}
    if isinstance(node, list):
        return [_scale(value, factor, key) for value in node]
    if isinstance(node, (int, float)) and key in _WORLD_LENGTHS | _POINT_KEYS:
        return node * factor
    return node
