"""The loop with pictures and the network. Short flights here; whole ones are marked slow (`make test-full`)."""

from __future__ import annotations

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from sitl.scenario import load_scenario
from tests.sim.flights import fly, scenario, statuses
from tracker.weights.store import EMBEDDED_FILES

SLOW_NETWORK_S = 0.2  # five pictures a second: enough for a parked car, and few enough for every test run


def test_the_network_locks_on_the_parked_car_and_leaves_black_pictures():
    flown = scenario({"kind": "black", "at_s": 3.0, "duration_s": 1.5}, duration_s=4.5,
                     tracker_compute_delay_s=SLOW_NETWORK_S)  # fmt: skip
    result = fly(flown, model="s")
    assert statuses(result, 2.0, 2.9)[-1] == "LOCKED"
    assert "LOCKED" not in statuses(result, 3.7), "not LOCKED within 0.7 s of a true loss"
    assert max(s.sample.iou for s in result.log.steps) > 0.4
    assert result.metrics["false_confirmed_share"] <= 0.1


def random_weights(folder):
    """A file of the embedded model's shapes with random numbers of the same spread."""
    rng = np.random.default_rng(0)
    tensors = {
        name: rng.normal(0.0, float(value.std()) + 1e-3, value.shape).astype(value.dtype)
        if np.issubdtype(value.dtype, np.floating)
        else value
        for name, value in load_file(EMBEDDED_FILES["s"]).items()
    }
    path = folder / "random.safetensors"
    save_file(tensors, path)
    return path


def test_random_weights_do_not_pass(tmp_path):
    flown = load_scenario("default").model_copy(update={"duration_s": 6.0, "tracker_compute_delay_s": SLOW_NETWORK_S})
    result = fly(flown, model=str(random_weights(tmp_path)))
    assert not result.passed
    assert result.metrics["final_locked_on_target"] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_the_default_scenario_with_the_network(seed):
    result = fly(load_scenario("default"), seed, model="s")
    assert result.metrics["limit_violations"] == 0
    assert result.metrics["setpoint_gap_max_s"] <= 0.085
    assert result.metrics["lock_share"] > 0.5


@pytest.mark.slow
def test_random_weights_do_not_pass_the_whole_scenario(tmp_path):
    assert not fly(load_scenario("default"), model=str(random_weights(tmp_path))).passed
