"""Shared by all tests: one deterministic hypothesis profile, one thread for torch."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from hypothesis import settings

import uavfollow.video.source  # noqa: F401  (MAVLINK20 and the log level of FFmpeg count from their first use on)

settings.register_profile("ci", derandomize=True, deadline=None)
settings.load_profile("ci")
os.environ.setdefault("MPLBACKEND", "Agg")
# One thread: two spinning ones collapse when anything else runs on the same cores.
os.environ["OMP_NUM_THREADS"] = "1"

# A job in the background inherits ignored signals, and the program respects that; its tests are about the other case.
for one, usual in (
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGTERM, signal.SIG_DFL),
    (signal.SIGHUP, signal.SIG_DFL),
):
    if signal.getsignal(one) is signal.SIG_IGN:
        signal.signal(one, usual)

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared"


@pytest.fixture
def sequences() -> Path:
    """Folder of the real UAV sequences, which only developers have."""
    folder = SHARED / "sequences"
    if not folder.is_dir():
        pytest.skip("the ten real UAV sequences are not part of the project (../shared/sequences is absent)")
    return folder
