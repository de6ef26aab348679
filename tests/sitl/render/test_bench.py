from __future__ import annotations

from pathlib import Path

import pytest

from sitl.render.bench import main


def test_benchmark_prints_its_figures_and_writes_pictures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--frames", "2", "--out", str(tmp_path / "pictures")]) == 0
    printed = capsys.readouterr().out
    for words in ("processor features", "world built in", "picture with truth", "ground and sky", "geometry only"):
        assert words in printed
    assert [path.name for path in (tmp_path / "pictures").iterdir()] == ["0000.png"]
