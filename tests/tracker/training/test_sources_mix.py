"""The mix of a recipe, what is injected, and the parts that many sources share."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.tracker.training.datasets import make_coco, make_folders, make_stills, picture
from tracker.training.errors import TrainingError
from tracker.training.recipe import Coco, Folders, Packed, Recipe, Simulator, Stills, Validation
from tracker.training.source_names import source_name
from tracker.training.sources import open_footage, open_mix, open_source, reserved_names
from tracker.training.sources.limits import Limits
from tracker.training.sources.pictures import picture_size
from tracker.training.sources.strings import Strings
from tracker.training.sources.table import Rows
from tracker.training.types import Skipped


class Drawn:
    """Stands for the simulator's pictures."""

    def __init__(self, spec: Simulator) -> None:
        self.name, self.spec = "drawn", spec

    def footage(self):
        return ("whole", self.spec.seed)


def test_shares_are_normalised_and_the_simulator_is_injected(tmp_path):
    make_folders(tmp_path / "videos", frames=2)
    make_stills(tmp_path / "cars", pictures=1)
    specs = (
        Folders(kind="folders", path="videos", share=1),
        Stills(kind="stills", annotations="cars/annotations.csv", share=5),
        Simulator(kind="simulator", share=2, seed=3),
    )
    mix = open_mix(specs, tmp_path, {"simulator": Drawn}, frozenset())
    np.testing.assert_allclose(mix.shares, [1 / 8, 5 / 8, 2 / 8])
    assert [s.name for s in mix.sources] == ["videos", "cars", "drawn"]
    assert open_footage(specs[2], tmp_path, {"simulator": Drawn}) == ["whole", 3]
    with pytest.raises(TrainingError, match=r"sources\.2 \(simulator\): kind simulator: not available"):
        open_mix(specs, tmp_path, {}, frozenset())


def test_faults_name_the_place_in_the_recipe(tmp_path):
    make_folders(tmp_path / "videos", frames=2)
    spec = Folders(kind="folders", path="videos")
    with pytest.raises(TrainingError, match=r"sources\.1 \(folders\): path .*gone: no such folder"):
        open_mix((spec, Folders(kind="folders", path="gone")), tmp_path, {}, frozenset())
    with pytest.raises(TrainingError, match="more than one is called videos; give them a name each"):
        open_mix((spec, spec), tmp_path, {}, frozenset())
    named = Folders(kind="folders", path="videos", name="again")
    assert [s.name for s in open_mix((spec, named), tmp_path, {}, frozenset()).sources] == ["videos", "again"]


def test_paths_are_absolute_or_below_the_root(tmp_path):
    make_folders(tmp_path / "videos", frames=2)
    for path, root in (("videos", tmp_path), (str(tmp_path / "videos"), Path("/nowhere"))):
        source = open_source(Folders(kind="folders", path=path), root, {}, frozenset())
        assert len(source.tracks) == 2


def test_validation_needs_whole_sequences(tmp_path):
    table, images = make_coco(tmp_path)
    spec = Coco(kind="coco", annotations=str(table), images=str(images))
    for attempt in (
        lambda: open_footage(spec, tmp_path, {}),
        lambda: reserved_names(Validation(sources=(spec,)), tmp_path),
    ):
        with pytest.raises(TrainingError, match="kind coco has no whole sequences; use folders, got10k or simulator"):
            attempt()
    drawn = Simulator(kind="simulator", seed=7, sequences=2)
    assert reserved_names(Validation(sources=(drawn,)), tmp_path) == {"sim-000007", "sim-000008"}


def test_every_kind_of_a_recipe_is_opened_here():
    from tracker.training.sources.opening import _OPENERS

    schema = Recipe.model_json_schema()["properties"]["sources"]["items"]["discriminator"]["mapping"]
    assert {"simulator", "packed"} | {cls.model_fields["kind"].annotation.__args__[0] for cls in _OPENERS} == set(
        schema
    )


def test_names_come_from_the_paths_in_the_recipe():
    for name, spec in {
        "otb": Folders(kind="folders", path="videos/otb/"),
        "v1.2": Folders(kind="folders", path="v1.2"),
        "folders": Folders(kind="folders", path="."),
        "mine": Folders(kind="folders", path="otb", name="mine"),
        "voc": Stills(kind="stills", annotations="voc/annotations.csv"),
        "cars": Stills(kind="stills", annotations="voc/cars.csv.gz"),
        "stills": Stills(kind="stills", annotations="annotations.csv"),
        "instances_val": Coco(kind="coco", annotations="c/instances_val.json", images="i"),
        "part": Packed(kind="packed", path="p", set_name="part"),
        "simulator": Simulator(kind="simulator"),
    }.items():
        assert source_name(spec) == name


def test_strings_are_as_they_were():
    texts = ["", "a/b.jpg", "Größe", "\udcff broken name", "z"]
    strings = Strings(texts)
    assert list(strings) == texts
    assert (strings[-1], strings[1:3], len(strings)) == ("z", ["a/b.jpg", "Größe"], 5)
    with pytest.raises(IndexError):
        strings[5]


def test_limits_judge_only_what_is_known():
    limits = Limits(min_side_px=10, max_aspect=4, max_area_share=0.5)
    sizes = np.array([[10, 10], [9, 30], [50, 12], [30, 30], [np.nan, np.nan]])
    shares = np.array([0.5, 0.1, np.nan, 0.51, 0.6])
    assert limits.broken(sizes, shares).tolist() == [-1, 0, 1, 2, 2]


def test_rows_come_sorted_by_track_and_frame():
    rows, skipped = Rows(), Skipped()
    a, b, empty = (rows.track("video", name, None) for name in "abc")
    for track, frame in ((b, 7), (a, 9), (b, 1), (a, 2), (a, 9)):
        rows.add(track, rows.picture(f"{frame}.jpg"), frame, (frame, 0, 20, 20))
    rows.add(empty, 0, 0, (0, 0, 2, 2))
    table = rows.finish(Limits(12, 6, 0.7), 1, False, skipped)
    assert list(table.names) == ["a", "b"]
    assert table.frame.tolist() == [2, 9, 1, 7]
    assert table.first.tolist() == [0, 2, 4]
    assert [table.pictures[p] for p in table.picture] == ["2.jpg", "9.jpg", "1.jpg", "7.jpg"]
    assert table.box[:, 0].tolist() == [2, 9, 1, 7]
    assert skipped.counts == {"second box of a track in one frame": 1, "box below min_side_px 12": 1}


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_sizes_come_from_the_header(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    cv2.imwrite(str(path), picture(None, size=(321, 123)))
    assert picture_size(path) == (321, 123)
    path.write_bytes(path.read_bytes()[:20])
    assert picture_size(path) is None
    assert picture_size(tmp_path / "gone.jpg") is None
