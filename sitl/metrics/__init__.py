"""How good a run was: samples beside the truth, made into named numbers, criteria and run.json."""

from sitl.metrics.compute import Wanted, compute
from sitl.metrics.criteria import Criterion, CriterionResult, Source, Verdict, all_passed, judge
from sitl.metrics.flight import FlightLimits
from sitl.metrics.names import METRIC_NAMES, NEVER_GATED
from sitl.metrics.occlusions import Occlusion, occlusions
from sitl.metrics.report import run_json
from sitl.metrics.sample import Sample, Setpoint

__all__ = [
    "METRIC_NAMES",
    "NEVER_GATED",
    "Criterion",
    "CriterionResult",
    "FlightLimits",
    "Occlusion",
    "Sample",
    "Setpoint",
    "Source",
    "Verdict",
    "Wanted",
    "all_passed",
    "compute",
    "judge",
    "occlusions",
    "run_json",
]
