"""Every layout from a tiny tree, and what is said of broken ones."""

import itertools

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.tracker.benchmark.trees import otb, pictures, rows, text
from tracker.benchmark.attributes import FLAGS
from tracker.benchmark.readers import find_sequences
from tracker.benchmark.readers.rows import read_boxes, read_flags
from tracker.benchmark.readers.uav123 import RANGES, part_of
from tracker.benchmark.sequence import ReadError, load_image
from tracker.box import Box

QUICK = settings(max_examples=25, deadline=None)  # arrays are cheap, drawing them is not
BOM = "\ufeff"


def only(paths):
    sequences, problems = find_sequences(paths)
    assert problems == []
    assert len(sequences) == 1
    return sequences[0]


def found(paths):
    """Names and data sets of what was found without a problem."""
    sequences, problems = find_sequences(paths)
    assert problems == []
    return [(s.name, s.dataset) for s in sequences]


# --- rows


@pytest.mark.parametrize("separator", [",", "\t", " ", ", ", ";", "   "])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_rows_with_any_separator_line_end_mark_and_blank_lines_at_the_end(tmp_path, separator, end):
    lines = [separator.join(("1", "2.5", "3", "4e0")), separator.join(("5", "6", "7", "8"))]
    path = text(tmp_path / "a.txt", BOM + end.join(lines) + end * 3)
    assert read_boxes(path) == (Box.from_xywh(1, 2.5, 3, 4), Box.from_xywh(5, 6, 7, 8))


@pytest.mark.parametrize("row", ["NaN,NaN,NaN,NaN", "nan nan nan nan", "1,2,NaN,4", "0,0,0,0", "1,2,-3,4", "1,inf,3,4"])
def test_a_row_without_a_usable_box_is_an_absent_target(tmp_path, row):
    assert read_boxes(text(tmp_path / "a.txt", f"1,2,3,4\n{row}\n1,2,3,4\n"))[1] is None


@pytest.mark.parametrize(
    ("row", "message"),
    [("1,2,3", "3 numbers where 4"), ("1,2,3,4,5", "5 numb"), ("1,2,x,4", "'x' is not a number"), ("", "empty line")],
)
def test_a_bad_row_names_file_and_line(tmp_path, row, message):
    path = text(tmp_path / "a.txt", f"1,2,3,4\n1,2,3,4\n{row}\n1,2,3,4\n")
    with pytest.raises(ReadError, match=message) as caught:
        read_boxes(path)
    assert caught.value.where == f"{path}:3"


def test_files_without_rows_or_without_text(tmp_path):
    with pytest.raises(ReadError, match="is empty"):
        read_boxes(text(tmp_path / "a.txt", "\n\n"))
    (tmp_path / "b.txt").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ReadError, match="not a text file"):
        read_boxes(tmp_path / "b.txt")
    with pytest.raises(ReadError, match="cannot be read"):
        read_boxes(tmp_path / "none.txt")


def test_flags_in_a_row_or_one_a_line_and_nothing_but_0_and_1(tmp_path):
    assert read_flags(text(tmp_path / "a", "0,1,1,\n")) == (False, True, True)
    assert read_flags(text(tmp_path / "b", "0\r\n1\r\n")) == (False, True)
    with pytest.raises(ReadError, match="'2'") as caught:
        read_flags(text(tmp_path / "c", "1\n2\n"))
    assert caught.value.where.endswith("c:2")


# --- OTB, DTB70


def test_an_otb_sequence_by_itself_with_images_in_the_order_of_their_numbers(tmp_path):
    folder = tmp_path / "DTB70" / "Car2"
    pictures(folder / "img", [9, 10, 8, 100, 11], "{}.jpg")
    (folder / "img" / "._9.jpg").touch()  # what macOS leaves behind
    (folder / "img" / "notes.txt").touch()
    text(folder / "groundtruth_rect.txt", rows(5))
    sequence = only([folder])
    assert [p.name for p in sequence.images] == ["8.jpg", "9.jpg", "10.jpg", "11.jpg", "100.jpg"]
    assert (sequence.name, sequence.dataset, sequence.fps) == ("Car2", "DTB70", 30.0)
    assert sequence.first == sequence.truth[0] == Box.from_xywh(10, 20, 30, 40)
    assert sequence.time_s(3) == pytest.approx(0.1)


