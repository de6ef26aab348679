"""Trackers by name: our own without the metadata of an installation, others by entry point, broken ones by name."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

from tracker.confidence.model import UNFITTED
from tracker.raw import RawTarget
from tracker.target import TargetTracker
from tracker.weights.build import BuiltTracker, build_tracker, identity_of
from uavfollow.errors import InputError
from uavfollow.trackers import TrackerSpec, build, known_names, make_target, parse_spec, parse_specs

PLUG_IN = """
from tracker.weights.build import BuiltTracker

def make(model, precision, device, threads):
    if model == "bad":
        raise ValueError("bad: no such model")
    if model == "worse":
        return 1 / 0
    if model == "other":
        return "a tracker"
    return BuiltTracker(object(), f"{precision} {device} {threads}", f"id of {model or 'its own'}", None)

NOTHING = 1
"""


@pytest.fixture
def plug_ins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Sets the entry points; beside the modules `plug_in`, which works, and `broken`, which cannot be imported."""
    (tmp_path / "plug_in.py").write_text(PLUG_IN)
    (tmp_path / "broken.py").write_text("import no_such_module\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "plug_in", raising=False)

    def offer(**entries: str) -> None:
        made = [metadata.EntryPoint(name, value, "uavfollow.trackers") for name, value in entries.items()]
        monkeypatch.setattr(metadata, "entry_points", lambda group: made if group == "uavfollow.trackers" else [])

    return offer


@pytest.mark.parametrize(
    ("text", "spec"),
    [
        ("siamapnpp", TrackerSpec("siamapnpp", "s", False)),
        ("siamapnpp+raw", TrackerSpec("siamapnpp", "s", True)),
        ("siamapnpp@full+raw", TrackerSpec("siamapnpp", "full", True)),
        (" siamapnpp@runs/a+b/m.safetensors ", TrackerSpec("siamapnpp", "runs/a+b/m.safetensors", False)),
        ("nanotrack@some/folder", TrackerSpec("nanotrack", "some/folder", False)),
        ("nanotrack", TrackerSpec("nanotrack", "", False)),
    ],
)
def test_a_spec_is_name_model_and_raw(text: str, spec: TrackerSpec) -> None:
    assert parse_spec(text) == spec
    assert parse_spec(str(spec)) == spec


def test_a_model_from_elsewhere_counts_where_the_spec_names_none() -> None:
    assert parse_spec("siamapnpp", "full").model == "full"
    assert parse_spec("siamapnpp@s", "full").model == "s"
    assert parse_spec("nanotrack+raw", "folder") == TrackerSpec("nanotrack", "folder", True)


def test_the_label_has_no_folders() -> None:
    assert parse_spec("nanotrack@a/b/v3+raw").label == "nanotrack@v3+raw"
    assert parse_spec("siamapnpp").label == "siamapnpp@s"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("siamapn", "did you mean siamapnpp?"),
        ("nanotrak@folder+raw", "did you mean nanotrack"),
        ("siamapnpp+RAW", "unknown tracker"),
        ("", "Known are siamapnpp, nanotrack"),
        ("siamapnpp@", "names no model"),
        ("siamapnpp@+raw", "names no model"),
        ("siamapnpp,siamapnpp@s", "named twice"),
    ],
)
def test_a_bad_spec_says_what_is_wrong(text: str, reason: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_specs(text)
    assert reason in str(caught.value)


def test_several_specs() -> None:
    assert [str(s) for s in parse_specs("siamapnpp@full, siamapnpp+raw")] == ["siamapnpp@full", "siamapnpp@s+raw"]


def test_our_own_need_no_metadata(plug_ins) -> None:
    plug_ins()
    assert known_names() == ("siamapnpp", "nanotrack")
    built = build(parse_spec("siamapnpp"), "fp32", "cpu")
    assert built.engine.endswith("fp32")


def test_the_project_declares_what_the_table_knows() -> None:
    from uavfollow.trackers import BUILT_IN

    tomllib = pytest.importorskip("tomllib", reason="Python 3.10 has no TOML reader")
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    declared = project["entry-points"]["uavfollow.trackers"]
    assert declared == {name: ours.where for name, ours in BUILT_IN.items()}


def test_a_plug_in_is_built_by_its_name(plug_ins) -> None:
    plug_ins(mine="plug_in:make")
    assert known_names() == ("siamapnpp", "nanotrack", "mine")
    built = build(parse_spec("mine@big"), "fp32", "cpu", 3)
    assert (built.engine, built.identity) == ("fp32 cpu 3", "id of big")
    assert build(parse_spec("mine")).identity == "id of its own"


def test_a_plug_in_cannot_take_the_name_of_ours(plug_ins) -> None:
    plug_ins(siamapnpp="plug_in:make")
    assert known_names() == ("siamapnpp", "nanotrack")
    assert not build(parse_spec("siamapnpp"), "fp32", "cpu").identity.startswith("id of")


@pytest.mark.parametrize(
    ("spec", "entry", "reason"),
    [
        ("mine", "broken:make", "'mine' (broken:make of an unknown distribution) cannot be imported"),
        ("mine", "plug_in:absent", "'mine' (plug_in:absent of an unknown distribution) cannot be imported"),
        ("mine", "plug_in:NOTHING", "it must be a factory"),
        ("mine@bad", "plug_in:make", "tracker mine@bad: bad: no such model"),
        ("mine@worse", "plug_in:make", "tracker mine@worse: the plug-in failed (ZeroDivisionError"),
        ("mine@other", "plug_in:make", "tracker mine@other: the plug-in gave a str"),
    ],
)
def test_a_broken_plug_in_is_named_and_hurts_nobody_else(plug_ins, spec: str, entry: str, reason: str) -> None:
    plug_ins(mine=entry, good="plug_in:make")
    with pytest.raises(InputError) as caught:
        build(parse_spec(spec))
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)
    assert build(parse_spec("good")).identity == "id of its own"


