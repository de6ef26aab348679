"""Sets with tables of annotations: stills, COCO, ImageNet VID, YouTube-BB and video files."""

import gzip
import json
import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.tracker.training.datasets import (
    HEIGHT,
    WIDTH,
    box_at,
    ground_bgr,
    make_coco,
    make_stills,
    make_vid,
    make_video,
    make_video_files,
    make_youtube_bb,
    vid_object,
)
from tracker.training.errors import TrainingError
from tracker.training.recipe import Coco, Stills, Vid, VideoFiles, YoutubeBB
from tracker.training.sources import open_source
from tracker.training.sources.captures import READ_ON_FRAMES, Captures
from tracker.training.sources.faults import kind_of
from tracker.training.types import Source, View

NOWHERE = Path("/nowhere")


def stills(table: Path, **settings) -> Source:
    return open_source(Stills(kind="stills", annotations=str(table), **settings), NOWHERE, {}, frozenset())


def coco(made: tuple[Path, Path], **settings) -> Source:
    spec = Coco(kind="coco", annotations=str(made[0]), images=str(made[1]), **settings)
    return open_source(spec, NOWHERE, {}, frozenset())


def vid(path: Path, **settings) -> Source:
    return open_source(Vid(kind="vid", path=str(path), **settings), NOWHERE, {}, frozenset())


def youtube(made: tuple[Path, Path], **settings) -> Source:
    spec = YoutubeBB(kind="youtube_bb", annotations=str(made[0]), images=str(made[1]), **settings)
    return open_source(spec, NOWHERE, {}, frozenset())


def videos(path: Path, **settings) -> Source:
    return open_source(VideoFiles(kind="video_files", path=str(path), **settings), NOWHERE, {}, frozenset())


def seen(source: Source, track: int, index: int = 0) -> View:
    view = source.view(track, index)
    assert isinstance(view, View), view
    return view


def assert_ground(view: View, frame: int, seed: int = 0) -> None:
    np.testing.assert_allclose(view.image_bgr_u8[-2, 2], ground_bgr(frame, seed), atol=8)


