"""The entry point: what is imported when, foreign packages, versions, exit codes, weights commands."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from tests.conftest import ROOT
from tests.tracker.keys import synthetic_state

HEAVY = ("torch", "filterpy", "matplotlib", "cv2", "pymavlink")


def _python(code: str, path: Path | None = None, **environment: str) -> subprocess.CompletedProcess[str]:
    paths = [str(p) for p in (path, ROOT) if p]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), **environment}
    # In `path`, since the current folder comes first on the import path of `-c`.
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, env=env, cwd=path or ROOT, check=False)


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys\nfrom uavfollow.__main__ import main\n"
        "try: main(['track', '--help'])\nexcept SystemExit: pass\n"
        f"print('HEAVY', [m for m in {HEAVY!r} if m in sys.modules])"
    )
    result = _python(code)
    assert result.stdout.rstrip().endswith("HEAVY []"), result.stdout + result.stderr
    assert "--box" in result.stdout


def test_errors_of_the_source_do_not_import_torch() -> None:
    code = (
        "import sys\nfrom uavfollow.__main__ import main\n"
        "print(main(['track', 'nowhere.mp4', '--box', '1,2,3,4']), 'torch' in sys.modules)"
    )
    assert _python(code).stdout.strip() == "2 False"


@pytest.mark.parametrize("first", ["uavfollow", "uavfollow.mavlink.packer", "uavfollow.cli", "uavfollow.__main__"])
@pytest.mark.parametrize("before", ["", "MAVLINK10"])
def test_mavlink_2_whatever_is_imported_first(first: str, before: str) -> None:
    code = (
        f"import {first}\nfrom pymavlink import mavutil\n"
        "print(mavutil.mavlink.WIRE_PROTOCOL_VERSION, mavutil.mavlink20())"
    )
    environment = {before: "1"} if before else {}
    assert _python(code, **environment).stdout.split() == ["2.0", "True"]


def test_a_foreign_control_package_is_named_and_not_run(tmp_path: Path) -> None:
    fake = tmp_path / "control"
    fake.mkdir()
    (fake / "__init__.py").write_text("print('FOREIGN CODE RUNS')\n")
    info = tmp_path / "control-0.10.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: control\nVersion: 0.10.1\n")
    (info / "RECORD").write_text("control/__init__.py,,\ncontrol-0.10.1.dist-info/METADATA,,\n")
    (info / "top_level.txt").write_text("control\n")
    result = _python("import sys; from uavfollow.__main__ import main; sys.exit(main(['--help']))", path=tmp_path)
    assert result.returncode == 2
    assert result.stdout == ""
    assert len(result.stderr.strip().splitlines()) == 1
    assert "package `control`" in result.stderr
    assert "the distribution 'control' 0.10.1" in result.stderr
    assert "virtual environment" in result.stderr


def test_a_missing_package_is_told() -> None:
    from uavfollow.errors import InputError
    from uavfollow.packages import check_packages

    check_packages()
    with pytest.raises(InputError, match="missing; reinstall"):
        check_packages(("no_such_package_of_ours",))


def test_version_and_unknown_command(cli) -> None:
    with pytest.raises(SystemExit) as stopped:
        cli("--version")
    assert stopped.value.code == 0
    result = cli("trakc")
    assert result.code == 2
    assert "trakc" in result.err
    assert len(result.err.strip().splitlines()) == 1


def test_the_module_runs_as_a_program() -> None:
    result = subprocess.run(
        [sys.executable, "-m", "uavfollow", "weights", "info", "--json"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=True,
    )
    card = json.loads(result.stdout)
    assert card["size"] == "s"
    assert len(card["sha256"]) == 64


def test_weights_info_prints_the_card(cli) -> None:
    result = cli("weights", "info", "full")
    assert result.code == 0
    for part in ("size: full", "12161939", "sha256", "licence_note"):
        assert part in result.out


def test_weights_import_and_use(tmp_path: Path, cli) -> None:
    state = {f"module.{k}": v for k, v in synthetic_state().items()}
    torch.save({"epoch": 1, "state_dict": state, "optimizer": {}}, tmp_path / "official.pth")
    result = cli("weights", "import", tmp_path / "official.pth")
    assert result.code == 0
    assert "12,161,939 parameters" in result.out
    info = cli("weights", "info", tmp_path / "official.safetensors")
    assert "imported from official.pth" in info.out
    again = cli("weights", "import", tmp_path / "official.pth")
    assert again.code == 2
    assert "exists already" in again.err


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("weights", "info", "xl"), "no such weights file"),
        (("weights", "import", "none.pth"), "no such checkpoint"),
        (("weights", "import", "none.pth", "--out", "x.bin"), ".safetensors"),
        (("weights",), "VERB"),
        ((), "COMMAND"),
    ],
)
def test_bad_weights_commands_are_one_line(arguments: tuple[str, ...], word: str, cli) -> None:
    result = cli(*arguments)
    assert result.code == 2
    assert word in result.err
    assert len(result.err.strip().splitlines()) == 1