def test_two_plug_ins_of_one_name_are_told(plug_ins, monkeypatch: pytest.MonkeyPatch) -> None:
    both = [metadata.EntryPoint("mine", value, "uavfollow.trackers") for value in ("plug_in:make", "broken:make")]
    monkeypatch.setattr(metadata, "entry_points", lambda group: both)
    with pytest.raises(InputError, match="uninstall one"):
        build(parse_spec("mine"))


def test_bad_weights_are_bad_input() -> None:
    with pytest.raises(InputError, match="tracker siamapnpp@xl: xl: no such weights file"):
        build(parse_spec("siamapnpp@xl"))
    with pytest.raises(InputError, match=r"tracker nanotrack: .*nanotrack@FOLDER"):
        build(parse_spec("nanotrack"))


def test_the_target_is_that_of_the_spec() -> None:
    built = BuiltTracker(object(), "none", "none", UNFITTED)  # type: ignore[arg-type]
    assert isinstance(make_target(TrackerSpec("siamapnpp", "s", True), built), RawTarget)
    assert isinstance(make_target(TrackerSpec("siamapnpp", "s", False), built), TargetTracker)


def test_the_identity_changes_with_what_results_depend_on() -> None:
    assert build_tracker("s", "fp32", "cpu").identity == build_tracker("s", "fp32", "cpu").identity
    parts = {"weights": "a", "settings": "b", "confidence": {"bias": 1.0}, "engine": "c"}
    for name in parts:
        assert identity_of(**parts) != identity_of(**{**parts, name: "other"})


def test_names_are_known_without_pytorch() -> None:
    code = "import sys, uavfollow.trackers as t; t.parse_spec('nanotrack@x'); print('torch' in sys.modules)"
    told = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2],
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    assert told.stdout.strip() == "False"