def replace(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


class TestStills:
    def test_every_row_is_a_track_and_those_of_a_picture_are_a_group(self, tmp_path):
        source = stills(make_stills(tmp_path / "cars", pictures=2, boxes=2))
        assert source.name == "cars"  # annotations.csv says nothing
        assert [(t.group, t.label, t.frames) for t in source.tracks] == [
            ("cars/images/000.jpg", "car", (0,)),
            ("cars/images/000.jpg", "car", (0,)),
            ("cars/images/001.jpg", "car", (0,)),
            ("cars/images/001.jpg", "car", (0,)),
        ]
        assert len({t.name for t in source.tracks}) == 4
        assert seen(source, 3).box.to_xywh() == (70, 22, 40, 30)
        assert_ground(seen(source, 3), 1, seed=1)
        assert seen(pickle.loads(pickle.dumps(source)), 1).box.to_xywh() == (70, 20, 40, 30)

    def test_other_columns_any_order_no_class_a_mark_and_semicolons(self, tmp_path):
        table = make_stills(tmp_path, pictures=1, boxes=1)
        table.write_bytes(b"\xef\xbb\xbfNote; H; W; Y; X; Image\r\n\r\nhm; 30; 40; 20; 10; images\\000.jpg\r\n")
        source = stills(table, name="mine")
        assert (source.name, source.tracks[0].label) == ("mine", None)
        assert seen(source, 0).box.to_xywh() == (10, 20, 40, 30)

    def test_broken_rows_are_named_by_line_and_missing_pictures_by_name(self, tmp_path):
        table = make_stills(tmp_path, pictures=1, boxes=1)
        table.write_text(
            "image,x,y,w,h,class\n"
            "images/000.jpg,10,20,40,30\n"
            "images/000.jpg,10,20,40\n"
            "images/000.jpg,10,20,zero,30,car\n"
            "images/000.jpg,10,20,-4,30,car\n"
            ",10,20,40,30,car\n"
            "images/000.jpg,10,20,1e300,30,car\n"
            "images/gone.jpg,10,20,40,30,car\n"
        )
        source = stills(table)
        assert len(source.tracks) == 1
        assert source.skipped.lines() == [
            f"1 row whose picture is missing: {tmp_path}/images/gone.jpg ({table}:8)",
            f"5 row without an image and a box: {table}:3, {table}:4, {table}:5 and 2 more",
        ]

    def test_a_box_too_large_is_known_from_the_table_when_it_has_sizes(self, tmp_path):
        table = make_stills(tmp_path, pictures=1, boxes=1)
        rows = "images/000.jpg,5,5,20,20,{0}\nimages/000.jpg,0,0,160,100,{0}\n"
        table.write_text("image,x,y,w,h,img_w,img_h\n" + rows.format("160,120"))
        known = stills(table)
        assert len(known.tracks) == 1
        assert list(known.skipped.counts) == ["box above max_area_share 0.7"]
        table.write_text("image,x,y,w,h\n" + rows.format(""))
        unknown = stills(table)
        assert len(unknown.tracks) == 2
        fault = unknown.view(1, 0)
        assert isinstance(fault, str)
        assert "box above max_area_share 0.7" in fault
        assert kind_of(fault) == "box that cannot be used"
        (tmp_path / "images" / "000.jpg").write_bytes(b"")
        assert kind_of(unknown.view(1, 0)) == "unreadable picture"

    def test_reserved_and_excluded_pictures(self, tmp_path):
        table = make_stills(tmp_path, pictures=3, boxes=2)
        spec = Stills(kind="stills", annotations=str(table), exclude=("images/001.jpg",))
        source = open_source(spec, NOWHERE, {}, frozenset(("images/000.jpg",)))
        assert {t.group.rpartition("/")[2] for t in source.tracks} == {"002.jpg"}
        assert source.skipped.lines() == ["1 reserved for validation: images/000.jpg"]

    def test_tables_that_cannot_be_used(self, tmp_path):
        table = make_stills(tmp_path, pictures=1)
        with pytest.raises(TrainingError, match=r"annotations .*gone\.csv: no such file; expected a CSV"):
            stills(tmp_path / "gone.csv")
        with pytest.raises(TrainingError, match=r"images .*nothing: no such folder"):
            stills(table, images=str(tmp_path / "nothing"))
        table.write_text("image,x,y\n")
        with pytest.raises(TrainingError, match=r"annotations\.csv:1: no column w, h; the first line must be a header"):
            stills(table)
        table.write_text("image,x,y,w,h\n")
        with pytest.raises(TrainingError, match=r"no usable target\. Skipped: there is no annotation in it"):
            stills(table)


class TestCoco:
    def test_annotations_are_tracks_with_the_names_of_their_categories(self, tmp_path):
        source = coco(make_coco(tmp_path))
        assert source.name == "instances_tiny"
        assert [t.label for t in source.tracks] == ["cat", "cat", "cat", "dog"]
        first, dog = source.tracks[0], source.tracks[3]
        assert first.group == dog.group == "instances_tiny/000000000000.jpg"
        assert seen(source, 3).box.to_xywh() == (5, 6, 20, 25)
        assert seen(source, 1).box.to_xywh() == box_at(1)
        assert_ground(seen(source, 1), 1, seed=1)
        assert list(source.skipped.counts) == ["crowd"]

    def test_faults_are_counted(self, tmp_path):
        table, images = make_coco(tmp_path)
        content = json.loads(table.read_text())
        content["annotations"][0]["bbox"] = [1, 2, "x", 4]
        content["annotations"][1]["image_id"] = 999
        content["annotations"].append({"id": 77})
        content["images"].append({"id": 5})
        table.write_text(json.dumps(content))
        (images / "000000000002.jpg").unlink()
        source = coco((table, images))
        assert [t.label for t in source.tracks] == ["dog"]
        assert source.skipped.counts == {
            "annotation without a box or a picture": 3,
            "image entry without id or file_name": 1,
            "missing picture": 1,
            "crowd": 1,
        }
        assert f"{images}/000000000002.jpg" in "".join(source.skipped.lines())

    def test_files_that_are_not_coco(self, tmp_path):
        table, images = make_coco(tmp_path)
        table.write_text('{"images": [], "annotations": []}')
        with pytest.raises(TrainingError, match="no list categories"):
            coco((table, images))
        table.write_text('{"images": [')
        with pytest.raises(TrainingError, match=r"annotations .*instances_tiny\.json: .*expected the published"):
            coco((table, images))


def test_a_table_whose_header_is_endless_is_no_csv(tmp_path):
    table = tmp_path / "annotations.csv"
    table.write_text("image," + "x" * 200_000 + ",y,w,h\n")
    with pytest.raises(TrainingError, match=r"annotations.csv:1: no header of a CSV \(field larger than"):
        stills(table)


def test_numbers_and_depths_that_json_cannot_mean(tmp_path):
    table, images = make_coco(tmp_path)
    whole = table.read_text()
    table.write_text("[" * 200_000)
    with pytest.raises(
        TrainingError, match=r"annotations .*instances_tiny.json: .*recursion.*; expected the published"
    ):
        coco((table, images))
    table.write_text(whole.replace('"width": 160', f'"width": 1{"0" * 400}').replace("20.0, 25.0", f"1{'0' * 400}, 25"))
    source = coco((table, images))
    assert len(source.tracks) == 3
    assert source.skipped.counts["annotation without a box or a picture"] == 1
    table.write_text(whole.replace('"width": 160', f'"width": 1{"0" * 5000}'))
    with pytest.raises(TrainingError, match=r"instances_tiny.json: .*4300 digits"):
        coco((table, images))


class TestVid:
    def test_tracks_by_id_with_frames_and_names(self, tmp_path):
        source = vid(make_vid(tmp_path))
        assert [(t.name, t.label, t.frames) for t in source.tracks] == [
            ("ILSVRC2015_train_00000000/0", "n01503061", (0, 1, 2, 3)),
            ("ILSVRC2015_train_00000000/1", "n02084071", (0, 1)),
        ]
        assert source.tracks[0].group == source.tracks[1].group
        assert source.frame_range == 100
        np.testing.assert_allclose(seen(source, 0, 2).box.to_xywh(), box_at(2))
        assert_ground(seen(source, 0, 2), 2)
        assert seen(source, 1, 1).box.to_xywh() == (5, 6, 20, 25)

    def test_broken_annotations_are_named(self, tmp_path):
        make_vid(tmp_path)
        part = "VID/train/ILSVRC2015_VID_train_0000/ILSVRC2015_train_00000000"
        (tmp_path / "Annotations" / part / "000001.xml").write_text("<annotation><obj")
        replace(tmp_path / "Annotations" / part / "000000.xml", "<xmin>5</xmin>", "<xmin>five</xmin>")
        (tmp_path / "Data" / part / "000003.JPEG").unlink()
        source = vid(tmp_path)
        assert [t.frames for t in source.tracks] == [(0, 2)]
        said = "\n".join(source.skipped.lines())
        for kind, file in (
            ("unreadable annotation", "000001.xml"),
            ("object without track or box", "000000.xml"),
            ("annotation whose picture is missing", "000003.xml"),
        ):
            assert f"1 {kind}: {tmp_path}/Annotations/{part}/{file}" in said

    def test_too_large_by_the_size_in_the_annotation(self, tmp_path):
        make_vid(tmp_path)
        part = "Annotations/VID/train/ILSVRC2015_VID_train_0000/ILSVRC2015_train_00000000"
        small = vid_object(1, "n02084071", (5.0, 6.0, 20.0, 25.0))
        replace(tmp_path / part / "000000.xml", small, vid_object(1, "n02084071", (0, 0, WIDTH, HEIGHT)))
        source = vid(tmp_path)
        assert source.tracks[1].frames == (1,)
        assert list(source.skipped.counts) == ["box above max_area_share 0.7"]

    def test_missing_parts(self, tmp_path):
        with pytest.raises(TrainingError, match=r"path .*Annotations/VID/train: no such folder; expected"):
            vid(tmp_path)
        (tmp_path / "Annotations/VID/train").mkdir(parents=True)
        with pytest.raises(TrainingError, match=r"path .*Data/VID/train: no such folder"):
            vid(tmp_path)


class TestYoutubeBB:
    def test_relative_boxes_become_pixels_of_the_picture(self, tmp_path):
        source = youtube(make_youtube_bb(tmp_path))
        assert [(t.name, t.label, t.group, t.frames) for t in source.tracks] == [
            ("vidA/2/0", "car", "yt_bb_detection_train/vidA", (0, 1, 2, 3))
        ]
        for frame in range(4):
            np.testing.assert_allclose(seen(source, 0, frame).box.to_xywh(), box_at(frame), atol=1e-3)
            assert_ground(seen(source, 0, frame), frame)

    def test_absent_rows_count_as_moments_and_gaps_part_segments(self, tmp_path):
        table, images = make_youtube_bb(tmp_path)
        rows = table.read_text().splitlines()
        rows[1] = "vidA,1000,2,car,0,absent,-1,-1,-1,-1"
        later = [rows[0].replace("vidA,0,", f"vidA,{ms},") for ms in (60000, 61000)]
        other = [rows[0].replace(",2,car,0,", ",2,car,1,"), rows[0].replace(",2,car,0,", ",5,bus,0,")]
        table.write_text("\n".join([*later, *rows, *other]))
        for ms in (60000, 61000):
            (images / "vidA" / f"{ms}.jpg").write_bytes((images / "vidA" / "0.jpg").read_bytes())
        source = youtube((table, images))
        assert sorted((t.name, t.label, t.frames) for t in source.tracks) == [
            ("vidA/2/0", "car", (0, 2, 3)),
            ("vidA/2/0.1", "car", (4, 5)),
            ("vidA/2/1", "car", (0,)),
            ("vidA/5/0", "bus", (0,)),
        ]
        assert source.skipped.lines() == []

    def test_header_archive_and_a_pattern_of_its_own(self, tmp_path):
        table, images = make_youtube_bb(tmp_path, frames=2)
        header = "youtube_id,timestamp_ms,class_id,class_name,object_id,object_presence,xmin,xmax,ymin,ymax\n"
        packed = table.with_suffix(".csv.gz")
        packed.write_bytes(gzip.compress((header + table.read_text()).encode()))
        (images / "vidA" / "1000.jpg").rename(images / "vidA_car_0001000.jpg")
        source = youtube((packed, images), pattern="{youtube_id}_{class_name}_{timestamp_ms:07d}.jpg")
        assert source.tracks[0].frames == (1,)
        assert list(source.skipped.counts) == ["missing picture"]
        packed.write_bytes(packed.read_bytes()[:60])
        with pytest.raises(TrainingError, match="cannot be read: "):
            youtube((packed, images))

    def test_limits_apply_to_the_share_on_opening_and_to_pixels_when_read(self, tmp_path):
        table, images = make_youtube_bb(tmp_path, frames=3)
        rows = table.read_text().splitlines()
        rows[1] = "vidA,1000,2,car,0,present,0.0,0.9,0.0,0.9"
        rows[2] = "vidA,2000,2,car,0,present,0.5,0.55,0.5,0.6"  # 8 x 12 px
        table.write_text("\n".join(rows))
        source = youtube((table, images))
        assert source.tracks[0].frames == (0, 2)
        assert list(source.skipped.counts) == ["box above max_area_share 0.7"]
        fault = source.view(0, 1)
        assert isinstance(fault, str)
        assert "box below min_side_px 12" in fault

    def test_corrupt_rows_are_named(self, tmp_path):
        table, images = make_youtube_bb(tmp_path, frames=3)
        rows = table.read_text().splitlines()
        rows[1] = "vidA,1000,2,car,0,present,0.5,0.4,0.5,0.6"
        rows[2] = "vidA,2000,2"
        table.write_text("\n".join(rows))
        assert youtube((table, images)).skipped.lines() == [f"2 corrupt row: {table}:2, {table}:3"]

    @pytest.mark.parametrize(
        "pattern", ["{youtube_id}.jpg", "{timestamp_ms}.jpg", "{video}/{timestamp_ms}", "{", "{0}"]
    )
    def test_patterns_that_cannot_name_frames(self, tmp_path, pattern):
        with pytest.raises(TrainingError, match=r"pattern .*it may hold \{youtube_id\}"):
            youtube(make_youtube_bb(tmp_path, frames=1), pattern=pattern)


class TestVideoFiles:
    def test_frames_by_number_in_any_order(self, tmp_path):
        source = videos(make_video_files(tmp_path / "clips", ("a", "b"), frames=40))
        assert source.name == "clips"
        assert [(t.name, t.label, t.group) for t in source.tracks] == [
            ("a/drone", "drone", "clips/a"),
            ("b/drone", "drone", "clips/b"),
        ]
        for track, frame in ((0, 39), (0, 0), (0, 1), (1, 35), (0, 17), (1, 3), (0, 16), (0, 38)):
            view = seen(source, track, frame)
            assert_ground(view, frame, seed=track)
            np.testing.assert_allclose(view.box.to_xywh(), box_at(frame % 18))

    def test_it_travels_with_open_videos(self, tmp_path):
        source = videos(make_video_files(tmp_path, frames=12))
        assert_ground(seen(source, 0, 5), 5)
        assert_ground(seen(pickle.loads(pickle.dumps(source)), 0, 9), 9)
        assert_ground(seen(source, 0, 6), 6)

    def test_tracks_and_frames_with_several_boxes(self, tmp_path):
        make_video(tmp_path / "clip.mp4", frames=4)
        box = "10,10,30,30"
        (tmp_path / "clip.csv").write_text(
            f"frame,x,y,w,h,label\n0,{box},drone\n1,{box},drone\n1,{box},bird\n2,{box},bird\n3,{box},drone\n"
        )
        source = videos(tmp_path)
        assert [(t.label, t.frames) for t in source.tracks] == [("drone", (0, 3)), ("bird", (2,))]
        assert source.skipped.lines() == [
            f"1 frame with several boxes and no track column: {tmp_path}/clip.csv frame 1"
        ]
        (tmp_path / "clip.csv").write_text(
            f"frame,x,y,w,h,track\n0,{box},7\n1,{box},7\n1,{box},8\n1,{box},8\n3,{box},8\n"
        )
        tracked = videos(tmp_path)
        assert [(t.name, t.label, t.frames) for t in tracked.tracks] == [
            ("clip/7", None, (0, 1)),
            ("clip/8", None, (1, 3)),
        ]
        assert list(tracked.skipped.counts) == ["second box of a track in one frame"]

    def test_what_does_not_belong_together(self, tmp_path):
        make_video_files(tmp_path, ("a", "b"), frames=2)
        (tmp_path / "c.csv").write_text("frame,x,y,w,h\n0,1,2,30,30\n")
        (tmp_path / "d.csv").write_text("")
        make_video(tmp_path / "d.mp4", frames=1)
        (tmp_path / "b.csv").unlink()
        replace(tmp_path / "a.csv", "1,43", "-1,43")
        source = videos(tmp_path)
        assert source.tracks[0].frames == (0,)
        assert set(source.skipped.counts) == {
            "table without a video",
            "video without a table",
            "unreadable table",
            "row without a frame and a box",
        }
        assert f"{tmp_path}/a.csv:3" in "".join(source.skipped.lines())

    def test_videos_that_cannot_be_decoded(self, tmp_path):
        make_video_files(tmp_path, frames=3)
        with (tmp_path / "clip.csv").open("a") as table:
            table.write("99,1,2,30,30,drone\n")
        source = videos(tmp_path)
        assert source.tracks[0].frames == (0, 1, 2, 99)
        assert source.view(0, 3) == f"{tmp_path}/clip.mp4: cannot decode frame 99"
        assert_ground(seen(source, 0, 1), 1)
        (tmp_path / "clip.mp4").write_bytes(b"nothing")
        assert pickle.loads(pickle.dumps(source)).view(0, 0) == f"{tmp_path}/clip.mp4: not a video that OpenCV can read"
        (tmp_path / "clip.mp4").unlink()
        assert pickle.loads(pickle.dumps(source)).view(0, 0) == f"{tmp_path}/clip.mp4: no such file"
        with pytest.raises(TrainingError, match="no table there"):
            videos(make_stills(tmp_path / "other").parent / "images")


class _SeeksWrong:
    """A capture that lands some frames before the one that was asked for, as with videos of odd key frames."""

    def __init__(self, *arguments) -> None:
        self._capture = REAL_CAPTURE(*arguments)

    def __getattr__(self, name):
        return getattr(self._capture, name)

    def set(self, key: int, value: float) -> bool:
        return self._capture.set(key, max(0, value - 3))


REAL_CAPTURE = cv2.VideoCapture


def test_a_seek_that_lands_elsewhere_is_noticed(tmp_path, monkeypatch):
    make_video(tmp_path / "v.mp4", frames=50)
    monkeypatch.setattr(cv2, "VideoCapture", _SeeksWrong)
    captures = Captures()
    for frame in (READ_ON_FRAMES + 11, 3, 49, 20):
        image = captures.read(tmp_path / "v.mp4", frame)
        assert not isinstance(image, str)
        np.testing.assert_allclose(image[-2, 2], ground_bgr(frame), atol=8)


def test_a_forked_process_opens_videos_for_itself(tmp_path, monkeypatch):
    make_video(tmp_path / "v.mp4", frames=3)
    opened = []
    monkeypatch.setattr(cv2, "VideoCapture", lambda *a: opened.append(a) or REAL_CAPTURE(*a))
    captures = Captures()
    for process in (1, 1, 2, 2):
        monkeypatch.setattr("os.getpid", lambda process=process: process)
        assert not isinstance(captures.read(tmp_path / "v.mp4", 1), str)
    assert len(opened) == 2