def test_a_folder_of_folders_of_sequences_each_once_in_order(tmp_path):
    for place in ("UAV123_10fps/boat5", "DTB70/Surfing06", "mine/b", "mine/a"):
        otb(tmp_path / place)
    all_of_them = [("Surfing06", "DTB70"), ("boat5", "UAV123@10fps"), ("a", "mine"), ("b", "mine")]
    assert found([tmp_path]) == all_of_them
    assert found([tmp_path / "mine", tmp_path, tmp_path / "DTB70"]) == [*all_of_them[2:], *all_of_them[:2]]
    assert {s.name: s.fps for s in find_sequences([tmp_path])[0]}["boat5"] == 10.0


def test_several_targets_in_one_otb_folder(tmp_path):
    pictures(tmp_path / "Jogging" / "img", [1, 2])
    text(tmp_path / "Jogging" / "groundtruth_rect.1.txt", rows(2))
    text(tmp_path / "Jogging" / "groundtruth_rect.2.txt", rows(2, first=70))
    sequences, problems = find_sequences([tmp_path / "Jogging"])
    assert [(s.name, s.first.to_xywh()[0]) for s in sequences] == [("Jogging-1", 10), ("Jogging-2", 70)]
    assert problems == []


def test_attributes_of_dtb70_beside_the_sequences(tmp_path):
    otb(tmp_path / "DTB70" / "Car2")
    text(tmp_path / "DTB70" / "att" / "Car2.txt", "1,0,0,0,0,0,0,0,0,0,1\n")
    assert only([tmp_path / "DTB70"]).attributes == {"SV", "MB"}


# --- UAV123 and its kin


def uav123(root, dataset, images):
    """One whole video `bike1` and a video `car16` cut in two, as released; `images` per video."""
    pictures(root / "data_seq" / dataset / "bike1", range(1, 4))
    pictures(root / "data_seq" / dataset / "car16", range(1, images + 1))
    text(root / "anno" / dataset / "bike1.txt", rows(3))
    text(root / "anno" / dataset / "att" / "bike1.txt", "1,0,0,0,1,0,0,0,0,0,0,1\n")
    return root


def test_uav123_at_10_fps_cuts_videos_by_image_numbers(tmp_path):
    root = uav123(tmp_path / "UAV123_10fps", "UAV123_10fps", 665)
    text(root / "anno" / "UAV123_10fps" / "car16_1.txt", rows(139))
    text(root / "anno" / "UAV123_10fps" / "car16_2.txt", rows(665 - 139 + 1))
    sequences, problems = find_sequences([tmp_path])
    assert problems == []
    bike, first, second = sequences
    assert bike.attributes == {"SV", "FOC", "SOB"}
    assert {(s.dataset, s.fps) for s in sequences} == {("UAV123@10fps", 10.0)}
    assert [s.name for s in sequences] == ["bike1", "car16_1", "car16_2"]
    assert (first.images[0].name, first.images[-1].name) == ("000001.jpg", "000139.jpg")
    assert (second.images[0].name, second.images[-1].name) == ("000139.jpg", "000665.jpg")


def test_uav123_and_uav20l_share_their_pictures(tmp_path):
    root = uav123(tmp_path / "UAV123", "UAV123", 420)
    text(root / "anno" / "UAV123" / "car16_1.txt", rows(415))
    text(root / "anno" / "UAV20L" / "bike1.txt", "NaN,NaN,NaN,NaN\n".join([rows(1), rows(1)]))
    names = [("bike1", "UAV123"), ("car16_1", "UAV123"), ("bike1", "UAV20L")]
    assert found([root]) == names
    assert found([root / "anno" / "UAV20L"]) == names[2:]
    assert found([root / "data_seq" / "UAV123" / "car16"]) == names[1:2]
    assert found([root / "anno" / "UAV123" / "bike1.txt"]) == names[:1]
    assert found([root / "data_seq"]) == names
    assert [t is None for t in only([root / "anno" / "UAV20L"]).truth] == [False, True, False]


def test_a_release_whose_videos_are_cut_already_is_read_as_it_is(tmp_path):
    root = tmp_path / "UAV123_10fps"
    pictures(root / "data_seq" / "car1_2", range(1, 4))
    text(root / "anno" / "car1_2.txt", rows(3))
    sequence = only([root])
    assert (sequence.name, sequence.dataset, len(sequence.images)) == ("car1_2", "UAV123@10fps", 3)


