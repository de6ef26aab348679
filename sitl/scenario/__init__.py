"""Scenarios: YAML files that say what happens in a run, checked, and made into the parameters of the parts."""

from sitl.scenario.draw import drawn
from sitl.scenario.errors import ScenarioError
from sitl.scenario.load import builtin_names, load_scenario, parse_scenario
from sitl.scenario.schema import Flavour, Scenario, Vary
from sitl.scenario.transform import mirrored, scaled

__all__ = [
    "Flavour",
    "Scenario",
    "ScenarioError",
    "Vary",
    "builtin_names",
    "drawn",
    "load_scenario",
    "mirrored",
    "parse_scenario",
    "scaled",
]
