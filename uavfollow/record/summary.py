"""What a tracking run came to, in numbers."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from tracker.benchmark.scores import Scores, score
from tracker.box import Box
from tracker.engines.cpu import describe_cpu
from tracker.messages import TargetStatus
from uavfollow.app import StepRecord

Truth = list[Box | None] | None
SECTIONS = ("read", "track", "filter", "write")


@dataclass(frozen=True, slots=True)
class TrackSummary:
    """`rates_fps` is frames per second of each section alone, `total` of all together; `scores` None without truth.

    `settings` is what the user chose and what the numbers depend on.
    """

    source: str
    model: str
    engine: str
    cpu: str
    frames: int
    duration_s: float
    status_share: dict[str, float]
    reasons: dict[str, int]
    rates_fps: dict[str, float]
    scores: Scores | None
    faults: int
    first_fault: str | None
    settings: dict[str, str | float | bool | None]
    interrupted: bool
    files: tuple[str, ...] = ()

    def with_files(self, files: Sequence[Path]) -> TrackSummary:
        """The same with the paths of what was written."""
        return replace(self, files=tuple(str(f) for f in files))

    def show(self, as_json: bool) -> None:
        """Print it."""
        if as_json:
            print(self.json())
            return
        print("\n".join(self.lines()))
        for path in self.files:
            print(f"  wrote {path}")
        report = next((f for f in self.files if f.endswith("report.html")), None)
        if report is not None:
            print(f"report: {Path(report).resolve()}")

    def json(self) -> str:
        """The summary as JSON text."""
        return json.dumps(asdict(self), indent=1)

    def lines(self) -> list[str]:
        """The summary as text, without the files."""
        shares = ", ".join(f"{name} {100 * share:.0f} %" for name, share in self.status_share.items())
        rates = ", ".join(f"{name} {self.rates_fps[name]:.0f}" for name in SECTIONS if name in self.rates_fps)
        lines = [
            f"{self.source}: {self.frames} frames{', then interrupted' if self.interrupted else ''}, "
            f"{self.duration_s:.1f} s, model {self.model}, {self.engine}",
            f"  status: {shares}",
            f"  frames per second: {self.rates_fps['total']:.1f}; if it were alone: {rates}",
            f"  processor: {self.cpu}",
        ]
        if self.scores is not None and self.scores.auc is not None and self.scores.p20 is not None:
            lines.append(
                f"  success AUC {self.scores.auc:.3f}, precision at 20 px {self.scores.p20:.3f} "
                f"over the {self.scores.frames} frames with a target in sight"
            )
        elif self.scores is not None:
            lines.append("  no scores: the truth has no frame with a target")
        if self.faults:
            frames = "frame" if self.faults == 1 else "frames"
            lines.append(f"  {self.faults} {frames} with a fault; the first: {self.first_fault}")
        chosen = ", ".join(f"{k} {v}" for k, v in self.settings.items() if v is not None and v is not False)
        lines.append(f"  settings: {chosen}")
        return lines


def summarise(
    source: str,
    fps: float,
    records: Sequence[StepRecord],
    truth: Truth,
    model: str,
    engine: str,
    spent_s: dict[str, float],
    settings: dict[str, str | float | bool | None],
    interrupted: bool,
) -> TrackSummary:
    """Count, rate and score a run."""
    count = len(records)
    statuses = Counter(r.target.status for r in records)
    rates = {name: count / spent_s[name] for name in SECTIONS if spent_s.get(name, 0.0) > 0}
    rates["total"] = count / max(sum(spent_s.values()), 1e-9)
    faults = [f"frame {r.seq}: {r.fault}" for r in records if r.fault is not None]
    return TrackSummary(
        source=source,
        model=model,
        engine=engine,
        cpu=describe_cpu(),
        frames=count,
        duration_s=records[-1].t_s - records[0].t_s + 1.0 / fps,
        status_share={s.value: statuses[s] / count for s in TargetStatus if statuses[s]},
        reasons=dict(Counter(r.target.reason.value for r in records)),
        rates_fps=rates,
        scores=score([r.target.box for r in records], truth[:count]) if truth is not None else None,
        faults=len(faults),
        first_fault=faults[0] if faults else None,
        settings=settings,
        interrupted=interrupted,
    )
