"""The tables of a run: what a crash, a disk or somebody else left in them never ends it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tracker.training.curves import CURVE, VALIDATION, Curves, read_rows
from tracker.training.errors import TrainingError
from tracker.training.validate import SequenceScore, Validated

SCORES = (SequenceScore("a, b", 9, 0.5, 1.0), SequenceScore("\udcff", 0, None, None))


def _add(folder: Path, *places: int) -> None:
    for pairs in places:
        common = {"pairs": pairs, "minutes": 1, "stage": 1, "rate": 1e-3, "pairs_per_s": "", "skipped": 0}
        Curves(folder).add(common, {"total": 1.0, "cls": -1e-9})


def _places(folder: Path) -> list[str]:
    return [row["pairs"] for row in read_rows(folder / CURVE)]


@pytest.mark.parametrize(
    "damage",
    [
        b"200,2.0,1,0.001,,0,0.5,0.25",  # whole fields, but the line was not: 0.25 may have been 0.2598
        b"x00,2.0,1,0.001,,0,0.5,0.25\r\n",
        b"200,2.0,1,0.001,,0,0.5,zero\r\n",
        b"200.5,2.0,1,0.001,,0,0.5,0.2\r\n",
        b"200,2.0,1,0.001,,0,0.5\r\n",
        b"200,2.0,1,0.001,,0,0.5,0.2,0.2\r\n",
        b"\0\0\0\0\0\r\n",
        b'200,"2.0,1,0.001,,0,0.5,0.25\r\n',
        b"\xff\xfe\r\n",
    ],
)
def test_a_damaged_row_is_dropped_and_the_others_stay(tmp_path: Path, damage: bytes) -> None:
    _add(tmp_path, 100, 150)
    path = tmp_path / CURVE
    head, first, second, _ = path.read_bytes().split(b"\r\n")
    path.write_bytes(b"\r\n".join([head, first, second, damage]))
    assert _places(tmp_path) == ["100", "150"]
    if damage.endswith(b"\n"):  # in the middle
        path.write_bytes(b"\r\n".join([head, first, damage[:-2], second, b""]))
        assert _places(tmp_path) == ["100", "150"]
    assert Curves(tmp_path).cut(1000) == []
    _add(tmp_path, 300)
    assert _places(tmp_path) == ["100", "150", "300"]


def test_rows_at_the_same_place_are_one(tmp_path: Path) -> None:
    _add(tmp_path, 100, 200, 200, 150, 300)
    Curves(tmp_path).cut(200)
    assert _places(tmp_path) == ["100", "150", "200"]


def test_scores_are_those_that_the_checkpoint_knows(tmp_path: Path) -> None:
    """A crash after the rows of a validation and before its checkpoint would double them."""
    known = Validated(100, 1.25, SCORES)
    curves = Curves(tmp_path)
    curves.add_validation(100, 1.25, SCORES)
    before = (tmp_path / VALIDATION).read_bytes()
    curves.add_validation(200, 2.0, SCORES)
    curves.cut(200, [known])
    assert (tmp_path / VALIDATION).read_bytes() == before
    (tmp_path / VALIDATION).write_bytes(before[: len(before) // 2])
    curves.cut(200, [known])
    assert (tmp_path / VALIDATION).read_bytes() == before
    assert [row["sequence"] for row in read_rows(tmp_path / VALIDATION)] == ["a, b", "\udcff", "mean"]
    curves.cut(0)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("foreign", [b"day,sales\n1,2\n", b"no table", b"\x89PNG\r\n\0\xff\n", b"pairs,total\n1,2\n"])
def test_a_table_of_something_else_is_moved_aside(tmp_path: Path, foreign: bytes) -> None:
    (tmp_path / CURVE).write_bytes(foreign)
    (tmp_path / f"{CURVE}.old").write_bytes(b"older")
    if foreign.count(b"\n"):
        with pytest.raises(TrainingError, match=r"curve\.csv: not a curve of this program; move it away and resume"):
            read_rows(tmp_path / CURVE)
    assert Curves(tmp_path).cut(1000) == ["curve.csv was not a curve of this program and is curve.csv.old1 now"]
    assert (tmp_path / f"{CURVE}.old1").read_bytes() == foreign
    assert (tmp_path / f"{CURVE}.old").read_bytes() == b"older"
    _add(tmp_path, 100)
    assert _places(tmp_path) == ["100"]


@pytest.mark.parametrize("torn", [b"", b"pairs,minu", b"pairs,minutes,stage,rate,pairs_per_s,skipped,tot"])
def test_a_heading_cut_short_is_ours(tmp_path: Path, torn: bytes) -> None:
    (tmp_path / CURVE).write_bytes(torn)
    assert read_rows(tmp_path / CURVE) == []
    assert Curves(tmp_path).cut(1000) == []
    assert list(tmp_path.iterdir()) == []
