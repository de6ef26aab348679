"""What looks alike is tracked beside the target: when it is born, what it claims, when it is forgotten."""

import math
from dataclasses import replace

import pytest

from tests.tracker.scripted import BAD, BOX, SIZE_PX, seen
from tracker.association import Judged, judge_all
from tracker.confidence.model import UNFITTED
from tracker.filter import BoxFilter
from tracker.messages import Candidate
from tracker.rivals import MAX_RIVALS, RivalConfig, RivalTracks

C = RivalConfig()
TARGET = seen(0.8)


class Scene:
    """A still target that is seen all the time, its estimate, and what else there is."""

    def __init__(self) -> None:
        self.rivals, self.estimate = RivalTracks(), BoxFilter()
        self.estimate.start(BOX, 0.0)

    def judge(self, found: list[Candidate], t_s: float) -> list[Judged]:
        self.estimate.predict(t_s)
        self.rivals.predict(t_s)
        return judge_all(found, self.estimate, UNFITTED, None)

    def step(self, others: list[Candidate], t_s: float, sure: bool = True) -> None:
        """One picture with the target and others in it."""
        judged = self.judge([TARGET, *others], t_s)
        chosen = judged[0]
        assert chosen in self.rivals.unclaimed(judged, self.estimate, True)
        self.rivals.step(judged, chosen, sure)
        self.estimate.update(chosen.candidate.box, 0.8)

    def mine(self, found: list[Candidate], t_s: float, locked: bool = True) -> list[Candidate]:
        """What may be the target among candidates of a picture that is not stepped."""
        return [j.candidate for j in self.rivals.unclaimed(self.judge(found, t_s), self.estimate, locked)]


def beside(other: Candidate, seconds: float = 0.5, **how) -> Scene:
    scene = Scene()
    for k in range(1, round(30 * seconds) + 1):
        scene.step([other], k / 30, **how)
    return scene


RIVAL = seen(0.8, 2 * SIZE_PX)


def test_what_was_seen_beside_the_target_is_not_taken_for_it_later():
    scene = beside(RIVAL)
    assert scene.mine([RIVAL], 0.55) == []
    assert scene.mine([RIVAL, TARGET], 0.6) == [TARGET]
    assert Scene().mine([RIVAL], 0.55) == [RIVAL], "one that was never seen beside it could be the target"


def test_a_rival_is_followed_along_its_own_way():
    scene = Scene()
    for k in range(1, 31):
        scene.step([seen(0.8, (3.0 - k / 15) * SIZE_PX)], k / 30)  # comes nearer by 2 sizes per second
    near = seen(0.8, (3.0 - 31 / 15) * SIZE_PX)
    assert scene.mine([near, TARGET], 31 / 30) == [TARGET]
    assert scene.mine([seen(0.8, 3.0 * SIZE_PX)], 31 / 30) == [seen(0.8, 3.0 * SIZE_PX)], "where it is no more"


@pytest.mark.parametrize(
    ("other", "sure"),
    [
        (seen(C.birth_share * 0.8 - 0.01, 2 * SIZE_PX), True),  # not alike
        (seen(0.8, 0.5 * SIZE_PX), True),  # not apart: another box of the target
        (RIVAL, False),  # beside a target that was itself hardly seen
    ],
)
def test_what_is_no_rival(other, sure):
    later = replace(other, score=0.8)
    assert beside(other, sure=sure).mine([later], 0.55) == [later]


@pytest.mark.parametrize(("sizes", "born"), [(0.95, False), (1.05, True)])
def test_a_second_peak_within_a_targets_own_size_is_no_other_thing(sizes, born):
    for direction in ((1.0, 0.0), (0.0, -1.0)):
        other = seen(0.8, *(sizes * SIZE_PX * d for d in direction))
        assert (beside(other).mine([other], 0.55) == []) is born


