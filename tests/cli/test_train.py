"""`uavfollow train` and `uavfollow bench`: runs on a drawn clip, resuming, packs, previews, diagnosis, errors."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import cv2
import pytest

from tests.cli.conftest import TINY_RECIPE as RECIPE
from tests.cli.test_entry import _python
from tracker.training.curves import Curves
from tracker.training.progress import Progress
from tracker.training.recipe_file import parse_recipe
from uavfollow.training.folder import difference, run_folder
from uavfollow.training.progress import duration, told
from uavfollow.training.run import RunOptions, effective_recipe
from uavfollow.training.stop import stop_on_signal


@pytest.fixture(autouse=True)
def _no_curves(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawing them takes longer than the runs here; tests/tracker/training has them."""
    monkeypatch.setattr(Curves, "draw", lambda self: None)


@pytest.fixture
def train(cli, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """`uavfollow train run` of the tiny recipe in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    return lambda *more: cli("train", "run", data / "tiny.yaml", "--data", data, "--workers", 0, *more)


def test_help_and_lists_import_nothing_heavy() -> None:
    code = (
        "import sys\nfrom uavfollow.__main__ import main\n"
        "main(['train', 'list']), main(['train', 'show', 'smoke'])\n"
        "try: main(['train', 'run', '--help'])\nexcept SystemExit: pass\n"
        "print('HEAVY', [m for m in ('torch', 'cv2', 'matplotlib', 'pymavlink') if m in sys.modules])"
    )
    result = _python(code)
    assert result.stdout.rstrip().endswith("HEAVY []"), result.stdout + result.stderr
    for word in ("paper  ", "name: smoke", "--minutes"):
        assert word in result.stdout


def test_a_run_is_trained_and_goes_on_only_when_asked(train, cli, data: Path) -> None:
    first = train("--pairs", 4)
    assert first.code == 0, first.err
    out = Path("runs/train-tiny")
    for part in ("4 pairs in", "validation at 4 pairs: AUC", f"wrote {out}/weights.safetensors", "use them with:"):
        assert part in first.out
    assert "clip: 1 targets in 24 views, 100.0% of the pairs" in first.err

    again = train("--pairs", 4, "--out", out)
    assert (again.code, again.out) == (2, "")
    assert again.err == (
        f"uavfollow: error: --out {out}: a run lies there; add --resume to go on with it, or choose another folder\n"
    )
    other = train("--pairs", 6, "--out", out, "--resume")
    assert other.code == 2
    assert "another recipe: stages[0].pairs was 4 and is 6; give the same recipe" in other.err

    done = train("--pairs", 4, "--out", out, "--resume", "--json")
    assert done.code == 0, done.err
    told_as_json = json.loads(done.out)
    assert told_as_json["finished"] is True
    assert told_as_json["pairs"] == 4
    assert cli("weights", "info", out / "weights.safetensors").out.startswith("siamapnpp-s-tiny")


def test_a_signal_ends_a_run_in_order_and_it_is_resumed(train, monkeypatch: pytest.MonkeyPatch) -> None:
    from uavfollow.training.progress import TrainProgress

    with monkeypatch.context() as patch:
        patch.setattr(TrainProgress, "show", lambda self, progress: os.kill(os.getpid(), signal.SIGTERM))
        stopped = train()
    assert stopped.code == 130, stopped.err
    assert "stopping: the step is finished and everything saved" in stopped.err
    (advice,) = [line for line in stopped.err.splitlines() if line.startswith("stopped; go on with: ")]
    assert "--out runs/train-tiny --resume" in advice
    assert "2 pairs in" in stopped.out
    done = train("--out", Path(advice.split("--out ")[1].split()[0]), "--resume")
    assert done.code == 0, done.err
    assert "8 pairs in" in done.out


def test_train_from_a_pack(train, cli, data: Path) -> None:
    packed = cli("train", "prepare", data / "tiny.yaml", "--data", data, "--out", "pack", "--limit", 8)
    assert packed.code == 0, packed.err
    assert "clip: 8 crops of 1 targets" in packed.out
    assert "--packed pack" in packed.out
    result = train("--packed", "pack", "--pairs", 2, "--json", "--out", "run")
    assert result.code == 0, result.err
    recipe = json.loads(Path("run/recipe.json").read_text())
    assert [(s["kind"], s["set_name"]) for s in recipe["sources"]] == [("packed", "clip")]
    refused = train("--resident")
    assert "--resident keeps packed crops on the device; give --packed DIR" in refused.err


def test_validate(cli, data: Path) -> None:
    result = cli("train", "validate", "s", data / "val/b", "--starts", 2, "--max-frames", 3, "--threads", 1)
    assert result.code == 0, result.err
    head, row, mean = result.out.splitlines()
    assert head == "model s, raw tracker, at most 3 frames from each of 2 starts"
    assert row.startswith("b          6 frames  AUC 0.")
    assert mean.startswith("mean       6 frames  AUC 0.")
    by_recipe = cli("train", "validate", "s", "--recipe", data / "tiny.yaml", "--data", data, "--json")
    told = json.loads(by_recipe.out)
    assert (told["starts"], told["max_frames"], told["sequences"]["b"]["frames"]) == (1, 3, 3)
    assert 0.3 < told["mean"]["auc"] <= 20 / 21
    parent = cli("train", "validate", "s", data / "val", "--max-frames", 2, "--threads", 1)
    assert parent.out.splitlines()[1].startswith("b          2 frames"), "a folder of sequences stands for all of them"
    (data / "bare.yaml").write_text(RECIPE[: RECIPE.index("validation:")])
    bare = cli("train", "validate", "s", "--recipe", data / "bare.yaml", "--data", data)
    assert (bare.code, bare.err.count("\n")) == (2, 1)
    assert "no sequence to track: name some, or add sources to the recipe's validation" in bare.err
    refused = cli("train", "validate", "s")
    assert (refused.code, refused.err.count("\n")) == (2, 1)
    assert "give sequence folders, or --recipe RECIPE --data DIR" in refused.err


def test_preview(cli, data: Path, tmp_path: Path) -> None:
    sheet = tmp_path / "sheet.png"
    result = cli("train", "preview", data / "tiny.yaml", "--data", data, "--out", sheet, "--seed", 3)
    assert result.code == 0, result.err
    assert cv2.imread(str(sheet)).shape[0] > 8 * 223
    refused = cli("train", "preview", data / "tiny.yaml", "--data", data, "--stage", 2)
    assert "--stage 2: recipe tiny has the stages 1 to 1" in refused.err
    refused = cli("train", "preview", data / "tiny.yaml", "--data", data, "--out", tmp_path / "sheet.txt")
    assert (refused.code, refused.err.count("\n")) == (2, 2)
    assert "let the name end in .jpg or .png" in refused.err


def test_diagnose(cli, data: Path) -> None:
    by_folder = cli("train", "diagnose", "s", data / "val" / "b", "--pairs", 8)
    assert by_folder.code == 0, by_folder.err
    assert "b " in by_folder.out
    by_recipe = cli("train", "diagnose", "s", "--recipe", data / "tiny.yaml", "--data", data, "--pairs", 8, "--json")
    assert json.loads(by_recipe.out)["overall"]["pairs"] == 8
    refused = cli("train", "diagnose", "s")
    assert "give sequence folders, or --recipe RECIPE --data DIR" in refused.err
    assert "nowhere: no such folder" in cli("train", "diagnose", "s", "nowhere").err


def test_widen(cli, tmp_path: Path) -> None:
    out = tmp_path / "wide.safetensors"
    assert cli("train", "widen", "s", "--out", out).code == 0
    info = cli("weights", "info", out).out
    assert "size: full" in info
    assert "widened from siamapnpp-s" in info
    assert "exists already" in cli("train", "widen", "s", "--out", out).err
    assert (
        "only weights of size s can be widened"
        in cli("train", "widen", "full", "--out", tmp_path / "x.safetensors").err
    )


def test_maps(cli, material, tmp_path: Path) -> None:
    out = tmp_path / "maps.png"
    result = cli("train", "maps", "s", material.folder, "--truth", material.truth, "--frame", 3, "--out", out)
    assert result.code == 0, result.err
    assert cv2.imread(str(out)) is not None
    assert "one of them" in cli("train", "maps", "s", material.folder).err
    short = cli("train", "maps", "s", material.folder, "--box", material.box, "--frame", 99, "--out", out)
    assert "--frame 99: there are only 24 pictures" in short.err


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("run", "smok"), "recipe smok: no such recipe; did you mean smoke?"),
        (("show", "papr"), "recipe papr: no such recipe; did you mean paper?"),
        (("run", "smoke", "--minutes", "3", "--pairs", "4"), "not allowed with argument"),
        (("run", "smoke", "--minutes", "0"), "--minutes 0.0: give a number above 0"),
        (("run", "smoke", "--pairs", "0"), "--pairs 0 is out of range"),
        (("run", "smoke", "--workers", "-1"), "--workers -1 is out of range"),
        (("run", "smoke", "--minuts", "3"), "unknown argument --minuts; did you mean --minutes?"),
        (("run", "smoke", "--resume"), "--resume: name the folder of the run by --out DIR"),
        (("run", "smoke", "--resume", "--out", "."), "no run to resume lies there (recipe.json is missing)"),
        (("run", "cpu", "--data", "nowhere"), "nowhere"),
        (("run", "smoke", "--packed", "nowhere"), "nowhere"),
    ],
)
def test_bad_input_is_one_line(cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments, expected: str) -> None:
    monkeypatch.chdir(tmp_path)
    result = cli("train", *arguments)
    assert (result.code, result.out) == (2, "")
    assert expected in result.err
    assert result.err.count("\n") == 1
    assert not list(tmp_path.rglob("*.*"))


def test_the_ablation_is_stopped_and_goes_on(cli, data: Path, tmp_path: Path) -> None:
    command = ("bench", "ablation", data / "tiny.yaml", "--data", data, "--pairs", 2, "--workers", 0)
    command = (*command, "--out", tmp_path / "study", "--variants", "siamapn", "apn_df")
    result = cli(*command)
    assert result.code == 0, result.err
    assert "No reproduction of the paper" in result.out
    again = cli(*command, "--json")
    assert "training" not in again.err
    assert [v["variant"] for v in json.loads(again.out)["variants"]] == ["siamapn", "apn_df"]
    refused = cli(*command[:5], "--pairs", 4, *command[7:])
    assert refused.code == 2
    assert "choose another folder" in refused.err


def test_minutes_and_pairs_keep_the_proportions_of_the_stages() -> None:
    recipe = parse_recipe(RECIPE.replace("stages:\n", "stages:\n  - {pairs: 24, batch: 2}\n"), "tiny")
    shares = [stage.minutes for stage in effective_recipe(recipe, RunOptions(minutes=8.0)).stages]
    assert shares == pytest.approx([6.0, 2.0])
    assert [stage.pairs for stage in effective_recipe(recipe, RunOptions(pairs=16)).stages] == [12, 4]


def test_the_first_difference_of_two_recipes() -> None:
    recipe = parse_recipe(RECIPE, "tiny")
    assert difference(recipe, recipe) is None
    for change, expected in (
        (("lr: 1e-4", "lr: 2e-4"), "stages[0].lr was 0.0001 and is 0.0002"),
        (("ema: 0.5", "ema:"), "ema was 0.5 and is nothing"),
        (("ema: 0.5", "teacher: {model: s}"), "teacher was nothing and is a section"),
        (("stages:\n", "stages:\n  - {pairs: 3}\n"), "stages was a list of 1 and is a list of 2"),
        (("path: train", "path: other"), "sources[0].path was train and is other"),
    ):
        assert difference(recipe, parse_recipe(RECIPE.replace(*change), "tiny")) == expected


def test_run_folders_are_numbered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    recipe = parse_recipe(RECIPE, "tiny")
    first = run_folder(recipe, None, resume=False)
    assert not first.exists()
    first.mkdir(parents=True)
    (first / "recipe.json").write_text(recipe.model_dump_json())
    assert (str(first), str(run_folder(recipe, None, resume=False))) == ("runs/train-tiny", "runs/train-tiny-2")
    Path("runs/train-tiny-2").mkdir()
    Path("runs/train-tiny-2/curve.csv").touch()
    assert str(run_folder(recipe, None, resume=False)) == "runs/train-tiny-3"


def test_the_progress_line() -> None:
    progress = Progress(
        stage=1,
        stages=2,
        pairs=64,
        pairs_planned=640,
        pairs_per_s=8.04,
        losses={},
        rate=1e-3,
        remaining_s=72.0,
        note="",
    )
    assert told(progress, 4.56789) == "stage 1/2  64/640 pairs  8.0 pairs/s  loss 4.568  1 min left"
    assert [duration(s) for s in (40.4, 59.8, 60.0, 3599.0, 3600.0, 12_030.0)] == [
        "40 s", "1 min", "1 min", "1 h 0 min", "1 h 0 min", "3 h 20 min",
    ]  # fmt: skip


def test_a_second_interrupt_gives_up_and_a_second_term_does_not() -> None:
    before = signal.getsignal(signal.SIGINT)
    with stop_on_signal() as stop:
        assert not stop()
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGTERM)
        assert stop()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before
