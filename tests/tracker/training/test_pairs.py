import multiprocessing
import os
import signal
from itertools import islice

import numpy as np
import pytest
import torch

from tracker.box import Box
from tracker.training.errors import TrainingError
from tracker.training.loader import in_order, load
from tracker.training.pairs import Buckets, HostBatches, Picker, patch_box
from tracker.training.recipe import Pairing, Recipe
from tracker.training.sources.mix import Mix
from tracker.training.types import Skipped, Track, View, seed_of

STILL = {"shift_px": 0, "log_scale": 0, "log_aspect": 0, "angle_deg": 0}
STILL |= {f"exemplar_{key}": 0 for key in STILL}


class Drawn:
    """Tracks of noise pictures; `broken` (track, index) cannot be read."""

    def __init__(self, name, tracks, frame_range=50, broken=()):
        self.name, self.tracks, self.frame_range, self.broken = name, tracks, frame_range, set(broken)
        self.skipped = Skipped()
        self.asked = 0

    def view(self, track, index):
        self.asked += 1
        if (track, index) in self.broken:
            return f"{self.name}/{track}/{index}.jpg: cut short"
        rng = np.random.default_rng([track, index])
        image = rng.integers(0, 256, (90, 120, 3)).astype(np.uint8)
        return View(image, Box(60.0 + track, 45.0, 30.0, 20.0), (10.0, 20.0, 30.0))


def video(name, frames=range(0, 200, 4), label=None, group=None):
    return Track(name, tuple(frames), label, group or name)


def mix_of(*sources, shares=None):
    shares = np.ones(len(sources)) if shares is None else np.array(shares, float)
    return Mix(sources, shares / shares.sum())


def recipe_of(batch=8, pairing=None, **jitter):
    stage = {"pairs": 100, "batch": batch, "search_px": 223, "jitter": jitter}
    sources = [{"kind": "folders", "path": "x"}]
    return Recipe.model_validate(
        {"name": "t", "description": "t", "sources": sources, "stages": [stage, stage], "pairing": pairing or {}}
    )


def two_sources():
    stills = Drawn("stills", [Track(f"s{i}", (0,), "car" if i % 2 else "van", f"s/{i // 2}") for i in range(12)], 0)
    videos = Drawn("videos", [video(f"v{i}", label="car") for i in range(3)], 10)
    return mix_of(stills, videos, shares=(3, 1))


def picks(mix, count=4000, **pairing):
    picker, rng = Picker(mix, Pairing(**{"negative": 0, "distractor": 0, "patch": 0} | pairing)), seed_of(7)
    return [picker.pick(rng) for _ in range(count)]


def track_of(mix, pick, search=False):
    source, number = (pick.search_source, pick.search_track) if search else (pick.source, pick.track)
    return mix.sources[source].tracks[number]


def test_positives_keep_shares_tracks_and_frame_range():
    mix = two_sources()
    drawn = picks(mix)
    assert np.mean([p.source == 0 for p in drawn]) == pytest.approx(0.75, abs=0.03)
    counts = np.bincount([p.track for p in drawn if p.source == 0], minlength=12)
    assert counts.min() > 0.7 * counts.mean()
    apart = []
    for p in drawn:
        assert (p.source, p.track) == (p.search_source, p.search_track)
        assert not p.negative
        assert p.patch is None
        frames = track_of(mix, p).frames
        apart.append(frames[p.search_index] - frames[p.exemplar_index])
    assert set(apart) == {-8, -4, 0, 4, 8}


def test_search_frames_follow_numbers_not_places():
    mix = mix_of(Drawn("gaps", [video("g", (0, 1, 500, 501))], 20))
    for p in picks(mix, 200):
        assert (p.exemplar_index < 2) == (p.search_index < 2)


def test_negatives_are_strangers_and_have_their_share():
    mix = two_sources()
    drawn = picks(mix, negative=0.3)
    assert np.mean([p.negative for p in drawn]) == pytest.approx(0.3, abs=0.03)
    for p in drawn:
        assert p.negative == (track_of(mix, p).group != track_of(mix, p, search=True).group)
    assert {(p.source, p.search_source) for p in drawn if p.negative} == {(0, 0), (0, 1), (1, 0), (1, 1)}


def test_distractors_are_of_the_same_class_and_source_but_of_another_picture():
    mix = two_sources()
    drawn = picks(mix, distractor=1.0)
    assert all(p.negative for p in drawn)
    for p in drawn:
        one, other = track_of(mix, p), track_of(mix, p, search=True)
        assert p.source == p.search_source
        assert one.label == other.label
        assert one.group != other.group


