from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError

from sitl.scenario.errors import ScenarioError
from sitl.scenario.load import from_mapping
from sitl.scenario.schema import LimitsSection, Scenario
from tests.sitl.scenario.samples import right, spoiled
from tracker.config.problems import _sections


def problems(data: object) -> tuple[str, ...]:
    with pytest.raises(ScenarioError) as caught:
        from_mapping(data, "file")
    assert "\n" not in str(caught.value)
    return caught.value.problems


def every_section(model: type[BaseModel] = Scenario) -> Iterator[type[BaseModel]]:
    yield model
    for field in model.model_fields.values():
        for section in _sections(field.annotation):
            yield from every_section(section)


def test_the_small_scenario_is_right_and_has_the_defaults() -> None:
    scenario = from_mapping(right(), "file")
    assert scenario.camera.latency_ms == 60.0
    assert scenario.camera.jitter_ms == 8.0
    assert scenario.vehicle.takeoff_height_m == 12.0
    assert scenario.guidance.standoff_m == 20.0
    assert scenario.distractors[0].kind == "car"
    assert scenario.pending_reasons() == ()


def test_every_key_is_described() -> None:
    bare = [
        f"{section.__name__}.{name}"
        for section in every_section()
        for name, field in section.model_fields.items()
        if not field.description
    ]
    assert bare == []


def test_a_number_with_a_physical_meaning_carries_its_unit() -> None:
    units = ("_m", "_m_s", "_m_s2", "_m_s3", "_s", "_ms", "_deg", "_deg_s", "_deg_s2", "_px", "_share", "_rgb", "_ne_m")
    no_unit = {"schema_version", "fps", "scale", "min", "max"}
    for section in every_section():
        for name, field in section.model_fields.items():
            if "float" in str(field.annotation) or "int" in str(field.annotation):
                assert name.endswith(units) or name in no_unit or list(_sections(field.annotation)), name


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        ("vehicle.max_titl_deg", 3, "vehicle.max_titl_deg: unknown key; did you mean max_tilt_deg?"),
        ("distractors.0.colour", 3, "distractors[0].colour: unknown key; did you mean colour_rgb?"),
        ("distractors.1.path.sped_m_s", 3, "distractors[1].path.sped_m_s: unknown key; did you mean speed_m_s?"),
        ("distractors.1.body", "van", "distractors[1].body: unknown key; known are colour_rgb"),
        ("events.0.duration_s", 3, "events[0].duration_s: unknown key; known are at_s, error_sigma_share"),
        ("zzz", 3, "zzz: unknown key; known are camera"),
        ("targt", 3, "targt: unknown key; did you mean target?"),
        ("schema", 2, "schema: 2 is not one of 1"),
        ("name", "Has Space", "name: 'Has Space': must match"),
        ("duration_s", "10", "duration_s: '10': must be a number from 1 to 3600"),
        ("duration_s", True, "duration_s: True: must be a number"),
        ("duration_s", math.nan, "duration_s: nan: must be a number from 1 to 3600"),
        ("duration_s", math.inf, "duration_s: inf: must be a number from 1 to 3600"),
        ("duration_s", None, "duration_s: None: must be a number"),
        ("duration_s", 10**400, "duration_s: an integer of many digits: must be a number from 1 to 3600"),
        ("camera.width_px", 640.5, "camera.width_px: 640.5: must be a whole number from 64 to 3840"),
        ("camera.hfov_deg", 170, "camera.hfov_deg: 170: must be a number from 5 to 150"),
        ("camera", 3, "camera: 3: must be a section with keys of its own"),
        ("target.colour_rgb", [1, 2, 300], "target.colour_rgb[2]: 300: must be a whole number from 0 to 255"),
        ("target.colour_rgb", [1, 2], "target.colour_rgb[2]: missing"),
        ("target.kind", "bus", "target: kind: must be one of car, person"),
        ("target.body", "seden", "did you mean sedan?"),
        ("target.path.points_ne_m", [], "target.path.points_ne_m: []"),
        ("target.path.points_ne_m", [[1, 2, 3]], "target.path.points_ne_m[0]"),
        ("seed_policy", ["colours"], "seed_policy[0]: 'colours' is not one of texture, light"),
        ("vehicle.flavour", "ardupilt", "did you mean ardupilot?"),
        ("vehicle.takeoff_height_m", 1.9, "vehicle.takeoff_height_m: 1.9: must be a number from 2 to 120"),
        ("guidance.standoff_m", 4, "guidance.standoff_m: 4: must be a number from 5 to 500"),
        ("guidance.limits.max_horizontal_m_s", 6, "max_horizontal_m_s: 6: must be a number from 0.1 to 5"),
        ("criteria.0.when", "never", "criteria[0].when: 'never' is not one of pixels or geometry"),
        ("mirrored", "yes", "mirrored: 'yes'"),
    ],
)
def test_a_wrong_value_names_path_value_and_range(path: str, value: object, expected: str) -> None:
    assert expected in problems(spoiled(path, value))[0]


