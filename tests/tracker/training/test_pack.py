import json
import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

from tracker.box import Box
from tracker.siamapnpp.crop import CropGeometry, crop_square, exemplar_side_px
from tracker.training import pack, resident
from tracker.training.errors import TrainingError
from tracker.training.pack import choose, cut, prepare, window_px
from tracker.training.pairs import HostBatches
from tracker.training.recipe import Packed, Recipe
from tracker.training.resident import DeviceBatches, load_pool, resident_batches
from tracker.training.sources.mix import Mix, open_mix
from tracker.training.sources.packed import open_packed, packed_recipe
from tracker.training.types import Skipped, Track, View

WIDTH, HEIGHT = 320, 240
CPU = torch.device("cpu")


def smooth(seed):
    """A picture that survives JPEG and resampling."""
    rng = np.random.default_rng(seed)
    small = rng.integers(30, 226, (HEIGHT // 20, WIDTH // 20, 3)).astype(np.uint8)
    return cv2.resize(small, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)


class Drawn:
    """Tracks of smooth pictures with targets of different sizes, some at the border."""

    def __init__(self, name, tracks, frame_range=20, broken=()):
        self.name, self.tracks, self.frame_range, self.broken = name, tracks, frame_range, set(broken)
        self.skipped = Skipped()

    def view(self, track, index):
        if (track, index) in self.broken:
            return f"{self.name}/{track}/{index}.jpg: cut short"
        w = (20.0, 44.3, 120.5)[track % 3]
        box = Box(40.25 + 37.0 * track + 3.0 * index, 100.5 + 20.0 * index, w, 0.7 * w)
        return View(smooth([track, index]), box, (10.0, 120.4, 30.0))


def drawn_mix(broken=()):
    stills = Drawn("stills", [Track(f"s{i}", (0,), "car" if i % 2 else "van", f"stills/{i // 2}") for i in range(6)], 0)
    videos = Drawn("my videos", [Track(f"v{i}", (0, 4, 30), None, f"my videos/seq{i}") for i in range(3)], 10, broken)
    return Mix((stills, videos), np.array([0.75, 0.25]))


def recipe_of(names=("stills", "my videos"), batch=8, **changes):
    specs = [{"kind": "folders", "path": name, "share": 1 + i} for i, name in enumerate(names)]
    stage = {"pairs": 100, "batch": batch, "search_px": 223}
    return Recipe.model_validate(
        {"name": "drawn", "description": "t", "sources": specs, "stages": [stage, stage]} | changes
    )


@pytest.fixture(scope="module")
def packed(tmp_path_factory):
    out = tmp_path_factory.mktemp("packs") / "pack"
    prepare(drawn_mix(), recipe_of(), out)
    return out


@pytest.fixture
def copied(packed, tmp_path):
    """A pack that may be damaged."""
    out = tmp_path / "copy"
    out.mkdir()
    for file in packed.iterdir():
        (out / file.name).write_bytes(file.read_bytes())
    return out


def spec_of(path, name="my videos", **more):
    return Packed(kind="packed", path=str(path), set_name=name, **more)


def source_of(path, name="my videos", reserved=frozenset(), **more):
    return open_packed(spec_of(path, name, **more), Path("/"), reserved)


def packed_mix(path, **changes):
    recipe = packed_recipe(recipe_of(**changes), path)
    return open_mix(recipe.sources, Path("/"), {}, frozenset()), recipe


def test_a_packed_view_shows_what_the_original_shows(packed):
    original, source = drawn_mix().sources[1], source_of(packed)
    for track in range(3):
        for index in range(3):
            one, other = original.view(track, index), source.view(track, index)
            squares = []
            for view in (one, other):
                side = exemplar_side_px(view.box.w_px, view.box.h_px)
                window = CropGeometry(view.box.cx_px, view.box.cy_px, side * 223 / 127, 223)
                squares.append(crop_square(view.image_bgr_u8, window, view.fill_bgr).astype(float))
            assert np.abs(squares[0] - squares[1]).mean() < 2.5
            assert other.box.w_px / other.box.h_px == pytest.approx(one.box.w_px / one.box.h_px, rel=0.01)
            assert other.fill_bgr == (10, 120, 30)


def test_a_large_target_is_shrunk_and_a_small_one_left_alone():
    large = cut(View(smooth(1), Box(160, 120, 200, 150), (0, 0, 0)), 511)
    assert (large.box.w_px, large.box.h_px) == (100, 75)  # its square of 363 px becomes 181: by a whole factor
    small = cut(View(smooth(1), Box(160.25, 120.5, 30, 20), (0, 0, 0)), 511)
    assert (small.box.w_px, small.box.h_px) == (30, 20)
    height, width = cv2.imdecode(np.frombuffer(small.jpeg, np.uint8), cv2.IMREAD_COLOR).shape[:2]
    side = exemplar_side_px(30, 20) * 511 / 127
    assert side <= width <= side + 2
    assert side <= height <= side + 2
    assert small.box.cx_px % 1 == 0.25  # cut at whole pixels


def test_only_what_the_camera_saw_is_kept():
    corner = cut(View(smooth(1), Box(-3.0, 4.0, 30, 30), (0, 0, 0)), 511)
    height, width = cv2.imdecode(np.frombuffer(corner.jpeg, np.uint8), cv2.IMREAD_COLOR).shape[:2]
    assert (corner.box.cx_px, corner.box.cy_px) == (-3.0, 4.0)
    assert max(width, height) < 130
    assert cut(View(smooth(1), Box(2000.0, 4.0, 30, 30), (0, 0, 0)), 511) == "box outside the picture"
    assert cut(View(smooth(1), Box(20.0, 4.0, float("nan"), 30), (0, 0, 0)), 511) == "box without a size"


def test_tracks_come_back(packed):
    for number, name in enumerate(("stills", "my videos")):
        original, source = drawn_mix().sources[number], source_of(packed, name, frame_range=7)
        assert list(source.tracks) == original.tracks
        assert source.frame_range == 7
        assert source.name == name


def test_a_packed_source_travels_to_other_processes(packed):
    source = source_of(packed)
    source.view(0, 0)
    again = pickle.loads(pickle.dumps(source))
    assert again.view(2, 1).box == source.view(2, 1).box


def test_reserved_excluded_and_chosen_tracks(packed):
    def names(source):
        return [track.name for track in source.tracks]

    whole = source_of(packed)
    some = source_of(packed, reserved=frozenset(["seq0"]), exclude=("v2",))
    assert names(some) == ["v1"]
    assert some.skipped.counts["reserved for validation"] == 1
    assert some.view(0, 2).box == whole.view(1, 2).box
    assert names(source_of(packed, only=("seq2",))) == ["v2"]
    with pytest.raises(TrainingError, match=r"`my videos` has no track left .*reserved for validation: v0, v1, v2"):
        source_of(packed, reserved=frozenset(["v0", "v1", "seq2"]))


def test_stride_keeps_some_frames(packed):
    source = source_of(packed, stride=2)
    assert [track.frames for track in source.tracks] == [(0, 30)] * 3
    assert source.view(1, 1).box == source_of(packed).view(1, 2).box


def test_a_full_shard_is_followed_by_another(tmp_path, monkeypatch):
    monkeypatch.setattr(pack, "SHARD_BYTES", 40_000)
    report = prepare(drawn_mix(), recipe_of(), tmp_path / "p")
    shards = sorted((tmp_path / "p").glob("my_videos-*.safetensors"))
    assert [path.name for path in shards] == [f"my_videos-{k:03d}.safetensors" for k in range(len(shards))]
    assert len(shards) > 1
    assert all(path.stat().st_size <= 40_000 for path in shards)
    assert report.sources[1].size_bytes == sum(path.stat().st_size for path in shards)
    one, other = source_of(tmp_path / "p"), drawn_mix().sources[1]
    assert all(
        isinstance(one.view(t, i), View) for t, track in enumerate(other.tracks) for i in range(len(track.frames))
    )


def test_processes_pack_the_same_files(packed, tmp_path):
    prepare(drawn_mix(), recipe_of(), tmp_path / "p", workers=2)
    for file in packed.iterdir():
        assert (tmp_path / "p" / file.name).read_bytes() == file.read_bytes()


def test_what_cannot_be_read_is_counted_and_left_out(tmp_path):
    told = []
    mix = drawn_mix(broken=[(0, 0), (0, 1), (0, 2), (1, 1)])
    mix.sources[1].skipped.add("unreadable sequence", "\udcff")  # a name that is no text
    report = prepare(mix, recipe_of(), tmp_path / "p", progress=lambda *args: told.append(args))
    assert report.skipped.counts["unreadable picture"] == 4
    assert "4 unreadable picture: my videos/0/0.jpg: cut short" in (tmp_path / "p" / "pack.json").read_text()
    assert [(t.name, t.frames) for t in source_of(tmp_path / "p").tracks] == [("v1", (0, 30)), ("v2", (0, 4, 30))]
    assert told[-1] == ("my videos", 9, 9)
    assert (report.sources[1].tracks, report.sources[1].crops) == (2, 5)


def test_a_source_without_a_crop_is_an_error_and_leaves_nothing(tmp_path):
    broken = [(t, i) for t in range(3) for i in range(3)]
    with pytest.raises(TrainingError, match="`my videos` gave no crop: 9 unreadable picture: my videos/0/0"):
        prepare(drawn_mix(broken), recipe_of(), tmp_path / "p")
    assert list(tmp_path.iterdir()) == []


def test_interrupted_it_leaves_nothing(tmp_path):
    def interrupt(name, done, total):
        if name == "my videos":
            assert [p.name[:3] for p in tmp_path.iterdir()] == [".p-"]
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        prepare(drawn_mix(), recipe_of(), tmp_path / "p", progress=interrupt)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("error", [SafetensorError("No space left on device"), OSError(28, "No space left on device")])
def test_a_full_disk_is_told_and_leaves_nothing(tmp_path, monkeypatch, error):
    def full(tensors, path):
        path.write_bytes(b"the part that there was room for")
        raise error

    monkeypatch.setattr(pack, "save_file", full)
    with pytest.raises(TrainingError, match=r"p: cannot be written \(No space left on device\); make room, or choose"):
        prepare(drawn_mix(), recipe_of(), tmp_path / "p")
    assert list(tmp_path.iterdir()) == []


class Misplaced(Drawn):
    """Its boxes lie beside the pictures, as those of a table with exchanged columns do."""

    def view(self, track, index):
        view = super().view(track, index)
        return View(view.image_bgr_u8, Box(9000.0, 50.0, 20.0, 20.0), view.fill_bgr) if track == 0 else view


@pytest.mark.parametrize("workers", [0, 1])
def test_boxes_that_cannot_be_used_are_not_called_pictures_that_cannot(tmp_path, workers):
    mix = Mix((Misplaced("a", [Track(f"t{i}", (0, 1), None, f"g{i}") for i in range(2)], 5, [(1, 0)]),), np.ones(1))
    report = prepare(mix, recipe_of(("a",)), tmp_path / "p", workers=workers)
    assert report.skipped.lines() == [
        "2 box that cannot be used: t0 frame 0: box outside the picture, t0 frame 1: box outside the picture",
        "1 unreadable picture: a/1/0.jpg: cut short",
    ]


def test_one_frame_of_a_video_is_too_few_and_one_still_picture_is_not(tmp_path):
    with pytest.raises(
        TrainingError, match=r"source `my videos`: limit 1: a pair needs 2 frames of a video.*at least 2"
    ):
        prepare(drawn_mix(), recipe_of(), tmp_path / "p", limit_per_source=1)
    assert list(tmp_path.iterdir()) == []
    stills = Mix(drawn_mix().sources[:1], np.ones(1))
    assert prepare(stills, recipe_of(("stills",)), tmp_path / "p", limit_per_source=1).sources[0].crops == 1


@pytest.mark.parametrize("track", [Track("t\udcff", (0, 1), None, "a/g"), Track("t", (0, 1), None, "a/\udcff")])
def test_names_that_are_no_text_are_told_before_the_work(tmp_path, track):
    told = []
    with pytest.raises(TrainingError, match=r"source `a`: 't.*' is not UTF-8, as pack.json must be; rename"):
        prepare(Mix((Drawn("a", [track]),), np.ones(1)), recipe_of(("a",)), tmp_path / "p", None, None, told.append)
    assert told == []
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_written_over(copied):
    before = (copied / "pack.json").read_bytes()
    with pytest.raises(TrainingError, match="exists already"):
        prepare(drawn_mix(), recipe_of(), copied)
    assert (copied / "pack.json").read_bytes() == before


def test_the_window_is_what_the_widest_crop_of_the_recipe_can_show():
    wide = {"pairs": 9, "search_px": 255, "jitter": {"shift_px": 51, "log_scale": 0.5}}
    recipe = recipe_of().model_dump(mode="json")
    assert window_px(Recipe.model_validate(recipe | {"stages": [*recipe["stages"], wide]})) == 589
    small = {"pairs": 9, "search_px": 223, "jitter": {"shift_px": 0, "log_scale": 0}}
    assert window_px(Recipe.model_validate(recipe | {"stages": [small]})) == 287


@pytest.mark.parametrize("crop_px", [286, 2000])
def test_crop_size_has_a_range(tmp_path, crop_px):
    with pytest.raises(TrainingError, match=f"crop_px {crop_px}: must be from 287"):
        prepare(drawn_mix(), recipe_of(), tmp_path / "p", crop_px)


def test_sources_whose_files_would_be_one(tmp_path):
    mix = Mix((Drawn("a b", []), Drawn("a_b", [])), np.array([0.5, 0.5]))
    with pytest.raises(TrainingError, match="`a b` and `a_b`"):
        prepare(mix, recipe_of(), tmp_path / "p")


def lengths(chosen, tracks):
    return np.bincount(chosen[:, 0], minlength=tracks).tolist()


def long_source(*counts, step=1, frame_range=50):
    tracks = [Track(f"t{i}", tuple(range(0, n * step, step)), None, f"g{i}") for i, n in enumerate(counts)]
    return Drawn("long", tracks, frame_range)


def test_a_limit_is_spread_over_tracks_and_frames():
    assert lengths(choose(long_source(10, 3, 1), None), 3) == [10, 3, 1]
    assert lengths(choose(long_source(10, 3, 1), 14), 3) == [10, 3, 1]
    chosen = choose(long_source(100, 100, 3, 1), 44)
    assert lengths(chosen, 4) == [20, 20, 3, 1]
    frames = chosen[chosen[:, 0] == 0, 1]
    assert (frames[0], frames[-1]) == (0, 99)
    assert np.diff(frames).max() <= 6


def test_many_tracks_give_two_frames_each_of_some():
    chosen = choose(long_source(*[5] * 40), 20)
    assert len(chosen) <= 20
    used = np.unique(chosen[:, 0])
    assert lengths(chosen, 40) == [2 if t in used else 0 for t in range(40)]
    assert len(used) == 10
    assert np.diff(used).max() <= 4
    stills = choose(long_source(*[1] * 40), 10)
    assert np.diff(stills[:, 0]).tolist() == [4] * 9


def test_frames_of_a_long_track_have_neighbours_within_the_frame_range():
    source = long_source(5000, frame_range=30)
    frames = np.array(choose(source, 20)[:, 1])
    assert len(frames) == 20
    assert all(np.sort(np.abs(frames - f))[1] <= 30 for f in frames)
    assert frames.min() < 100
    assert frames.max() > 4900


def test_a_recipe_trains_from_its_pack(packed):
    recipe = recipe_of(pairing={"negative": 0.1})
    changed = packed_recipe(recipe, packed)
    assert [(s.name, s.share) for s in changed.sources] == [("stills", 1), ("my videos", 2)]
    assert changed.model_copy(update={"sources": recipe.sources}) == recipe
    mix, _ = packed_mix(packed)
    assert mix.shares.tolist() == pytest.approx([1 / 3, 2 / 3])
    batch = HostBatches(mix, recipe, 0).batch(0)
    assert batch.search.float().std() > 10


def test_a_recipe_with_other_sources_is_told_the_difference(packed):
    with pytest.raises(TrainingError, match=r"recipe `drawn`.*the pack lacks cats; the recipe lacks my videos"):
        packed_recipe(recipe_of(("stills", "cats")), packed)


def edit(pack_folder, change):
    path = pack_folder / "pack.json"
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))