@pytest.mark.parametrize("label", [None, "only one of this class"])
def test_without_a_look_alike_a_distractor_is_any_stranger(label):
    mix = mix_of(Drawn("a", [video("a0", label=label), video("a1", label="x"), video("a2", label="x")]))
    drawn = [p for p in picks(mix, 300, distractor=1.0) if p.track == 0]
    assert drawn
    assert all(p.negative and p.search_track in (1, 2) for p in drawn)


def test_where_all_is_one_group_a_pair_stays_positive():
    mix = mix_of(Drawn("a", [video("a0", group="g"), video("a1", group="g")]))
    assert not any(p.negative for p in picks(mix, 50, negative=0.5, distractor=0.5))


def test_patches_lie_inside_and_are_the_target_of_both_crops():
    drawn = picks(two_sources(), 1000, patch=0.2)
    patches = [p for p in drawn if p.patch is not None]
    assert len(patches) / len(drawn) == pytest.approx(0.2, abs=0.04)
    for p in patches:
        assert (p.source, p.track, p.exemplar_index) == (p.search_source, p.search_track, p.search_index)
        x1, y1, x2, y2 = patch_box(p.patch, 120, 90).to_corners()
        assert 0 <= x1 < x2 <= 120
        assert 0 <= y1 < y2 <= 90
    assert len({p.patch for p in patches}) == len(patches)


def test_tracks_by_class():
    kin = Buckets(["x", None, "y", "x"], 4)
    assert [kin.of(i).tolist() for i in range(4)] == [[0, 3], [], [2], [0, 3]]
    assert [kin[i].tolist() for i in range(len(kin))] == [[0, 3], [2]]


def test_a_crowded_picture_counts_as_much_as_one_with_a_single_target():
    crowd = [Track(f"c{i}", (0,), None, "s/crowd") for i in range(9)]
    drawn = picks(mix_of(Drawn("stills", [*crowd, Track("alone", (0,), None, "s/alone")])))
    assert np.mean([p.track == 9 for p in drawn]) == pytest.approx(0.5, abs=0.03)
    counts = np.bincount([p.track for p in drawn if p.track < 9])
    assert counts.min() > 0.7 * counts.mean()


def same(one, other):
    parts = ("exemplar", "search", "box", "negative")
    return all(torch.equal(getattr(one, part), getattr(other, part)) for part in parts)


def test_a_step_is_a_function_of_its_number_alone():
    recipe = recipe_of()
    first = HostBatches(two_sources(), recipe, 0)
    wanted = [first.batch(step) for step in (0, 1, 2)]
    again = HostBatches(two_sources(), recipe, 0)
    assert same(again.batch(2), wanted[2])
    assert same(again.batch(0), wanted[0])
    assert not same(wanted[0], wanted[1])
    assert not same(HostBatches(two_sources(), recipe, 1).batch(0), wanted[0])
    other_seed = recipe.model_copy(update={"seed": 2})
    assert not same(HostBatches(two_sources(), other_seed, 0).batch(0), wanted[0])


def test_picks_of_another_stage_are_others():
    recipe = recipe_of(16, {"negative": 0.5})
    one, other = (HostBatches(two_sources(), recipe, stage).batch(0) for stage in (0, 1))
    assert not torch.equal(one.negative, other.negative)


def test_two_processes_make_the_batch_of_one():
    pairing = {"negative": 0.3, "distractor": 0.2, "patch": 0.2}
    whole = HostBatches(two_sources(), recipe_of(pairing=pairing), 0).batch(5)
    halves = [HostBatches(two_sources(), recipe_of(pairing=pairing), 0, rank, 2).batch(5) for rank in (0, 1)]
    for part in ("exemplar", "search", "box", "negative"):
        assert torch.equal(torch.cat([getattr(half, part) for half in halves]), getattr(whole, part))
    assert whole.negative.any()


def test_a_batch_that_cannot_be_shared_is_an_error():
    with pytest.raises(TrainingError, match="batch 8 cannot be shared by 3 processes"):
        HostBatches(two_sources(), recipe_of(), 0, 0, 3)


def test_shapes_and_the_label_of_an_undisturbed_pair():
    plain = {"negative": 0, "distractor": 0, "patch": 0}
    batch = HostBatches(two_sources(), recipe_of(4, plain, **STILL), 0).batch(0)
    assert batch.exemplar.shape == (4, 3, 127, 127)
    assert batch.search.shape == (4, 3, 223, 223)
    assert batch.exemplar.dtype == batch.search.dtype == torch.uint8
    scale = 127 / np.sqrt((30 + 25) * (20 + 25))
    half = torch.tensor([15.0, 10.0]) * scale
    assert torch.allclose(batch.box, torch.cat([-half, half]).expand(4, 4), atol=1e-3)


