"""The results of the suite as numbers, as a table and as suite.json."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sitl.metrics import Verdict
from uavfollow.sim.suite_aims import BY_NAME, MIN_RUNS, SEEDS, Aim

SCHEMA = 2
Z_95 = 1.959964  # of a normal distribution: 95 % lie within so many sigma
# Metrics of a run (sitl/metrics/) of which the median over the runs is shown.
MEDIANS = {
    "hidden_longest_s": "the longest time without any of the target visible",
    "visible_again_s": "how long after that the target stays in sight, by half of it or more",
    "reacquire_s": "from being in sight again to LOCKED on the target, 0 when it is so already; unlike "
    "reacquire_median_s of `uavfollow sim`, which is of every hidden time in which the lock was given up",
    "leave_locked_s": "from a true loss to the first sample that is not LOCKED",
    "lock_share": "LOCKED on the target, of the time with it in sight",
    "honest_lock_share": "LOCKED, of the time in which the box overlaps the target by more than 0.5",
    "false_confirmed_share": "LOCKED with the target hidden or overlapped by less than 0.2, of all the time",
    "iou_mean": "mean overlap with the target in sight",
}
TOO_FEW = "too few runs for a verdict"
HEAD = ("scenario", "runs", "aim", "reached", "95 % interval", "mean", "floor", "verdict")


@dataclass(frozen=True, slots=True)
class Outcome:
    """A run of the suite: its run.json, or the line that says why there is none."""

    scenario: str
    seed: int
    run: dict[str, Any] | None
    wall_s: float
    problem: str | None = None

    @property
    def reached(self) -> bool:
        """Whether it meets its scenario's criterion for the aim's metric."""
        metric = BY_NAME[self.scenario].metric
        verdicts = [c["verdict"] for c in self.run["criteria"] if c["metric"] == metric] if self.run else []
        return bool(verdicts) and all(verdict == Verdict.PASSED.value for verdict in verdicts)

    def metric(self, name: str) -> float | None:
        """One of its metrics; None when it is undefined or there is no run."""
        value = self.run["metrics"].get(name) if self.run else None
        return None if value is None else float(value)


@dataclass(frozen=True, slots=True)
class Line:
    """One scenario over its seeds. `mean` of the aim's metric where the aim is one; medians of what is defined."""

    aim: Aim
    runs: int
    reached: int
    interval: tuple[float, float]
    mean: float | None
    medians: dict[str, float | None]
    floor: float | None
    judged: bool
    wall_s: float

    @property
    def share(self) -> float:
        """Of the runs, those that reach the aim."""
        return self.reached / self.runs

    @property
    def is_met(self) -> bool | None:
        """Whether the aim is met, gating or not; None when there are too few runs to say so."""
        if self.runs < MIN_RUNS:
            return None
        if self.aim.mean is not None:
            return self.mean is not None and self.mean <= self.aim.mean
        return self.aim.share is not None and self.share >= self.aim.share

    @property
    def is_short(self) -> bool:
        """Whether a floor is missed."""
        if self.floor is None or not self.judged:
            return False
        if self.aim.mean is not None:
            return self.mean is None or self.mean > self.floor
        return self.share < self.floor

    @property
    def verdict(self) -> str:
        """In a few words."""
        if self.is_short:
            return "BELOW FLOOR"
        if self.is_met is None:
            return TOO_FEW
        return "aim met" if self.is_met else "aim missed"


def wilson(hits: int, count: int, z: float = Z_95) -> tuple[float, float]:
    """Wilson's interval of a share: honest for few runs and for shares near 0 and 1. Raises ValueError for no runs.

    Source: Wilson, Journal of the American Statistical Association 22 (1927), 209-212; method 3 of Newcombe,
    Statistics in Medicine 17 (1998), 857-872.
    """
    if not 0 <= hits <= count or count == 0:
        raise ValueError(f"wilson: {hits} of {count}")
    share, square = hits / count, z * z / count
    middle = (share + square / 2) / (1 + square)
    half = z * math.sqrt(share * (1 - share) / count + square / 4 / count) / (1 + square)
    # Rounding must not bring 0 of n above 0, or n of n below 1.
    return (0.0 if hits == 0 else middle - half), (1.0 if hits == count else middle + half)