def tracks_of(data):
    return data["sources"][1]["tracks"]


def shortened(tracks):
    for column in ("names", "label", "group"):
        tracks[column].pop()


def counted(data, crops):
    data["sources"][1].update(crops=crops)
    data["sources"][1]["shards"][0].update(crops=crops)


def retold(pack_folder, name, change):
    """Write a shard again with one of its tensors changed."""
    path = pack_folder / "my_videos-000.safetensors"
    tensors = load_file(path)
    save_file(tensors | {name: change(tensors[name])}, path)
    edit(pack_folder, lambda d: d["sources"][1]["shards"][0].update(size_bytes=path.stat().st_size))


DAMAGE = {
    "no such folder": (lambda p: [f.unlink() for f in p.iterdir()], "no pack .*pack.json.*train prepare"),
    "another schema": (lambda p: edit(p, lambda d: d.update(schema_version=9)), "schema 9, this program reads 1"),
    "a missing key": (lambda p: edit(p, lambda d: d.pop("crop_px")), "pack.json: crop_px: Field required"),
    "no JSON": (lambda p: (p / "pack.json").write_text("{"), "pack.json: the file: Invalid JSON"),
    "a missing shard": (
        lambda p: (p / "my_videos-000.safetensors").unlink(),
        "my_videos-000.safetensors: cannot be read",
    ),
    "a short shard": (
        lambda p: (p / "my_videos-000.safetensors").write_bytes(b"12"),
        r"my_videos-000.safetensors: 2 bytes, pack.json says \d+",
    ),
    "other counts": (lambda p: edit(p, lambda d: counted(d, 5)), r"offset is \[10\]"),
    "counts that do not add up": (
        lambda p: edit(p, lambda d: d["sources"][1].update(crops=5)),
        r"pack.json: sources.1: crops 5: its shards hold 9; make the pack again",
    ),
    "other tracks": (lambda p: edit(p, lambda d: shortened(tracks_of(d))), "tracks of `my videos`"),
    "not UTF-8": (
        lambda p: (p / "pack.json").write_bytes(b'{"schema_version": 1, "recipe": "\xe9"}'),
        "pack.json: is not UTF-8 text .*make the pack again",
    ),
    "columns of other lengths": (
        lambda p: edit(p, lambda d: tracks_of(d)["group"].pop()),
        "pack.json: sources.1.tracks: names, label and group have 3, 3, 2 entries; make",
    ),
    "a label beyond": (
        lambda p: edit(p, lambda d: tracks_of(d).update(label=[-1, 0, -1])),
        "pack.json: sources.1.tracks: label 0: must be from -1 to -1",
    ),
    "a label below": (lambda p: edit(p, lambda d: tracks_of(d).update(label=[-1, -2, -1])), "label -2: must"),
    "a group beyond": (
        lambda p: edit(p, lambda d: tracks_of(d).update(group=[0, 1, 3])),
        "sources.1.tracks: group 3: must be from 0 to 2, a number into groups",
    ),
    "a group below": (lambda p: edit(p, lambda d: tracks_of(d).update(group=[0, 1, -1])), "group -1: must be from 0"),
    "a frame range below 0": (
        lambda p: edit(p, lambda d: d["sources"][1].update(frame_range=-1)),
        "pack.json: sources.1.frame_range: Input should be greater than or equal to 0",
    ),
    "the same source twice": (
        lambda p: edit(p, lambda d: d["sources"].append(d["sources"][0])),
        "pack.json: the file: sources: the source stills is there twice",
    ),
    "share 0": (lambda p: edit(p, lambda d: d["sources"][0].update(share=0)), r"sources.0.share: .*greater than 0"),
    "crop_px 0": (
        lambda p: edit(p, lambda d: d.update(crop_px=0)),
        "pack.json: crop_px: .*greater than or equal to 287",
    ),
    "a shard elsewhere": (
        lambda p: edit(p, lambda d: d["sources"][0]["shards"][0].update(file="../my_videos-000.safetensors")),
        "sources.0.shards.0.file: String should match",
    ),
    "offsets out of order": (lambda p: retold(p, "offset", lambda t: t[[0, 2, 1, *range(3, 10)]]), "table of pictures"),
    "frames out of order": (lambda p: retold(p, "frame", lambda t: t[::-1].copy()), "frames of `my videos` are not in"),
    "numbers of another type": (
        lambda p: retold(p, "track", lambda t: t.astype(np.float32)),
        "track is F32 of 1 dimensions, not I32 of 1",
    ),
}


