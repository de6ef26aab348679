"""Around a run: packing that is stopped, feature maps, widening, studies in places that cannot be used, moved packs."""

from __future__ import annotations

import os
import signal
import weakref
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import TINY_RECIPE as RECIPE
from tracker.box import Box
from tracker.messages import Frame
from tracker.training.recipe import Packed
from tracker.training.recipe_file import parse_recipe
from uavfollow.errors import InputError
from uavfollow.training import maps, tools
from uavfollow.training.folder import difference


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("workers", [0, 1])
def test_packing_that_is_stopped_leaves_nothing(cli, data, tmp_path, monkeypatch, number, workers) -> None:
    class Stopping(tools.ProgressLine):
        def due_s(self):
            assert [path.name[:6] for path in tmp_path.iterdir()] == [".pack-"]
            os.kill(os.getpid(), number)

    before = signal.getsignal(number)
    monkeypatch.setattr(tools, "ProgressLine", Stopping)
    out = tmp_path / "pack"
    result = cli("train", "prepare", data / "tiny.yaml", "--data", data, "--out", out, "--workers", workers)
    assert (result.code, result.out) == (130, "")
    assert result.err.splitlines()[1:] == ["uavfollow: interrupted"]
    assert list(tmp_path.iterdir()) == []
    assert signal.getsignal(number) is before


def test_a_limit_too_low_for_pairs(cli, data: Path, tmp_path: Path) -> None:
    refused = cli("train", "prepare", data / "tiny.yaml", "--data", data, "--out", tmp_path / "p", "--limit", 1)
    assert refused.code == 2
    assert "source `clip`: limit 1: a pair needs 2 frames of a video; give a limit of at least 2" in refused.err


def test_full_cannot_be_widened(cli, tmp_path: Path) -> None:
    refused = cli("train", "widen", "full", "--out", tmp_path / "x.safetensors")
    assert refused.err == "uavfollow: error: full is already of size full; only weights of size s can be widened\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("place", ["file", "file/below"])
def test_a_study_is_refused_where_nothing_can_be_written(cli, data: Path, tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_text("")
    refused = cli("bench", "ablation", data / "tiny.yaml", "--data", data, "--pairs", 2, "--out", tmp_path / place)
    assert (refused.code, refused.err.count("\n")) == (2, 1)
    assert f"--out {tmp_path / place}: cannot be written (" in refused.err
    assert refused.err.endswith("); choose another folder\n")


def test_a_study_is_refused_in_a_read_only_folder(cli, data: Path) -> None:
    # /proc refuses new files to root too, whom the bits of a folder do not stop.
    refused = cli("bench", "ablation", data / "tiny.yaml", "--data", data, "--pairs", 2, "--out", "/proc/study")
    assert (refused.code, refused.err.count("\n")) == (2, 1)
    assert refused.err.endswith("; choose another folder\n")


def test_a_study_trains_in_one_process(cli, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WORLD_SIZE", "2")
    command = ("bench", "ablation", data / "tiny.yaml", "--data", data, "--pairs", 2, "--out", tmp_path / "study")
    refused = cli(*command)
    assert refused.code == 2
    assert refused.err == "uavfollow: error: bench ablation trains in one process: start it without torchrun\n"
    assert list(tmp_path.iterdir()) == []


class Following:
    """A tracker that finds the target ten pixels further right in each picture."""

    def __init__(self, *arguments: object) -> None:
        self.seen: list[int] = []

    def init(self, frame: Frame, box: Box) -> None:
        self.seen, self.box = [frame.seq], box

    def update(self, frame: Frame) -> list[object]:
        self.seen.append(frame.seq)
        self.box = Box(self.box.cx_px + 10, self.box.cy_px, self.box.w_px, self.box.h_px)
        return [self]


def pictures(count: int, unreadable: tuple[int, ...], alive: list[weakref.ref]):
    for seq in range(count):
        if seq in unreadable:
            yield None
            continue
        image = np.full((40, 60, 3), seq, np.uint8)
        alive.append(weakref.ref(image))
        assert sum(one() is not None for one in alive) <= 3  # first, the one before, and this one
        yield Frame(image, seq, 0.1 * seq, 0.1 * seq)
        del image


def test_maps_hold_two_pictures_at_a_time() -> None:
    tracker = Following()
    first, last, box = maps._tracked(tracker, pictures(30, (4,), []), Box(20.0, 20.0, 8.0, 8.0), 12)
    assert tracker.seen == [0, 1, 2, 3, 5, 6, 7, 8, 9, 10]
    assert (first[0, 0, 0], last[0, 0, 0]) == (0, 11)
    assert box.cx_px == 20 + 10 * 9


@pytest.mark.parametrize(
    ("count", "unreadable", "told"),
    [(5, (), "there are only 5 pictures"), (9, (5,), "picture 6 cannot"), (9, (0,), "picture 1 cannot")],
)
def test_maps_need_the_first_and_the_last_picture(count, unreadable, told) -> None:
    with pytest.raises(InputError, match=f"--frame 6: {told}"):
        maps._tracked(Following(), pictures(count, unreadable, []), Box(20.0, 20.0, 8.0, 8.0), 6)


@pytest.mark.parametrize(
    ("out", "told"),
    [("none/maps.png", "there is no folder"), ("", "is a folder"), ("maps.txt", "let the name end in .png or .jpg")],
)
def test_maps_look_at_the_place_before_they_track(cli, material, tmp_path, monkeypatch, out, told) -> None:
    monkeypatch.setattr(maps, "load", lambda model: pytest.fail("the model was loaded"))
    result = cli("train", "maps", "s", material.folder, "--truth", material.truth, "--out", tmp_path / out)
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert told in result.err


def test_a_pack_may_be_moved() -> None:
    recipe = parse_recipe(RECIPE, "tiny")

    def packed(path: str, name: str = "clip"):
        source = Packed(kind="packed", path=path, set_name=name, name="clip")
        return recipe.model_copy(update={"sources": (source,)})

    assert difference(packed("/a/pack"), packed("/b/pack")) is None
    told = difference(packed("/a/pack"), packed("/b/pack", "other"))
    assert told == "sources[0].set_name was clip and is other"
    assert difference(recipe, packed("/a/pack")) is not None
