from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest

from sitl.metrics import (
    METRIC_NAMES,
    Criterion,
    Setpoint,
    Source,
    Verdict,
    Wanted,
    all_passed,
    compute,
    encounter,
    judge,
    run_json,
)
from tests.sitl.metrics.samples import HIDDEN, run

WANTED = Wanted(standoff_m=20.0, focal_px=500.0)


def test_every_name_in_its_order_and_what_has_no_part_yet_is_none() -> None:
    found = compute(
        run(90), WANTED, [Setpoint(0.1 + 0.05 * i, (0.0, 0.0, 0.0), 0.0) for i in range(60)], realtime_factor=3.0
    )
    assert tuple(found) == METRIC_NAMES
    undefined = {name for name, value in found.items() if value is None}
    assert undefined == {
        "bearing_err_rms_deg",
        "occlusion_longest_survived_s",
        "reacquire_median_s",
        "declare_loss_median_s",
        *encounter.NAMES,
        "commands_after_override",
        "geolocation_err_rms_m",
        "delay_est_err_ms",
    }
    assert found["realtime_factor"] == 3.0
    assert found["setpoint_rate_hz"] == pytest.approx(20.0)
    assert found["standoff_err_rms_m"] == 0.0


def test_an_empty_run_has_all_names_and_no_numbers() -> None:
    assert set(compute([], WANTED, []).values()) == {None}


def test_samples_out_of_order_are_refused() -> None:
    with pytest.raises(ValueError, match="order"):
        compute(run(5)[::-1], WANTED, [])


def test_a_number_that_is_not_finite_becomes_undefined() -> None:
    broken = run(5, lambda i, s: replace(s, vehicle_pos_ned_m=(math.nan, 0.0, -12.0)))
    assert compute(broken, WANTED, [])["standoff_err_rms_m"] is None


@pytest.mark.parametrize(
    ("criterion", "value", "verdict", "reason"),
    [
        (Criterion("iou_mean", 0.5), 0.5, Verdict.PASSED, "iou_mean: 0.5"),
        (Criterion("iou_mean", 0.5), 0.49, Verdict.FAILED, "iou_mean: 0.49 is below the least, 0.5"),
        (Criterion("iou_mean", None, 3), 3.0, Verdict.PASSED, "iou_mean: 3"),
        (Criterion("iou_mean", None, 3), 3.5, Verdict.FAILED, "iou_mean: 3.5 is above the most, 3"),
        (Criterion("iou_mean", 0.5), None, Verdict.FAILED, "iou_mean: undefined in this run"),
        (Criterion("iou_mean", 0.5), math.nan, Verdict.FAILED, "iou_mean: undefined in this run"),
        (
            Criterion("iou_mean", 0.5, None, Source.PIXELS),
            0.1,
            Verdict.NOT_APPLICABLE,
            "iou_mean: for pixels runs only",
        ),
        (Criterion("iou_mean", 0.5, None, Source.GEOMETRY), 0.1, Verdict.FAILED, "iou_mean: 0.1 is below"),
    ],
)
def test_judge(criterion: Criterion, value: float | None, verdict: Verdict, reason: str) -> None:
    (result,) = judge([criterion], {"iou_mean": value}, Source.GEOMETRY)
    assert result.verdict is verdict
    assert result.reason.startswith(reason)


def test_a_metric_that_is_not_there_fails() -> None:
    assert judge([Criterion("other", 1)], {}, Source.PIXELS)[0].verdict is Verdict.FAILED


def test_a_run_passes_only_when_something_was_judged() -> None:
    good, bad = Criterion("a", 0), Criterion("a", 2)
    not_ours = Criterion("a", 0, None, Source.PIXELS)
    metrics = {"a": 1.0}
    assert all_passed(judge([good, not_ours], metrics, Source.GEOMETRY))
    assert not all_passed(judge([good, bad], metrics, Source.GEOMETRY))
    assert not all_passed(judge([not_ours], metrics, Source.GEOMETRY))
    assert not all_passed([])


def example(**change: object) -> dict[str, object]:
    metrics = compute(run(90, lambda i, s: replace(s, truth=HIDDEN) if 30 <= i < 40 else s), WANTED, [])
    results = judge([Criterion("lock_share", 0.5), Criterion("iou_mean", None, math.inf)], metrics, Source.PIXELS)
    arguments: dict[str, object] = {
        "scenario": "default",
        "seed": 3,
        "flavour": "ardupilot",
        "engine": "torch-2.6/cpu/fp32",
        "versions": {"uavfollow": "0.1.0"},
        "commit": None,
        "metrics": metrics,
        "criteria": results,
    }
    return run_json(**{**arguments, **change})  # type: ignore[arg-type]


def test_run_json_has_its_keys_and_is_json() -> None:
    record = example()
    assert {"schema", "scenario", "seed", "flavour", "engine", "versions", "commit", "metrics", "criteria"} <= set(
        record
    )
    assert json.loads(json.dumps(record, allow_nan=False)) == record
    assert record["passed"] is True
    metrics = record["metrics"]
    assert isinstance(metrics, dict)
    assert tuple(metrics) == METRIC_NAMES
    assert metrics["bearing_err_rms_deg"] is None


def test_run_json_never_holds_nan_and_a_pending_scenario_never_passes() -> None:
    record = example(metrics={"lock_share": math.nan, "of_my_own": math.inf}, pending=["px4 is not built yet"])
    assert record["metrics"] == {"lock_share": None, "of_my_own": None}
    assert record["passed"] is False
    json.dumps(record, allow_nan=False)