def test_the_cuts_of_uav123_are_those_of_every_third_image_at_10_fps():
    # printed in the configuration of UAV123@10fps
    assert part_of("bird1_2", "UAV123@10fps") == ("bird1", (259, 493))
    assert part_of("uav1_3", "UAV123@10fps") == ("uav1", (825, 1157))
    assert part_of("bird1_2", "UAV123") == ("bird1", (775, 1477))
    assert [part_of(n, "UAV123") for n in ("bird1_4", "bird1_0", "person2_s", "bike1", "nothing_1")] == [None] * 5
    for parts in RANGES.values():
        assert all(first < last and first % 3 == last % 3 == 1 for first, last in parts)
        assert all(a[1] <= b[0] for a, b in itertools.pairwise(parts))


def test_a_cut_video_with_images_missing_is_a_problem(tmp_path):
    root = uav123(tmp_path / "UAV123", "UAV123", 400)
    truth = text(root / "anno" / "UAV123" / "car16_1.txt", rows(415))
    sequences, problems = find_sequences([root])
    assert [s.name for s in sequences] == ["bike1"]
    assert [p.where for p in problems] == [f"{truth}:415"]
    assert "415 rows for 400 images" in problems[0].message


# --- the others


@pytest.mark.parametrize(
    ("images", "truths"), [("data_seq", "anno"), ("UAV-benchmark-S", "UAV-benchmark-SOT_v1.0/anno")]
)
def test_uavdt(tmp_path, images, truths):
    pictures(tmp_path / images / "S0101", range(1, 4), "img{:06d}.jpg")
    text(tmp_path / truths / "S0101_gt.txt", rows(3))
    text(tmp_path / truths / "att" / "S0101_att.txt", "0,1,0,0,0,0,0,0,1")
    sequence = only([tmp_path])
    assert (sequence.name, sequence.dataset, sequence.attributes) == ("S0101", "UAVDT", {"CM", "LO"})
    assert found([tmp_path / images / "S0101"]) == [("S0101", "UAVDT")]


def test_visdrone(tmp_path):
    pictures(tmp_path / "sequences" / "uav0_1_s", range(1, 4), "img{:07d}.jpg")
    text(tmp_path / "annotations" / "uav0_1_s.txt", rows(3))
    text(tmp_path / "attributes" / "uav0_1_s_attr.txt", "1,0,0,0,0,0,0,0,0,0,0,1")
    sequence = only([tmp_path])
    assert (sequence.name, sequence.dataset, sequence.attributes) == ("uav0_1_s", "VisDrone-SOT", {"ARC", "VC"})
    assert found([tmp_path / "sequences" / "uav0_1_s"]) == [("uav0_1_s", "VisDrone-SOT")]


def test_uavtrack112(tmp_path):
    for name, separator in (("a", " "), ("b", "\t"), ("c", ",")):
        pictures(tmp_path / "data_seq" / name, range(1, 4))
        text(tmp_path / "anno" / f"{name}.txt", rows(3, separator=separator))
        text(tmp_path / "att" / f"{name}.txt", "1,0,0,0,0,0,0,0,0,0,0,0,1")
    sequences, problems = find_sequences([tmp_path])
    assert problems == []
    assert [(s.name, s.dataset) for s in sequences] == [(n, "UAVTrack112") for n in "abc"]
    assert {s.attributes for s in sequences} == {frozenset({"FM", "SOB"})}
    assert {s.truth[2] for s in sequences} == {Box.from_xywh(12, 20, 30, 40)}


def test_got10k_with_its_absence_and_its_rate(tmp_path):
    folder = pictures(tmp_path / "GOT-10k" / "val" / "GOT-10k_Val_000001", range(1, 5), "{:08d}.jpg")
    text(folder / "groundtruth.txt", rows(4))
    text(folder / "absence.label", "0\n1\n1\n0\n")
    text(folder / "meta_info.ini", "[METAINFO]\nurl: x\nanno_fps: 10Hz\n")
    sequence = only([tmp_path])
    assert (sequence.name, sequence.dataset, sequence.fps) == ("GOT-10k_Val_000001", "GOT-10k", 10.0)
    assert [t is None for t in sequence.truth] == [False, True, True, False]
    text(folder / "absence.label", "0\n1\n1\n")
    _, problems = find_sequences([tmp_path])
    assert "3 marks for 4 rows" in problems[0].message


# --- what is broken


