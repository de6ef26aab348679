"""The suite around its runs: what is kept, what is flown again, tables, floors, the command line."""

from __future__ import annotations

import argparse
import json
import pickle
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sitl.scenario import builtin_names, load_scenario
from uavfollow.cli import bench_suite
from uavfollow.cli.bench_suite import parse_seeds
from uavfollow.errors import EXIT_DONE, EXIT_INTERRUPTED, EXIT_SHORT, InputError
from uavfollow.interrupts import orderly_end
from uavfollow.sim import suite
from uavfollow.sim.suite import SuiteOptions, code_hash, run_suite
from uavfollow.sim.suite_aims import AIMS, BY_NAME, GEOMETRY, MIN_RUNS, PIXELS, SEEDS, Aim
from uavfollow.sim.suite_job import Flown, SuiteJob, fly
from uavfollow.sim.suite_table import TOO_FEW, Outcome, as_json, as_markdown, line_of, wilson
from uavfollow.workers import JobError


def flown(metrics: dict[str, float | None], passed: bool = True, metric: str = "reacquired") -> Flown:
    verdict = "passed" if passed else "failed"
    criteria = [{"metric": metric, "verdict": verdict}, {"metric": "other", "verdict": "failed"}]
    run = {"engine": "fake", "metrics": metrics, "criteria": criteria}
    return Flown(run, 1.5, np.full((240, 8 * 320, 3), 90, np.uint8))


def outcome(seed: int, reached: bool, scenario: str = "occlusion_short", **metrics: float | None) -> Outcome:
    made = flown(dict(metrics), reached, BY_NAME[scenario].metric)
    return Outcome(scenario, seed, made.run, 1.0)


# --- numbers


