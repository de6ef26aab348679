"""Options of a benchmark with fakes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.benchmark import fakes
from tracker.benchmark.scores import Mode
from uavfollow.benchmark import files
from uavfollow.benchmark.options import BenchOptions
from uavfollow.trackers import TrackerSpec

BRIGHT = TrackerSpec("bright", "", False)
RAW = TrackerSpec("bright", "", True)


@pytest.fixture
def options(tmp_path: Path) -> Callable[..., BenchOptions]:
    """Options over tmp_path/data into tmp_path/out."""

    def make(*trackers: TrackerSpec, **changes: Any) -> BenchOptions:
        values = {"paths": (tmp_path / "data",), "out": tmp_path / "out", "mode": Mode.HONEST, "build": fakes.build}
        return BenchOptions(trackers=trackers or (BRIGHT,), **{**values, **changes})

    return make


@pytest.fixture
def no_plots(monkeypatch: pytest.MonkeyPatch) -> None:
    """Most of the time of a small benchmark goes into its plots."""
    monkeypatch.setattr(files, "plot_errors", lambda path, scores: None)
    monkeypatch.setattr(files, "plot_means", lambda report, folder: ())