def test_missing_keys() -> None:
    data = right()
    del data["target"]
    assert problems(data) == ("target: missing; it must be given",)
    assert problems(3)[0].startswith("scenario: 3: must be a section")


def test_all_errors_come_together_and_the_text_counts_them() -> None:
    data = spoiled("camera.hfov_deg", 999)
    data["wind"]["mean"] = 3
    data["duration_s"] = 0
    with pytest.raises(ScenarioError) as caught:
        from_mapping(data, "file.yaml")
    assert len(caught.value.problems) == 3
    assert str(caught.value).startswith("file.yaml: ")
    assert str(caught.value).endswith("(and 2 more)")


def test_a_scenario_cannot_be_changed() -> None:
    scenario = from_mapping(right(), "file")
    with pytest.raises(ValidationError):
        scenario.duration_s = 3.0


def test_what_is_not_built_is_pending_with_a_reason() -> None:
    data = right()
    data["vehicle"] = {"flavour": "px4"}
    data["faults"] = [{"kind": "gps_loss", "at_s": 4, "share": 0.5}]
    data["events"].append({"kind": "clik", "at_s": 3, "anything": 1})
    data["guidance"] = {"mode": "orbit"}
    reasons = from_mapping(data, "file").pending_reasons()
    assert len(reasons) == 4
    assert "gps_loss" in reasons[0]
    assert reasons[1] == "events[2]: the event 'clik' is not built yet; did you mean click?"
    assert "px4" in reasons[2]
    assert "orbit" in reasons[3]


def test_limits_reach_no_further_than_those_of_the_application() -> None:
    from control.limits import VelocityLimits

    ours = {name: described["anyOf"][0]["maximum"] for name, described in limit_schema().items()}
    theirs = VelocityLimits()
    assert ours == {
        "max_horizontal_m_s": theirs.max_horizontal_m_s,
        "max_up_m_s": theirs.max_up_m_s,
        "max_down_m_s": theirs.max_down_m_s,
        "max_yaw_rate_deg_s": math.degrees(theirs.max_yaw_rate_rad_s),
        "max_horizontal_accel_m_s2": theirs.max_horizontal_accel_m_s2,
    }


def limit_schema() -> dict[str, Any]:
    properties = LimitsSection.model_json_schema()["properties"]
    assert isinstance(properties, dict)
    return properties


def test_the_json_schema_for_editors_has_ranges_and_descriptions() -> None:
    described = Scenario.model_json_schema()
    assert described["properties"]["duration_s"]["minimum"] == 1.0
    assert described["properties"]["duration_s"]["description"]


@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.text(max_size=5) | st.integers(),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
        max_leaves=8,
    ),
    st.sampled_from(["target", "events", "camera", "world", "criteria", "faults", "seed_policy", "guidance", "new"]),
)
def test_any_data_gives_a_scenario_or_clear_errors(value: object, key: str) -> None:
    told = "file: "
    try:
        from_mapping({**right(), key: value}, "file")
    except ScenarioError as error:
        told = str(error)
    assert told.startswith("file: ")
    assert "\n" not in told
