"""Sequences in folders: OTB/UAV, LaSOT and GOT-10k layouts, what is absent, what is broken, whole footage."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from tests.tracker.training.datasets import (
    HEIGHT,
    WIDTH,
    box_at,
    ground_bgr,
    make_folders,
    make_got10k,
    make_sequence,
    picture,
    write,
)
from tracker.training.errors import TrainingError
from tracker.training.recipe import Folders, Got10k, Validation
from tracker.training.sources import open_footage, open_source, reserved_names
from tracker.training.types import Source, View


def folders(path: Path, **settings) -> Source:
    reserved = settings.pop("reserved", frozenset())
    return open_source(Folders(kind="folders", path=str(path), **settings), Path("/nowhere"), {}, reserved)


def got10k(path: Path, **settings) -> Source:
    return open_source(Got10k(kind="got10k", path=str(path), **settings), Path("/nowhere"), {}, frozenset())


def seen(source: Source, track: int, index: int) -> View:
    view = source.view(track, index)
    assert isinstance(view, View), view
    return view


def assert_frame(view: View, frame: int, seed: int = 0) -> None:
    """The picture is that of the frame, and the box is where it was drawn."""
    np.testing.assert_allclose(view.image_bgr_u8[-2, 2], ground_bgr(frame, seed), atol=6)
    np.testing.assert_allclose(view.box.to_xywh(), box_at(frame), atol=1e-3)


def test_folders_have_a_track_per_sequence_and_the_right_picture_in_each_frame(tmp_path):
    source = folders(make_folders(tmp_path / "set", ("one", "two"), frames=5))
    assert source.name == "set"
    assert [t.name for t in source.tracks] == ["one", "two"]
    assert [t.group for t in source.tracks] == ["set/one", "set/two"]
    assert [t.label for t in source.tracks] == [None, None]
    assert source.tracks[1].frames == (0, 1, 2, 3, 4)
    for track in range(2):
        for frame in range(5):
            assert_frame(seen(source, track, frame), frame, seed=track)
    view = seen(source, 0, 0)
    np.testing.assert_allclose(view.fill_bgr, view.image_bgr_u8.mean(axis=(0, 1)), atol=3)
    assert source.skipped.lines() == []
    with pytest.raises(IndexError):
        source.view(0, 5)  # not the first frame of the next track


def test_a_source_travels_to_another_process(tmp_path):
    source = pickle.loads(pickle.dumps(folders(make_folders(tmp_path))))
    assert_frame(seen(source, 1, 3), 3, seed=1)
    assert source.tracks[-1].name == "two"
    assert [t.name for t in source.tracks[0:2]] == ["one", "two"]


@pytest.mark.parametrize("separator", [",", " ", "\t", ", ", ";"])
def test_any_separator(tmp_path, separator):
    make_sequence(tmp_path / "s", 3, separator=separator)
    assert_frame(seen(folders(tmp_path), 0, 2), 2)


def test_byte_order_mark_windows_line_ends_and_blank_lines(tmp_path):
    make_sequence(tmp_path / "s", 3)
    truth = tmp_path / "s" / "groundtruth_rect.txt"
    truth.write_bytes(b"\xef\xbb\xbf" + truth.read_bytes().replace(b"\n", b"\r\n") + b"\r\n\r\n")
    source = folders(tmp_path)
    assert source.skipped.lines() == []
    assert_frame(seen(source, 0, 0), 0)
    assert_frame(seen(source, 0, 2), 2)


def test_nan_and_empty_boxes_are_absent_and_broken_rows_are_named(tmp_path):
    make_sequence(tmp_path / "s", 6)
    truth = tmp_path / "s" / "groundtruth_rect.txt"
    rows = truth.read_text().splitlines()
    rows[1], rows[2], rows[3], rows[4] = "nan,nan,nan,nan", "3,4,0,5", "40,30", "40,30,xx,24"
    truth.write_text("\n".join(rows))
    source = folders(tmp_path)
    assert source.tracks[0].frames == (0, 5)
    assert_frame(seen(source, 0, 1), 5)
    assert source.skipped.lines() == [f"2 corrupt row: {truth}:4, {truth}:5"]


def test_a_polygon_is_its_hull(tmp_path):
    make_sequence(tmp_path / "s", 1, truth="groundtruth.txt")
    (tmp_path / "s" / "groundtruth.txt").write_text("30,40,50,20,70,40,50,60\n")
    assert seen(folders(tmp_path), 0, 0).box.to_xywh() == (30, 20, 40, 40)


@pytest.mark.parametrize(("pictures", "rows"), [(6, 4), (4, 6)])
def test_a_surplus_of_pictures_or_rows_is_counted(tmp_path, pictures, rows):
    make_sequence(tmp_path / "s", pictures)
    truth = "\n".join(",".join(map(str, box_at(i))) for i in range(rows))
    (tmp_path / "s" / "groundtruth_rect.txt").write_text(truth)
    source = folders(tmp_path)
    assert source.tracks[0].frames == (0, 1, 2, 3)
    kind = "picture without a row" if pictures > rows else "row without a picture"
    assert source.skipped.counts == {kind: 2}


def test_pictures_are_taken_in_the_order_of_their_numbers(tmp_path):
    for i in range(11):
        write(tmp_path / "s" / f"{i + 1}.png", picture(box_at(i), i))  # 10.png sorts before 2.png as text
    (tmp_path / "s" / "._1.png").write_bytes(b"left by another system")
    rows = "\n".join(",".join(map(str, box_at(i))) for i in range(11))
    (tmp_path / "s" / "groundtruth.txt").write_text(rows)
    source = folders(tmp_path)
    assert source.skipped.lines() == []
    for frame in range(11):
        assert_frame(seen(source, 0, frame), frame)


def test_lasot_has_classes_and_frames_that_are_marked_absent(tmp_path):
    for name in ("cat-1", "cat-2"):
        make_sequence(tmp_path / "cat" / name, 5, truth="groundtruth.txt")
    (tmp_path / "cat" / "cat-1" / "full_occlusion.txt").write_text("0,1,0,0,0")
    (tmp_path / "cat" / "cat-1" / "out_of_view.txt").write_text("0,0,0,1,0")
    make_sequence(tmp_path / "other" / "walk", 2)
    source = folders(tmp_path)
    assert [(t.name, t.label, t.frames) for t in source.tracks] == [
        ("cat-1", "cat", (0, 2, 4)),
        ("cat-2", "cat", (0, 1, 2, 3, 4)),
        ("walk", None, (0, 1)),
    ]
    assert_frame(seen(source, 0, 2), 4)


def test_limits_leave_boxes_out_and_say_which(tmp_path):
    boxes = [(40, 30, 32, 24), (40, 30, 32, 11), (10, 10, 100, 13), (2, 2, 150, 110), (40, 30, 20, 20)]
    make_sequence(tmp_path / "s", boxes=boxes)
    source = folders(tmp_path, min_side_px=12, max_aspect=6, max_area_share=0.7)
    assert source.tracks[0].frames == (0, 4)
    assert sorted(source.skipped.lines()) == [
        "1 box above max_area_share 0.7: s frame 3",
        "1 box below min_side_px 12: s frame 1",
        "1 box thinner than max_aspect 6: s frame 2",
    ]
    everything = folders(tmp_path, min_side_px=1, max_aspect=100, max_area_share=1)
    assert everything.tracks[0].frames == (0, 1, 2, 3, 4)


def test_stride_takes_every_nth_frame_of_a_track(tmp_path):
    source = folders(make_folders(tmp_path, ("one", "two"), frames=8), stride=3, frame_range=9)
    assert [t.frames for t in source.tracks] == [(0, 3, 6), (0, 3, 6)]
    assert source.frame_range == 9
    assert_frame(seen(source, 1, 2), 6, seed=1)


def test_only_and_exclude_choose_by_name(tmp_path):
    make_folders(tmp_path, ("a", "b", "c"), frames=2)
    assert [t.name for t in folders(tmp_path, only=("c", "a")).tracks] == ["a", "c"]
    source = folders(tmp_path, exclude=("b", "gone"))
    assert [t.name for t in source.tracks] == ["a", "c"]
    assert source.skipped.lines() == ["1 name in exclude that is not there: gone"]
    with pytest.raises(TrainingError, match=r"only: there is no sequence Basketbal; did you mean Basketball\?"):
        folders(make_folders(tmp_path / "more", ("Basketball",), 2).parent / "more", only=("Basketbal",))


def test_sequences_of_the_validation_are_reserved(tmp_path):
    make_folders(tmp_path / "train", ("a", "b", "c"), frames=2)
    make_got10k(tmp_path / "val", ("c",), frames=2)
    validation = Validation(
        sources=(Folders(kind="folders", path="train", only=("b",)), Got10k(kind="got10k", path="val"))
    )
    reserved = reserved_names(validation, tmp_path)
    assert reserved == {"b", "c"}
    source = folders(tmp_path / "train", reserved=reserved)
    assert [t.name for t in source.tracks] == ["a"]
    assert source.skipped.lines() == ["2 reserved for validation: b, c"]


def test_got10k_leaves_out_absent_and_covered_frames(tmp_path):
    make_got10k(tmp_path / "train", ("GOT_1", "GOT_2"), frames=5)
    (tmp_path / "train" / "GOT_1" / "absence.label").write_text("0\n1\n0\n0\n0\n")
    (tmp_path / "train" / "GOT_1" / "cover.label").write_text("8\n8\n0\n1\n8\n")
    source = got10k(tmp_path / "train")
    assert [(t.name, t.label, t.frames) for t in source.tracks] == [
        ("GOT_1", "bear", (0, 3, 4)),
        ("GOT_2", "bear", (0, 1, 2, 3, 4)),
    ]
    assert_frame(seen(source, 0, 1), 3)
    (tmp_path / "train" / "list.txt").write_text("GOT_2\nGOT_9\n")
    listed = got10k(tmp_path / "train")
    assert [t.name for t in listed.tracks] == ["GOT_2"]
    assert listed.skipped.counts == {"unreadable sequence": 1}
    assert "GOT_9" in listed.skipped.lines()[0]
    (tmp_path / "train" / "list.txt").unlink()
    assert [t.name for t in got10k(tmp_path / "train").tracks] == ["GOT_1", "GOT_2"]


@pytest.mark.parametrize("content", [b"", b"not a picture at all", b"truncated"])
def test_a_broken_picture_is_found_when_it_is_read(tmp_path, content):
    make_sequence(tmp_path / "s", 3)
    broken = tmp_path / "s" / "img" / "00000002.jpg"
    broken.write_bytes(broken.read_bytes()[:-200] if content == b"truncated" else content)
    source = folders(tmp_path)
    assert_frame(seen(source, 0, 2), 2)
    fault = source.view(0, 1)
    assert isinstance(fault, str)
    assert fault.startswith(f"{broken}: {'truncated JPEG' if content == b'truncated' else 'not a picture'}")
    assert "\n" not in fault
    broken.unlink()
    assert source.view(0, 1) == f"{broken}: No such file or directory"


def test_a_box_outside_the_picture_and_one_beyond_the_border(tmp_path):
    make_sequence(tmp_path / "s", boxes=[(WIDTH + 1, 10, 30, 30), (-10, 100, 40, 40)])
    source = folders(tmp_path)
    fault = source.view(0, 0)
    assert isinstance(fault, str)
    assert "box outside the picture (frame 0, picture of 160x120 px)" in fault
    assert seen(source, 0, 1).box.to_xywh() == (-10, 100, 40, 40)  # not cut


def test_a_picture_smaller_than_the_first_is_judged_when_it_is_read(tmp_path):
    make_sequence(tmp_path / "s", boxes=[(5, 5, 54, 50)] * 2)
    write(tmp_path / "s" / "img" / "00000002.jpg", picture(None, 1, size=(60, 60)))
    fault = folders(tmp_path).view(0, 1)
    assert isinstance(fault, str)
    assert "box above max_area_share 0.7" in fault


def test_exif_orientation_is_ignored(tmp_path):
    make_sequence(tmp_path / "s", 1)
    path = tmp_path / "s" / "img" / "00000001.jpg"
    data = path.read_bytes()
    tiff = b"MM\x00*\x00\x00\x00\x08\x00\x01\x01\x12\x00\x03\x00\x00\x00\x01\x00\x06\x00\x00\x00\x00\x00\x00"
    exif = b"Exif\x00\x00" + tiff  # orientation 6: turned by 90 degrees
    path.write_bytes(data[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + data[2:])
    assert seen(folders(tmp_path), 0, 0).image_bgr_u8.shape == (HEIGHT, WIDTH, 3)


def test_missing_and_empty_folders_are_errors_that_say_what_was_expected(tmp_path):
    with pytest.raises(TrainingError, match=r"path .*gone: no such folder; expected folders SEQ/img"):
        folders(tmp_path / "gone")
    with pytest.raises(TrainingError, match=r"path .*: no sequence there; expected"):
        folders(tmp_path)
    with pytest.raises(TrainingError, match=r"path .*: no sequence there; expected a split of GOT-10k"):
        got10k(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(TrainingError, match="is a file, not a folder"):
        folders(tmp_path / "file")
    make_sequence(tmp_path / "A" / "same", 2)
    make_sequence(tmp_path / "B" / "same", 2)
    with pytest.raises(TrainingError, match="A/same and B/same have the same name"):
        folders(tmp_path)


def test_a_sequence_in_place_of_its_parent_is_told_what_to_give(tmp_path, monkeypatch):
    make_folders(tmp_path / "otb", ("bag",), frames=2)
    make_got10k(tmp_path / "got", ("GOT_1",), frames=2)
    told = r"path .*bag: is a sequence itself; give its parent, path: /.*/otb, and only: \[bag\]"
    with pytest.raises(TrainingError, match=told):
        folders(tmp_path / "otb" / "bag")
    monkeypatch.chdir(tmp_path / "otb" / "bag")
    with pytest.raises(TrainingError, match=r"only: \[bag\]"):
        open_source(Folders(kind="folders", path="."), Path(), {}, frozenset())
    with pytest.raises(TrainingError, match=r"is a sequence itself.*/got, and only: \[GOT_1\]"):
        got10k(tmp_path / "got" / "GOT_1")


def test_excluding_everything_is_said(tmp_path):
    make_folders(tmp_path, ("a", "b", "c"), frames=2)
    with pytest.raises(TrainingError, match=r"exclude: all sequences were excluded \(3\); leave some in"):
        folders(tmp_path, exclude=("a", "b", "c"))
    with pytest.raises(TrainingError, match=r"exclude: all sequences of only were excluded \(1\)"):
        folders(tmp_path, only=("a",), exclude=("a",))
    with pytest.raises(TrainingError, match=r"all sequences but the 1 that validation uses were excluded \(2\)"):
        folders(tmp_path, exclude=("a", "b"), reserved=frozenset("c"))
    assert [t.name for t in folders(tmp_path, exclude=("a", "b")).tracks] == ["c"]


def test_a_set_that_yields_nothing_says_what_was_skipped(tmp_path):
    make_sequence(tmp_path / "s", boxes=[None, None])
    make_sequence(tmp_path / "t", boxes=[(5, 5, 8, 8)])
    with pytest.raises(TrainingError, match=r"no usable target.*below min_side_px 12: t frame 0.*without a picture"):
        folders(tmp_path)
    with pytest.raises(TrainingError, match="reserved for validation: s, t"):
        folders(tmp_path, reserved=frozenset(("s", "t")))


def test_footage_has_every_frame_whatever_the_limits(tmp_path):
    make_sequence(tmp_path / "s", boxes=[box_at(0), None, (5, 5, 3, 3), (2, 2, 155, 115)])
    (only,) = open_footage(Folders(kind="folders", path="."), tmp_path, {})
    assert only.name == "s"
    assert [None if b is None else b.to_xywh() for b in only.truth] == [box_at(0), None, (5, 5, 3, 3), (2, 2, 155, 115)]
    assert len(only.images) == 4
    np.testing.assert_allclose(only.images[1][-2, 2], ground_bgr(1), atol=6)
    assert len(only.images[1:3]) == 2
    (tmp_path / "s" / "img" / "00000003.jpg").write_bytes(b"")
    with pytest.raises(TrainingError, match=r"00000003\.jpg.*every picture"):
        only.images[2]
    with pytest.raises(IndexError):
        only.images[4]


def test_footage_of_got10k_marks_absent_frames(tmp_path):
    make_got10k(tmp_path, ("GOT_1",), frames=3)
    (tmp_path / "GOT_1" / "absence.label").write_text("0\n1\n0\n")
    (only,) = open_footage(Got10k(kind="got10k", path=str(tmp_path)), Path("/nowhere"), {})
    assert [b is None for b in only.truth] == [False, True, False]


def test_footage_never_loses_a_sequence_quietly(tmp_path):
    make_folders(tmp_path, ("a", "b"), frames=2)
    (tmp_path / "b" / "groundtruth_rect.txt").write_text("nan nan nan nan\n")
    with pytest.raises(TrainingError, match=r"cannot validate on it: 1 sequence without a picture with a box: b"):
        open_footage(Folders(kind="folders", path="."), tmp_path, {})
    assert [f.name for f in open_footage(Folders(kind="folders", path=".", only=("a",)), tmp_path, {})] == ["a"]
    with pytest.raises(TrainingError, match="only: there is no sequence c"):
        open_footage(Folders(kind="folders", path=".", only=("c",)), tmp_path, {})