def test_a_still_picture_is_read_once():
    source = Drawn("stills", [Track("s", (0,), None, "s")], 0)
    HostBatches(mix_of(source), recipe_of(6, {"patch": 0.5}), 0).batch(0)
    assert source.asked == 6


def test_unreadable_pictures_are_counted_and_drawn_again():
    tracks = [video("v", range(4))]
    source = Drawn("v", tracks, broken=[(0, 0), (0, 1)])
    plain = {"negative": 0, "distractor": 0, "patch": 0}
    batch = HostBatches(mix_of(source), recipe_of(16, plain), 0).batch(0)
    assert batch.skipped.counts["unreadable picture"] > 0
    assert "v/0/0.jpg: cut short" in batch.skipped.named["unreadable picture"]
    assert batch.search.shape[0] == 16


def test_a_source_that_is_gone_is_an_error_with_its_name():
    source = Drawn("gone", [video("v", range(2))], broken=[(0, 0), (0, 1)])
    told = (
        r"source `gone`: 20 picks in a row could not be used, the last: gone/0/\d.jpg: cut short; are its files there"
    )
    with pytest.raises(TrainingError, match=told):
        HostBatches(mix_of(source), recipe_of(), 0).batch(0)
    assert source.asked == 20


def test_loading_by_workers_makes_the_same_batches_in_order():
    batches = HostBatches(two_sources(), recipe_of(2), 0)
    state = torch.get_rng_state()
    made = list(load(batches, 3, 3, workers=2))
    assert torch.equal(torch.get_rng_state(), state)
    assert len(made) == 3
    assert all(same(one, batches.batch(step)) for step, one in enumerate(made, 3))
    assert all(same(one, two) for one, two in zip(made, load(batches, 3, 3, workers=0), strict=True))


def test_faults_of_workers_are_counted_by_the_parent():
    source = Drawn("v", [video("v", range(4))], broken=[(0, 0), (0, 1)])
    made = list(load(HostBatches(mix_of(source), recipe_of(4), 0), 0, 2, workers=1))
    assert sum(one.skipped.counts["unreadable picture"] for one in made) > 0


def deaf(number):
    os.kill(os.getpid(), signal.SIGINT)
    os.kill(os.getpid(), signal.SIGTERM)
    return number, torch.get_num_threads()


def test_workers_outlive_the_signals_of_a_terminal():
    assert list(in_order(deaf, 0, 3, workers=1)) == [(0, 1), (1, 1), (2, 1)]


def leave_a_loader_open():
    made = in_order(int, 0, None, workers=1)
    assert next(made) == 0
    globals()["kept"] = made  # as the traceback of an error keeps it until the interpreter ends


def test_a_process_ends_although_its_workers_were_never_closed():
    process = multiprocessing.get_context("fork").Process(target=leave_a_loader_open)
    process.start()
    process.join(timeout=60)  # by far more than it takes
    code = process.exitcode
    process.kill()
    assert code == 0


def failing(number):
    if number == 2:
        raise TrainingError("source `x`: its files are gone")
    return number


@pytest.mark.parametrize("workers", [0, 1])
def test_an_error_of_a_worker_has_its_own_words(workers):
    made = in_order(failing, 0, None, workers)
    assert [next(made), next(made)] == [0, 1]
    with pytest.raises(TrainingError, match=r"^source `x`: its files are gone$"):
        next(made)


def dying(number):
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def test_a_worker_that_died_is_named():
    with pytest.raises(TrainingError, match=r"DataLoader worker .*fewer than 1 workers"):
        list(in_order(dying, 0, 3, workers=1))


def test_without_a_count_the_steps_do_not_end():
    endless = in_order(int, 5, None, workers=1)
    assert list(islice(endless, 4)) == [5, 6, 7, 8]
    endless.close()
    assert list(islice(in_order(int, 5, None, workers=0), 2)) == [5, 6]


def test_a_fault_does_not_change_the_other_rows():
    plain = {"negative": 0, "distractor": 0, "patch": 0}
    whole = Drawn("v", [video("v", range(8))])
    broken = Drawn("v", whole.tracks, broken=[(0, 3)])
    one, other = (HostBatches(mix_of(s), recipe_of(16, plain), 0).batch(1) for s in (whole, broken))
    differing = [not torch.equal(a, b) for a, b in zip(one.search, other.search, strict=True)]
    assert 0 < sum(differing) <= other.skipped.counts["unreadable picture"]
