from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from sitl.scenario import ScenarioError, builtin_names, load_scenario
from tests.sitl.scenario.samples import right, spoiled


def test_built_in_scenarios_load_and_can_run() -> None:
    assert "default" in builtin_names()
    for name in builtin_names():
        scenario = load_scenario(name)
        assert scenario.name == name
        assert scenario.pending_reasons() == ()
        assert scenario.criteria


def test_a_file_by_path_and_by_text(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(right()))
    assert load_scenario(path) == load_scenario(str(path))
    assert load_scenario(path).name == "small"


def test_an_unknown_name_is_answered_with_the_known_ones() -> None:
    with pytest.raises(ScenarioError, match=r"defualt: no such scenario; did you mean default\? \(built in: "):
        load_scenario("defualt")


def test_errors_name_file_line_and_key(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(spoiled("wind.mean_ms", 2), sort_keys=False))
    line = next(i for i, text in enumerate(path.read_text().splitlines(), 1) if "mean_ms" in text)
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path)
    assert str(caught.value) == f"{path}: line {line}: wind.mean_ms: unknown key; did you mean mean_m_s?"


@pytest.mark.parametrize("name", ["not there.yaml", "no/such/place.yaml"])
def test_a_file_that_is_not_there(tmp_path: Path, name: str) -> None:
    with pytest.raises(ScenarioError, match="cannot be read: No such file"):
        load_scenario(tmp_path / name)


def test_a_folder_and_a_file_that_is_no_text(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="cannot be read: Is a directory"):
        load_scenario(tmp_path)
    path = tmp_path / "picture.yaml"
    path.write_bytes(b"\xff\xd8\xff\xe0")
    with pytest.raises(ScenarioError, match="not text in UTF-8"):
        load_scenario(path)
    with pytest.raises(ScenarioError, match="cannot be read"):
        load_scenario("a\0b.yaml")
