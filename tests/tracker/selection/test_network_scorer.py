from __future__ import annotations

import pytest

from tests.tracker.selection.scenes import with_car
from tracker.box import Box
from tracker.messages import Candidate, Evidence, Frame, ImageU8, SearchHint
from tracker.selection import SelfConsistency, propose
from tracker.selection.network import CONSISTENCY, FULL_SHARPNESS, SHARPNESS, SUPPORT
from tracker.selection.ranking import Proposal, Reason, rejudged

CAR = Box(150.0, 118.0, 44, 22)


class OneThing:
    """A tracker that always finds the car, and says in its evidence how it differs from what it searched for."""

    def __init__(self, with_evidence: bool) -> None:
        self.calls: list[Box] = []
        self.hints: list[SearchHint | None] = []
        self._with_evidence = with_evidence

    def init(self, frame: Frame, box: Box) -> None:
        if box.w_px < 4:
            raise ValueError("too small")
        self.calls.append(box)

    def update(self, frame: Frame, hint: SearchHint | None = None) -> tuple[Candidate, ...]:
        import math

        self.hints.append(hint)
        had = self.calls[-1]
        if not self._with_evidence:
            return (Candidate(CAR, 0.9, 1.0, 0.9),)
        scale = 0.5 * math.log(CAR.w_px * CAR.h_px / (had.w_px * had.h_px))
        aspect = math.log(CAR.w_px / CAR.h_px) - math.log(had.w_px / had.h_px)
        evidence = Evidence((0.9, 0.9, 0.9), 0.0, 8.0, None, None, scale, aspect)
        smoothed = Box(CAR.cx_px, CAR.cy_px, had.w_px, had.h_px)  # what trackers report: nearly the size searched with
        return (Candidate(smoothed, 0.9, 1.0, 0.9, evidence),)


def _image() -> ImageU8:
    return with_car(CAR)


def test_the_box_that_finds_itself_is_best_with_and_without_evidence() -> None:
    boxes = [Box(150, 118, 90, 60), CAR, Box(140, 118, 20, 20)]
    for with_evidence in (False, True):
        scores = SelfConsistency(lambda e=with_evidence: OneThing(e)).score(_image(), boxes)
        assert scores[1] is not None
        assert scores[1] > 0.65
        assert all(s is not None and s < 0.4 for s in (scores[0], scores[2]))


def test_the_search_is_not_centred_on_the_box() -> None:
    tracker = OneThing(False)
    SelfConsistency(lambda: tracker).score(_image(), [CAR])
    assert tracker.hints[0] is not None
    assert tracker.hints[0].center_px != (CAR.cx_px, CAR.cy_px)


def test_at_most_so_many_boxes_are_judged() -> None:
    tracker = OneThing(False)
    scores = SelfConsistency(lambda: tracker, max_boxes=2).score(_image(), [CAR, CAR, CAR])
    assert len(tracker.calls) == 2
    assert scores[2] is None


def test_a_box_that_the_tracker_refuses_is_not_judged() -> None:
    assert SelfConsistency(lambda: OneThing(False)).score(_image(), [Box(150, 118, 3, 9), CAR])[0] is None


def test_a_scorer_reorders_proposals_and_leaves_the_unjudged() -> None:
    class Says:
        def score(self, image_bgr_u8: ImageU8, boxes: object) -> tuple[float | None, ...]:
            return (0.0, 1.0, None)

    given = [Proposal(Box(50 * k + 40, 100, 20, 20), 0.5 - 0.01 * k, Reason.OUTLINE) for k in range(3)]
    found = rejudged(_image(), given, Says())
    assert [given.index(next(g for g in given if g.box == p.box)) for p in found] == [1, 0, 2]
    assert found[0].score > 0.8 > found[1].score > found[2].score


def test_the_box_that_the_exemplars_of_others_find_gains() -> None:
    class Finds:
        """Every exemplar finds the car, but a part finds itself with the same score."""

        def __init__(self, agree: bool) -> None:
            self._agree = agree

        def init(self, frame: Frame, box: Box) -> None:
            self._box = box

        def update(self, frame: Frame, hint: SearchHint | None = None) -> tuple[Candidate, ...]:
            return (Candidate(CAR if self._agree else self._box, 0.9, 1.0, 0.9),)

    boxes = [CAR, Box(150, 118, 20, 22), Box(165, 118, 14, 22)]
    alone = SelfConsistency(lambda: Finds(False)).score(_image(), boxes)
    together = SelfConsistency(lambda: Finds(True)).score(_image(), boxes)
    assert together[0] == pytest.approx(CONSISTENCY * 0.9 + SUPPORT)
    assert alone[0] == pytest.approx(CONSISTENCY * 0.9 + SUPPORT * sum(CAR.iou(b) for b in boxes[1:]) / 2)


@pytest.mark.parametrize("sharpness", [-5.0, 0.0, 50.0, 1e9])
def test_a_sharp_response_speaks_for_a_box_within_limits(sharpness: float) -> None:
    class Sharp:
        def init(self, frame: Frame, box: Box) -> None:
            pass

        def update(self, frame: Frame, hint: SearchHint | None = None) -> tuple[Candidate, ...]:
            return (Candidate(CAR, 0.9, 1.0, 0.9, Evidence((0.9,), 0.0, sharpness, None, None, 0.0, 0.0)),)

    value = SelfConsistency(Sharp).score(_image(), [CAR])[0]
    assert value == pytest.approx(CONSISTENCY * 0.9 + SHARPNESS * min(max(sharpness / FULL_SHARPNESS, 0.0), 1.0))


def test_a_tracker_that_finds_nothing_gives_nought() -> None:
    class Blind:
        def init(self, frame: Frame, box: Box) -> None:
            pass

        def update(self, frame: Frame, hint: SearchHint | None = None) -> tuple[Candidate, ...]:
            return ()

    assert SelfConsistency(Blind).score(_image(), [CAR, CAR]) == (0.0, 0.0)


def test_propose_asks_the_scorer() -> None:
    tracker = OneThing(False)
    found = propose(_image(), (150.0, 118.0), SelfConsistency(lambda: tracker))
    assert 1 <= len(tracker.calls) <= 6
    assert found[0].box.iou(CAR) > 0.5


def test_size_and_shape_that_the_network_saw_are_both_undone() -> None:
    # The car has the area and the place of this box, but another shape.
    other = Box(CAR.cx_px, CAR.cy_px, 22, 44)
    with_evidence = SelfConsistency(lambda: OneThing(True)).score(_image(), [other])[0]
    without = SelfConsistency(lambda: OneThing(False)).score(_image(), [other])[0]
    assert without is not None
    assert with_evidence == pytest.approx(without + SHARPNESS * 8.0 / FULL_SHARPNESS)
    assert without == pytest.approx(CONSISTENCY * 0.9 * other.iou(CAR))