@pytest.mark.parametrize(("damage", "message"), DAMAGE.values(), ids=DAMAGE)
def test_a_damaged_pack_is_an_error(copied, damage, message):
    damage(copied)
    with pytest.raises(TrainingError, match=message):
        source_of(copied)


def test_a_set_that_is_not_there(packed):
    with pytest.raises(TrainingError, match="no source `cats`, only stills, my videos"):
        source_of(packed, "cats")


def spoil(pack_folder, name="my_videos-000.safetensors", where=0.3):
    """Overwrite a part of a shard's pictures; size and tables stay."""
    path = pack_folder / name
    data = bytearray(path.read_bytes())
    start = int(len(data) * where)
    data[start : start + len(data) // 3] = bytes(len(data) // 3)
    path.write_bytes(data)
    return path


def test_a_spoilt_picture_is_drawn_again_by_host_and_device(copied, monkeypatch):
    spoil(copied)
    mix, recipe = packed_mix(copied, batch=12)
    host = HostBatches(mix, recipe, 0).batch(0)
    assert host.skipped.counts["unreadable picture"] > 0
    assert "is not a JPEG picture" in host.skipped.named["unreadable picture"][0]
    monkeypatch.setattr(resident, "_check_hash", lambda file: None)
    device = DeviceBatches(mix, recipe, 0, CPU).batch(0)
    assert device.skipped.counts == host.skipped.counts
    assert torch.allclose(device.box, host.box, atol=1e-2)


def test_the_pool_is_loaded_from_whole_files_only(copied):
    path = spoil(copied)
    mix, _ = packed_mix(copied)
    with pytest.raises(TrainingError, match=f"{path}: is not the file that pack.json describes"):
        load_pool(mix, CPU)


PLAIN = {
    "gray": 0, "colour": 0, "gamma": 0, "motion_blur": 0, "blur": 0, "low_resolution": 0, "noise": 0, "fog": 0,
    "jpeg": 0, "exemplar_low_resolution": 0, "occlusion": 0, "lookalike": 0,
}  # fmt: skip


def test_device_and_host_make_the_same_pairs(packed):
    pairing = {"negative": 0.2, "distractor": 0.2, "patch": 0.3}
    mix, recipe = packed_mix(packed, batch=16, pairing=pairing, augmentation=PLAIN)
    host, device = HostBatches(mix, recipe, 1).batch(3), DeviceBatches(mix, recipe, 1, CPU).batch(3)
    assert torch.equal(host.negative, device.negative)
    assert torch.allclose(host.box, device.box, atol=1e-2)
    for one, other, limit in ((host.exemplar, device.exemplar, 5), (host.search, device.search, 5)):
        apart = (one.float() - other.float()).abs().mean(dim=(1, 2, 3))
        assert apart.max() < limit
        assert apart.mean() < 2.5


def test_patches_go_to_the_device_together(packed, monkeypatch):
    mix, recipe = packed_mix(packed, batch=16, pairing={"negative": 0, "distractor": 0, "patch": 1})
    batches, copies = DeviceBatches(mix, recipe, 0, CPU), []
    copy = resident.to_device
    monkeypatch.setattr(resident, "to_device", lambda array, device: copies.append(array.shape) or copy(array, device))
    batches.batch(0)
    assert sorted(copies) == [(16,), (16,), (16, 4), (32,)]  # flags, which are patches, their boxes, crops


def test_device_batches_of_two_processes_and_stages(packed):
    mix, recipe = packed_mix(packed, batch=4)
    told = []
    batches_for = resident_batches(mix, recipe, CPU, progress=lambda *args: told.append(args))
    assert told[-1] == (15, 15)
    whole = batches_for(0).batch(2)
    assert torch.equal(whole.search, batches_for(0).batch(2).search)
    assert not torch.equal(whole.search, batches_for(1).batch(2).search)
    pool = load_pool(mix, CPU)
    halves = [DeviceBatches(mix, recipe, 0, CPU, rank, 2, pool).batch(2) for rank in (0, 1)]
    assert torch.equal(torch.cat([half.negative for half in halves]), whole.negative)
    assert torch.allclose(torch.cat([half.box for half in halves]), whole.box, atol=1e-3)


def test_the_pool_holds_only_what_may_be_asked_for(packed):
    recipe = packed_recipe(recipe_of(), packed)
    mix = open_mix(recipe.sources, Path("/"), {}, frozenset(["seq1"]))
    pool = load_pool(mix, CPU, crop_px=287)
    assert pool.images.shape == (12, 3, 287, 287)
    assert DeviceBatches(mix, recipe, 0, CPU, pool=pool).batch(0).search.shape == (8, 3, 223, 223)


def test_too_many_crops_for_the_memory(packed, monkeypatch):
    mix, _ = packed_mix(packed)
    monkeypatch.setattr(resident, "free_bytes", lambda device: 10_000_000)
    with pytest.raises(TrainingError, match=r"need 0.0109 GB.*0.01 GB free.*--limit.*--crop-px"):
        load_pool(mix, CPU)


def test_only_packed_sources_can_be_resident():
    with pytest.raises(TrainingError, match="`stills` is not packed"):
        load_pool(drawn_mix(), CPU)