@pytest.mark.parametrize("fps", [10, 30])
@pytest.mark.parametrize(
    ("seconds", "locked", "shut_out"), [(0.2, True, True), (0.2, False, False), (0.5, False, True)]
)
def test_while_the_target_is_not_seen_only_who_was_long_beside_it_is_shut_out(seconds, locked, shut_out, fps):
    scene = Scene()
    for k in range(1, round(seconds * fps) + 1):
        scene.step([RIVAL], k / fps)
    assert (scene.mine([RIVAL], seconds + 0.05, locked) == []) is shut_out


def test_time_beside_a_target_that_was_hardly_seen_does_not_establish_a_rival():
    scene = beside(RIVAL, 0.1)
    for k in range(4, 25):
        scene.step([RIVAL], k / 30, sure=False)
    assert scene.mine([RIVAL], 0.85, locked=True) == []
    assert scene.mine([RIVAL], 0.85, locked=False) == [RIVAL]


def test_a_rival_is_one_candidate_at_most():
    scene = beside(RIVAL)
    twin = seen(0.8, 2.1 * SIZE_PX)
    assert scene.mine([RIVAL, twin], 0.55) == [twin]
    assert scene.mine([twin, RIVAL], 0.55) == [twin], "that which fits it best, in any order"


def test_where_both_motions_fit_nobody_knows():
    scene = beside(seen(0.8, 1.1 * SIZE_PX))
    between = seen(0.8, 0.55 * SIZE_PX)
    assert scene.mine([between], 0.6) == []


def test_a_rival_unseen_for_long_is_forgotten():
    scene = beside(RIVAL)
    assert scene.mine([RIVAL], 0.5 + C.forget_s) == []
    assert scene.mine([RIVAL], 0.5 + C.forget_s + 0.05) == [RIVAL]


def test_a_new_target_has_no_rivals_yet():
    scene = beside(RIVAL)
    scene.rivals.clear()
    assert scene.mine([RIVAL], 0.55) == [RIVAL]


def test_rivals_move_with_the_picture():
    scene = beside(RIVAL)
    scene.rivals.shift(4 * SIZE_PX, 0.0)
    scene.estimate.shift(4 * SIZE_PX, 0.0)
    moved = replace(RIVAL, box=replace(RIVAL.box, cx_px=RIVAL.box.cx_px + 4 * SIZE_PX))
    assert scene.mine([moved, RIVAL], 0.55) == [RIVAL]


def test_of_a_crowd_only_so_many_are_followed():
    crowd = [seen(0.8, dx * 2 * SIZE_PX, dy * 2 * SIZE_PX) for dx in (-1, 0, 1) for dy in (-1, 1)]
    scene = Scene()
    for k in range(1, 16):
        scene.step(crowd, k / 30)
    assert len(scene.mine(crowd, 0.55)) == len(crowd) - MAX_RIVALS


def test_a_mirrored_picture_has_the_same_rivals():
    def mirrored(c: Candidate) -> Candidate:
        return replace(c, box=replace(c.box, cx_px=2 * BOX.cx_px - c.box.cx_px))

    places = [seen(0.8, d * SIZE_PX) for d in (0.5, 1.0, 1.5, 2.0, 2.5, 4.0)]
    here, there = beside(RIVAL), beside(mirrored(RIVAL))
    for place in places:
        assert bool(here.mine([place], 0.6)) == bool(there.mine([mirrored(place)], 0.6))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("birth_share", 1.5),
        ("keep_appearance", -0.1),
        ("forget_s", math.nan),
        ("clear_ratio", 0.5),
        ("established_s", -1.0),
    ],
)
def test_config_names_field_and_value(field, value):
    with pytest.raises(ValueError, match=rf"rivals {field} is {value}, must lie in"):
        RivalConfig(**{field: value})


@pytest.mark.parametrize("bad", BAD)
def test_a_turn_that_is_not_finite_moves_nothing(bad):
    scene = beside(RIVAL)
    scene.rivals.shift(bad, 0.0)
    assert scene.mine([RIVAL], 0.55) == []