@pytest.mark.parametrize(
    ("content", "line", "message"),
    [
        (rows(2), 2, "2 rows for 3 images"),
        (rows(4), 4, "4 rows for 3 images"),
        ("NaN,NaN,NaN,NaN\n" + rows(2), 1, "no target in the first row"),
        ("1,2,3,4\n1,2,3\n1,2,3,4\n", 2, "3 numbers"),
    ],
)
def test_one_broken_sequence_is_named_and_the_rest_go_on(tmp_path, content, line, message):
    otb(tmp_path / "a")
    otb(tmp_path / "b", content=content)
    otb(tmp_path / "c")
    sequences, problems = find_sequences([tmp_path])
    assert [s.name for s in sequences] == ["a", "c"]
    assert [p.where for p in problems] == [f"{tmp_path / 'b' / 'groundtruth_rect.txt'}:{line}"]
    assert message in str(problems[0])


def test_missing_pictures_or_annotations_are_problems(tmp_path):
    otb(tmp_path / "good")
    (tmp_path / "empty" / "img").mkdir(parents=True)
    pictures(tmp_path / "untold" / "img", [1])
    pictures(tmp_path / "bare", [1])
    text(tmp_path / "set" / "anno" / "gone.txt", rows(3))
    (tmp_path / "set" / "data_seq").mkdir()
    sequences, problems = find_sequences([tmp_path])
    assert [s.name for s in sequences] == ["good"]
    said = {p.where.removeprefix(str(tmp_path)): p.message for p in problems}
    assert set(said) == {"/empty/img", "/untold/groundtruth_rect.txt", "/bare/groundtruth.txt", "/set/data_seq/gone"}
    assert "holds no images" in said["/empty/img"]
    assert "no annotation" in said["/bare/groundtruth.txt"]


def test_paths_without_any_sequence_say_what_is_expected(tmp_path):
    (tmp_path / "nothing").mkdir()
    sequences, problems = find_sequences([tmp_path / "none", tmp_path / "nothing"])
    assert sequences == []
    assert problems[0].message == "no such file or folder"
    assert "SEQ/img" in problems[1].message


@pytest.mark.parametrize("flags", ["1,0,1", "1,0,0,0,0,0,0,0,0,0,0,x", ""])
def test_bad_attributes_are_reported_and_cost_only_the_attributes(tmp_path, flags):
    root = uav123(tmp_path / "UAV123", "UAV123", 3)
    path = text(root / "anno" / "UAV123" / "att" / "bike1.txt", flags)
    sequences, problems = find_sequences([root])
    assert [(s.name, s.attributes) for s in sequences] == [("bike1", frozenset())]
    assert len(problems) == 1
    assert problems[0].where.startswith(str(path))
    assert "without attributes" in problems[0].message


def test_every_data_set_has_as_many_flags_as_it_says():
    assert {name: len(flags) for name, flags in FLAGS.items()} == {
        "UAV123": 12,
        "UAV123@10fps": 12,
        "UAV20L": 12,
        "DTB70": 11,
        "UAVDT": 9,
        "VisDrone-SOT": 12,
        "UAVTrack112": 13,
    }
    assert all(len(set(flags)) == len(flags) for flags in FLAGS.values())


# --- pictures


def test_a_picture_is_read_and_anything_else_is_none(tmp_path):
    image = np.zeros((4, 6, 3), np.uint8)
    image[..., 2] = 200
    (tmp_path / "ä.png").write_bytes(cv2.imencode(".png", image)[1].tobytes())
    np.testing.assert_array_equal(load_image(tmp_path / "ä.png"), image)
    for name, content in (("empty.jpg", b""), ("text.jpg", b"not a picture")):
        (tmp_path / name).write_bytes(content)
        assert load_image(tmp_path / name) is None
    assert load_image(tmp_path / "none.jpg") is None
    assert load_image(tmp_path) is None


@QUICK
@given(st.lists(st.tuples(*[st.floats(-1e4, 1e4)] * 2, *[st.floats(1e-2, 1e4)] * 2), min_size=1, max_size=6))
def test_boxes_written_as_rows_come_back(tmp_path_factory, boxes):
    path = tmp_path_factory.mktemp("rows") / "a.txt"
    text(path, "".join(",".join(map(repr, box)) + "\n" for box in boxes))
    assert read_boxes(path) == tuple(Box.from_xywh(*box) for box in boxes)