def line_of(aim: Aim, outcomes: Sequence[Outcome], source: str) -> Line:
    """The outcomes of one scenario. A run that could not be made reaches nothing. Raises ValueError for none."""
    reached = sum(o.reached for o in outcomes)
    values = [o.metric(aim.metric) for o in outcomes]
    defined = [v for v in values if v is not None]
    whole = len(defined) == len(values)  # a mean over the runs that went well would flatter
    return Line(
        aim=aim,
        runs=len(outcomes),
        reached=reached,
        interval=wilson(reached, len(outcomes)),
        mean=statistics.fmean(defined) if aim.mean is not None and whole else None,
        medians={name: _median([o.metric(name) for o in outcomes]) for name in MEDIANS},
        floor=aim.floor(source),
        judged=set(SEEDS) <= {o.seed for o in outcomes},
        wall_s=statistics.median(o.wall_s for o in outcomes),
    )


def as_markdown(lines: Sequence[Line], about: str) -> list[str]:
    """Two tables: what was reached, and the medians."""
    rows = [HEAD, *(_row(line) for line in lines)]
    medians = [("scenario", *MEDIANS), *((w.aim.scenario, *(_shown(w.medians[m]) for m in MEDIANS)) for w in lines)]
    notes = [line for note in _notes(lines) for line in ("", note)]
    return [about, "", *_table(rows), *notes, "", "Medians over the runs in which the number is defined:", "",
            *_table(medians)]  # fmt: skip


def _notes(lines: Sequence[Line]) -> list[str]:
    told = ["The interval is Wilson's for the share that reached the aim. A verdict goes by the share or mean itself."]
    if any(line.is_met is None for line in lines):
        told.append(f"A verdict takes at least {MIN_RUNS} runs: --seeds {SEEDS[0]}-{SEEDS[-1]}.")
    if any(line.floor is not None and not line.judged for line in lines):
        told.append(f"Floors are for seeds {SEEDS[0]}-{SEEDS[-1]} and are not judged here.")
    return told


def as_json(lines: Sequence[Line], outcomes: Sequence[Outcome], about: dict[str, Any]) -> dict[str, Any]:
    """suite.json."""
    return {
        "schema": SCHEMA,
        **about,
        "columns": MEDIANS,
        "passed": not any(line.is_short for line in lines) and not any(o.problem for o in outcomes),
        "scenarios": [_line_json(line) for line in lines],
        "runs": [
            {
                "scenario": o.scenario,
                "seed": o.seed,
                "reached": o.reached,
                "problem": o.problem,
                "wall_s": round(o.wall_s, 2),
                "metrics": o.run["metrics"] if o.run else None,
            }
            for o in outcomes
        ],
    }


def _line_json(line: Line) -> dict[str, Any]:
    return {
        "scenario": line.aim.scenario,
        "metric": line.aim.metric,
        "measures": line.aim.measures,
        "aim": line.aim.says,
        "verdict": line.verdict,
        "aim_met": line.is_met,
        "runs": line.runs,
        "reached": line.reached,
        "share": line.share,
        "interval_95": list(line.interval),
        "mean": line.mean,
        "floor": line.floor,
        "floor_judged": line.judged and line.floor is not None,
        "below_floor": line.is_short,
        "medians": line.medians,
        "wall_median_s": round(line.wall_s, 2),
    }


def _row(line: Line) -> tuple[str, ...]:
    low, high = line.interval
    return (
        line.aim.scenario, str(line.runs), line.aim.says, f"{line.reached} ({line.share:.0%})",
        f"{low:.0%} to {high:.0%}", _shown(line.mean), _shown(line.floor), line.verdict,
    )  # fmt: skip


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    made = ["| " + " | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) + " |" for row in rows]
    return [made[0], "|" + "|".join("-" * (w + 2) for w in widths) + "|", *made[1:]]


def _median(values: Sequence[float | None]) -> float | None:
    defined = [v for v in values if v is not None]
    return statistics.median(defined) if defined else None


def _shown(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"