@pytest.mark.parametrize(
    ("hits", "count", "low", "high"),
    # Newcombe 1998, table I, method 3 (score method): 81/263, 15/148, 0/20, 1/29.
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_as_published(hits: int, count: int, low: float, high: float) -> None:
    assert wilson(hits, count) == pytest.approx((low, high), abs=1e-4)
    mirrored_high, mirrored_low = wilson(count - hits, count)
    assert (1 - mirrored_low, 1 - mirrored_high) == pytest.approx((low, high), abs=1e-4)


@pytest.mark.parametrize(("hits", "count"), [(0, 0), (3, 2), (-1, 2)])
def test_wilson_of_nothing_is_refused(hits: int, count: int) -> None:
    with pytest.raises(ValueError, match="wilson"):
        wilson(hits, count)


def test_a_run_reaches_by_its_own_criterion_for_the_aims_metric() -> None:
    assert outcome(0, True).reached
    assert not outcome(0, False).reached
    assert not Outcome("leaves", 0, flown({}, True, "reacquired").run, 1.0).reached, "another metric says nothing"
    assert not Outcome("leaves", 0, None, 0.0, "fell").reached


def test_shares_and_floors() -> None:
    runs = [outcome(seed, seed % 10 != 0) for seed in SEEDS]
    aim = Aim("occlusion_short", "reacquired", "says", "measures", share=0.95, floors=((PIXELS, 0.9),))
    line = line_of(aim, runs, PIXELS)
    assert (line.reached, line.share, line.is_met, line.is_short) == (18, 0.9, False, False)
    assert line_of(replace(aim, floors=((PIXELS, 0.91),)), runs, PIXELS).is_short
    assert not line_of(replace(aim, floors=((PIXELS, 0.91),)), runs, GEOMETRY).is_short, "a floor of another source"
    few = line_of(replace(aim, floors=((PIXELS, 1.0),)), runs[:5], PIXELS)
    assert not few.is_short, "floors are for all seeds"
    assert "not judged" in "\n".join(as_markdown([few], "about"))
    assert line_of(replace(aim, share=0.9), runs, PIXELS).is_met


def test_a_few_runs_give_no_verdict() -> None:
    aim = BY_NAME["occlusion_short"]
    runs = [outcome(seed, True) for seed in SEEDS]
    assert len(runs) == MIN_RUNS
    few, enough = (line_of(aim, runs[:count], PIXELS) for count in (MIN_RUNS - 1, MIN_RUNS))
    assert (few.is_met, few.verdict) == (None, TOO_FEW)
    assert (enough.is_met, enough.verdict) == (True, "aim met")
    text = "\n".join(as_markdown([few], "about"))
    assert "| 19 (100%) | 83% to 100%" in text
    assert f"| {TOO_FEW} |" in text
    assert "A verdict takes at least 20 runs: --seeds 0-19." in text
    assert "A verdict takes" not in "\n".join(as_markdown([enough], "about"))
    (values,) = as_json([few], runs, {})["scenarios"]
    assert (values["aim_met"], values["verdict"], values["interval_95"][1]) == (None, TOO_FEW, 1.0)
    assert (
        line_of(BY_NAME["lookalike"], [outcome(0, True, "lookalike", false_confirmed_share=0.0)], PIXELS).is_met is None
    )


def test_every_aim_can_be_told_from_chance_by_the_runs_of_a_verdict() -> None:
    lowest = min(aim.share for aim in AIMS if aim.share is not None)
    assert wilson(MIN_RUNS, MIN_RUNS)[0] > lowest
    assert wilson(15, 15)[0] == pytest.approx(0.80, abs=0.005)
    assert wilson(5, 5)[0] == pytest.approx(0.57, abs=0.005)


def test_means_and_their_floors() -> None:
    aim = Aim("lookalike", "false_confirmed_share", "says", "measures", mean=0.02, floors=((PIXELS, 0.03),))
    runs = [outcome(s, True, "lookalike", false_confirmed_share=0.4 if s == 3 else 0.0) for s in SEEDS]
    line = line_of(aim, runs, PIXELS)
    assert line.mean == pytest.approx(0.02)
    assert line.is_met
    assert not line.is_short
    worse = line_of(aim, [outcome(s, True, "lookalike", false_confirmed_share=0.04) for s in SEEDS], PIXELS)
    assert worse.is_short
    assert not worse.is_met
    holes = line_of(aim, [*runs[:-1], outcome(19, False, "lookalike", false_confirmed_share=None)], PIXELS)
    assert holes.mean is None
    assert holes.is_short, "a run without the number is not left out to flatter the mean"


def test_the_aims_are_those_of_scenarios_that_judge_their_metric() -> None:
    assert set(BY_NAME) <= set(builtin_names())
    for aim in AIMS:
        scenario = load_scenario(aim.scenario)
        assert aim.metric in [c.metric for c in scenario.criteria if c.when is None]
        assert (aim.share is None) != (aim.mean is None)
        assert not any(event.kind == "follow" for event in scenario.events), "the vehicle hovers"
        assert {"colour", "place"} <= {vary.value for vary in scenario.seed_policy}


# --- the runner


class Pilot:
    """In place of the processes: flies by a table, and notes what it was asked for."""

    def __init__(self, fly: Callable[[SuiteJob], Flown | str]) -> None:
        self.fly, self.asked = fly, [""] * 0
        self.stop_after: int | None = None

    def __call__(self, jobs: Sequence[SuiteJob], work: object, processes: int, report: Any, **_: object) -> None:
        self.asked = []
        for job in jobs:
            if self.stop_after is not None and len(self.asked) >= self.stop_after:
                raise KeyboardInterrupt
            self.asked.append(job.name)
            made = self.fly(job)
            if isinstance(made, str):
                report.failed(job, made)
            else:
                report.done(job, made)
            report.steps(0)


def by_seed(job: SuiteJob) -> Flown | str:
    return flown({BY_NAME[job.scenario].metric: 0.0}, True, BY_NAME[job.scenario].metric)


@pytest.fixture
def pilot(monkeypatch: pytest.MonkeyPatch) -> Pilot:
    made = Pilot(by_seed)
    monkeypatch.setattr(suite, "run_beside", made)
    monkeypatch.setattr(suite, "_identity", lambda options: f"weights of {options.model}")
    return made


def options(out: Path, **changes: Any) -> SuiteOptions:
    return replace(SuiteOptions(("leaves", "returns"), (0, 1, 2), 2, "s", "auto", "auto", out), **changes)


def test_files_and_what_is_in_them(pilot: Pilot, tmp_path: Path) -> None:
    result = run_suite(options(tmp_path / "out"))
    names = [p.name for p in sorted((tmp_path / "out").iterdir()) if p.name != ".lock"]
    assert names == ["leaves.jpg", "returns.jpg", "runs", "suite.json", "suite.md"]
    assert len(list((tmp_path / "out" / "runs").glob("*.json"))) == 6
    assert len(list((tmp_path / "out" / "runs").glob("*.jpg"))) == 6  # this pilot films every run
    assert set(result.json["columns"]) == set(result.json["scenarios"][0]["medians"])
    written = json.loads((tmp_path / "out" / "suite.json").read_text())
    assert written == json.loads(json.dumps(result.json))
    assert [s["scenario"] for s in written["scenarios"]] == ["leaves", "returns"]
    assert written["scenarios"][0]["reached"] == 3
    assert len(written["runs"]) == 6
    assert result.passed
    assert "leaves" in (tmp_path / "out" / "suite.md").read_text()
    assert pilot.asked[:2] == ["leaves-000", "returns-000"], "seed by seed"


def test_a_finished_run_is_not_flown_again(pilot: Pilot, tmp_path: Path) -> None:
    pilot.stop_after = 2
    with pytest.raises(KeyboardInterrupt):
        run_suite(options(tmp_path))
    assert not (tmp_path / "suite.json").exists(), "no table of a half"
    pilot.stop_after = None
    run_suite(options(tmp_path))
    assert pilot.asked == ["leaves-001", "returns-001", "leaves-002", "returns-002"]
    run_suite(options(tmp_path))
    assert pilot.asked == []
    run_suite(options(tmp_path, seeds=(2, 3)))
    assert pilot.asked == ["leaves-003", "returns-003"]


@pytest.mark.parametrize("change", [{"model": "full"}, {"model": None}, {"precision": "bf16"}])
def test_another_model_or_precision_is_flown(pilot: Pilot, tmp_path: Path, change: dict[str, Any]) -> None:
    run_suite(options(tmp_path))
    run_suite(options(tmp_path, **change))
    assert len(pilot.asked) == 6


def test_other_code_and_damaged_files_are_flown_again(
    pilot: Pilot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_suite(options(tmp_path))
    (tmp_path / "runs" / "leaves-001.json").write_text('{"key": ')
    run_suite(options(tmp_path))
    assert pilot.asked == ["leaves-001"]
    monkeypatch.setattr(suite, "code_hash", lambda: "other")
    run_suite(options(tmp_path))
    assert len(pilot.asked) == 6


def test_code_of_a_run_counts_and_that_of_tables_does_not(tmp_path: Path) -> None:
    for name in ("tracker/box.py", "sitl/run.py", "uavfollow/sim/suite_table.py", "tracker/training/loop.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("1")
    before = code_hash(tmp_path)
    for name in ("uavfollow/sim/suite_table.py", "tracker/training/loop.py"):
        (tmp_path / name).write_text("2")
        assert code_hash(tmp_path) == before
    seen = {before}
    for name in ("tracker/box.py", "sitl/run.py"):
        (tmp_path / name).write_text("2")
        seen.add(code_hash(tmp_path))
    assert len(seen) == 3


def test_a_run_that_breaks_is_told_and_fails_the_suite(pilot: Pilot, tmp_path: Path) -> None:
    pilot.fly = lambda job: "the engine fell off" if job.name == "returns-001" else by_seed(job)
    result = run_suite(options(tmp_path))
    assert not result.passed
    assert result.lines[1].reached == 2
    assert "returns seed 1 could not be flown: the engine fell off" in "\n".join(result.markdown)
    run_suite(options(tmp_path))
    assert pilot.asked == ["returns-001"], "what broke is tried again"


def test_a_missed_floor_fails_the_suite(pilot: Pilot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    strict = tuple(replace(aim, floors=((PIXELS, 0.9),)) for aim in AIMS if aim.scenario == "leaves")
    monkeypatch.setattr(suite, "AIMS", strict)
    chosen = options(tmp_path, names=("leaves",), seeds=SEEDS)
    assert run_suite(chosen).passed
    pilot.fly = lambda job: flown({"leave_locked_s": None}, job.seed > 2, "leave_locked_s")
    result = run_suite(replace(chosen, model="full"))
    assert not result.passed
    assert result.json["scenarios"][0]["below_floor"]
    assert "BELOW FLOOR" in "\n".join(result.markdown)


def test_a_folder_of_something_else_is_left_alone(pilot: Pilot, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("dear")
    with pytest.raises(InputError, match=r"files of something else lie there \(thesis.tex"):
        run_suite(options(tmp_path))
    assert sorted(p.name for p in tmp_path.iterdir() if p.name != ".lock") == ["thesis.tex"]


# --- processes (what they do with jobs that die, and when they are interrupted: tests/app/test_workers.py)


def _job(scenario: str, seed: int = 0) -> SuiteJob:
    return SuiteJob(scenario, seed, None, "auto", "auto", "key")


def test_a_run_that_cannot_be_is_told_in_a_line() -> None:
    with pytest.raises(JobError, match=r"^ScenarioError: .*no such scenario"):
        fly(_job("no-such-thing"), lambda: False)


def test_a_run_that_is_not_wanted_any_more_ends_at_once() -> None:
    asked = []

    def tick() -> bool:
        asked.append(True)
        return len(asked) == 3

    with orderly_end():
        assert fly(_job("returns"), tick) is None
    assert len(asked) == 3


def test_runs_go_to_other_processes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    given = {}

    def beside(jobs: Sequence[SuiteJob], work: object, processes: int, report: Any, **options: object) -> None:
        given.update(options, work=work, processes=processes, names=[job.name for job in jobs])
        for job in jobs:
            report.failed(job, "no")

    monkeypatch.setattr(suite, "run_beside", beside)
    run_suite(options(tmp_path, model=None, names=("leaves",)))
    names = ["leaves-000", "leaves-001", "leaves-002"]
    assert given == {
        "work": fly, "processes": 2, "names": names, "stop_s": suite.STOP_S, "died": suite.DIED,
    }  # fmt: skip
    assert (pickle.loads(pickle.dumps(fly)), pickle.loads(pickle.dumps(_job("leaves")))) == (fly, _job("leaves"))


# --- the command line


@pytest.mark.parametrize(
    ("text", "seeds"), [("0-3", (0, 1, 2, 3)), ("7", (7,)), ("5,1-2, 1", (1, 2, 5)), ("4294967295", (2**32 - 1,))]
)
def test_seeds(text: str, seeds: tuple[int, ...]) -> None:
    assert parse_seeds(text) == seeds


@pytest.mark.parametrize("text", ["", "3-1", "a", "1-", "-1", "0-1000", "4294967296", "1;2", "²"])
def test_seeds_that_are_none(text: str) -> None:
    with pytest.raises(InputError, match="--seeds"):
        parse_seeds(text)


def test_help_tells_what_each_scenario_measures(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        command("--help")
    lines = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()]
    for aim in AIMS:
        assert [aim.scenario, aim.measures] in lines
        assert aim.measures.endswith("?")


def test_what_cannot_be_written_is_named(pilot: Pilot, tmp_path: Path) -> None:
    blocked = tmp_path / "out" / "runs" / "returns-001.jpg"
    blocked.mkdir(parents=True)
    with pytest.raises(InputError, match=r"returns-001\.jpg: cannot be written \(Is a directory\); make room"):
        run_suite(options(tmp_path / "out"))
    blocked.rmdir()
    run_suite(options(tmp_path / "out"))
    assert pilot.asked == ["returns-001", "leaves-002", "returns-002"], "what was finished is kept"


def command(*arguments: str) -> int:
    parser = argparse.ArgumentParser()
    bench_suite.add_verb(parser.add_subparsers())
    parsed = parser.parse_args(["suite", *arguments])
    return int(parsed.run(parsed))


def test_the_command(pilot: Pilot, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ("leaves", "--seeds", "0-1", "--out", str(tmp_path / "out"))
    assert command(*given) == EXIT_DONE
    assert TOO_FEW in capsys.readouterr().out
    assert command(*given, "--json") == EXIT_DONE
    assert json.loads(capsys.readouterr().out)["model"] == "s"
    pilot.fly = lambda job: "broken"
    assert command(*given, "--model", "full") == EXIT_SHORT
    pilot.stop_after = 0
    assert command(*given, "--geometry") == EXIT_INTERRUPTED
    for wrong, message in ((("leafs",), "not in the suite"), (("--jobs", "0"), "--jobs 0 is out of range")):
        with pytest.raises(InputError, match=message):
            command(*wrong)
