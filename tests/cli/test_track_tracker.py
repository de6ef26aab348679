"""`uavfollow track --tracker`: another tracker by name, and options that contradict each other."""

from __future__ import annotations

import json
import sys
from importlib import metadata
from pathlib import Path

import pytest

from tests.cli.conftest import Material
from uavfollow.trackers import GROUP

PLUG_IN = """
from tracker.messages import Candidate
from tracker.weights.build import BuiltTracker

class Still:
    def init(self, frame, box):
        self.box = box

    def update(self, frame, hint=None):
        return (Candidate(self.box, 0.9, 0.9, 0.9),)

def make(model, precision, device, threads):
    return BuiltTracker(Still(), f"still with {model}", "1", None)
"""


@pytest.fixture
def still(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A plug-in `still`, whose target never moves."""
    (tmp_path / "still_plug_in.py").write_text(PLUG_IN)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "still_plug_in", raising=False)
    entries = [metadata.EntryPoint("still", "still_plug_in:make", GROUP)]
    monkeypatch.setattr(metadata, "entry_points", lambda group: entries if group == GROUP else [])


@pytest.mark.parametrize(
    ("options", "model", "raw"),
    [
        (("--tracker", "still@x"), "still@x", False),
        (("--tracker", "still", "--model", "x", "--raw"), "still@x", True),
        (("--tracker", "still+raw"), "still", True),
    ],
)
def test_a_plug_in_tracks(
    options: tuple[str, ...], model: str, raw: bool, material: Material, tmp_path: Path, cli, still: None
) -> None:
    out = tmp_path / "o"
    result = cli(
        "track", material.folder, "--box", material.box, "--out", out, "--no-video", "--max-frames", 3, *options
    )
    assert result.code == 0, result.err
    kept = json.loads((out / "summary.json").read_text())
    assert kept["settings"]["tracker"] == "still"
    assert kept["settings"]["raw"] is raw
    assert kept["model"] == model
    assert kept["engine"].startswith("still with")
    assert kept["faults"] == 0


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (("--tracker", "siamapn"), "did you mean siamapnpp?"),
        (("--tracker", "siamapnpp@s", "--model", "full"), "--tracker siamapnpp@s names a model too"),
        (("--tracker", "nanotrack"), "nanotrack@FOLDER"),
        (("--tracker", "nanotrack@no/such/folder"), "nanotrack_backbone.onnx: no such file"),
        (("--tracker", "nanotrack@x", "--precision", "bf16"), "fp32 on the cpu only"),
    ],
)
def test_what_cannot_be_built_is_one_line(
    options: tuple[str, ...], reason: str, material: Material, tmp_path: Path, cli
) -> None:
    out = tmp_path / "o"
    result = cli("track", material.folder, "--box", material.box, "--out", out, "--no-video", *options)
    assert result.code == 2
    assert reason in result.err
    assert len(result.err.strip().splitlines()) == 1
    assert not out.exists()
