"""What the tracker carries from frame to frame: place, size over time, memory; and how often it calls the network."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.siamapnpp.maps import SETTINGS, maps_with
from tracker.box import Box
from tracker.messages import Frame, MemorySlot, RemembersExemplars, SearchHint, SearchTile
from tracker.siamapnpp.decode import ResponseMaps
from tracker.siamapnpp.settings import TrackerSettings
from tracker.siamapnpp.tracker import SiamAPNTracker

START = Box(300.0, 200.0, 40.0, 40.0)
CENTRE = {(10, 10): 6.0}


class ScriptedEngine:
    """Answers searches with given maps in turn (the last one for ever); an exemplar's features are its mean colour."""

    name = "scripted"

    def __init__(self, *maps: ResponseMaps) -> None:
        self.maps = list(maps)
        self.searched: list[np.ndarray] = []
        self.embedded = 0

    def set_exemplar(self, crop_bgr_u8: np.ndarray) -> np.ndarray:
        return self._features(crop_bgr_u8, 6)

    def embed(self, crop_bgr_u8: np.ndarray) -> np.ndarray:
        self.embedded += 1
        return self._features(crop_bgr_u8, 6)

    def search(self, crop_bgr_u8: np.ndarray) -> ResponseMaps:
        self.searched.append(crop_bgr_u8)
        maps = self.maps.pop(0) if len(self.maps) > 1 else self.maps[0]
        return replace(maps, features=self._features(crop_bgr_u8, maps.cls1.shape[-1] + 5))

    @staticmethod
    def _features(crop: np.ndarray, cells: int) -> np.ndarray:
        colour = crop.mean(axis=(0, 1)).astype(np.float32)
        return np.broadcast_to(colour[:, None, None], (3, cells, cells))


def _frame(colour: tuple[int, int, int] = (90, 90, 90), t_s: float = 0.0) -> Frame:
    return Frame(np.full((480, 640, 3), colour, np.uint8), 0, t_s, t_s)


def _tracker(*maps: ResponseMaps, settings: TrackerSettings = SETTINGS) -> tuple[SiamAPNTracker, ScriptedEngine]:
    engine = ScriptedEngine(*maps)
    tracker = SiamAPNTracker(engine, settings)
    tracker.init(_frame(), START)
    return tracker, engine


def _hint(**more: object) -> SearchHint:
    return SearchHint((300.0, 200.0), (1, 0, 1), **more)  # type: ignore[arg-type]


def _evidence_of(
    tracker: SiamAPNTracker, frame: Frame, hint: SearchHint | None = None
) -> tuple[float | None, float | None]:
    evidence = tracker.update(frame, hint)[0].evidence
    assert evidence is not None
    return evidence.exemplar, evidence.recent


def test_likeness_to_the_first_exemplar_and_to_what_was_remembered() -> None:
    tracker, engine = _tracker(maps_with(CENTRE))
    assert isinstance(tracker, RemembersExemplars)
    blue = _frame((200, 0, 0))
    assert _evidence_of(tracker, _frame()) == (pytest.approx(1.0), None)
    assert _evidence_of(tracker, blue) == (pytest.approx(3**-0.5), None)
    tracker.remember(blue, START, MemorySlot.RECENT)
    assert _evidence_of(tracker, blue) == (pytest.approx(3**-0.5), pytest.approx(1.0))
    tracker.remember(_frame((0, 200, 0)), START, MemorySlot.ANCHOR)
    tracker.remember(_frame((0, 0, 200)), START, MemorySlot.RECENT)
    assert _evidence_of(tracker, blue) == (pytest.approx(3**-0.5), pytest.approx(0.0))
    assert _evidence_of(tracker, _frame()) == (pytest.approx(1.0), pytest.approx(3**-0.5))
    assert engine.embedded == 3  # for what was remembered; a search shows the looks of its places by itself


def test_a_wide_window_costs_one_small_call_per_look() -> None:
    rivals = maps_with({(10, 10): 6.0, (10, 19): 5.0})
    for looks in (0, 1, 2):
        tracker, engine = _tracker(rivals, settings=replace(SETTINGS, embed_candidates=looks))
        found = tracker.update(_frame(), _hint(scale=2.0))
        assert engine.embedded == looks
        known = [c.evidence is not None and c.evidence.exemplar is not None for c in found]
        assert known == [k < looks for k in range(len(found))]


def test_an_engine_without_features_is_never_asked_for_looks() -> None:
    class Plain(ScriptedEngine):
        def set_exemplar(self, crop_bgr_u8: np.ndarray) -> None:  # type: ignore[override]
            return None

        def search(self, crop_bgr_u8: np.ndarray) -> ResponseMaps:
            return self.maps[0]

    engine = Plain(maps_with(CENTRE))
    tracker = SiamAPNTracker(engine, SETTINGS)
    tracker.init(_frame(), START)
    assert _evidence_of(tracker, _frame(), _hint(scale=2.0)) == (None, None)
    assert engine.embedded == 0


def test_remembering_needs_a_target_and_a_usable_box() -> None:
    tracker = SiamAPNTracker(ScriptedEngine(maps_with(CENTRE)), SETTINGS)
    with pytest.raises(RuntimeError, match="before init"):
        tracker.remember(_frame(), START, MemorySlot.RECENT)
    tracker.init(_frame(), START)
    with pytest.raises(ValueError, match="outside"):
        tracker.remember(_frame(), Box(5.0, 5.0, 40.0, 40.0), MemorySlot.RECENT)
    with pytest.raises(ValueError, match="finite"):
        tracker.remember(_frame(), Box(float("nan"), 5.0, 40.0, 40.0), MemorySlot.RECENT)


def test_a_new_target_forgets_the_old_ones_looks() -> None:
    tracker, _ = _tracker(maps_with(CENTRE))
    tracker.remember(_frame(), START, MemorySlot.RECENT)
    tracker.init(_frame((200, 0, 0)), START)
    assert _evidence_of(tracker, _frame((200, 0, 0))) == (pytest.approx(1.0), None)


def test_candidates_of_all_windows_come_best_first_with_their_scale() -> None:
    tracker, engine = _tracker(maps_with({(10, 10): 1.0}), maps_with({(10, 10): 5.0}))
    tile = SearchTile((100.0, 400.0), 2.0)
    found = tracker.update(_frame(), _hint(max_calls=2, tiles=(tile,)))
    assert len(engine.searched) == 2
    places = [(c.box.cx_px, c.box.cy_px, c.evidence.search_scale) for c in found[:2] if c.evidence is not None]
    assert places == [pytest.approx((100.0, 400.0, 2.0)), pytest.approx((300.0, 200.0, 1.0))]
    assert found[0].evidence is not None
    assert 0 < found[0].evidence.second < 1


def test_what_a_tile_shows_does_not_move_the_trackers_own_place() -> None:
    tracker, _ = _tracker(maps_with({(10, 10): 1.0}), maps_with({(10, 10): 5.0}), maps_with(CENTRE))
    tracker.update(_frame(), _hint(max_calls=2, tiles=(SearchTile((100.0, 400.0)),)))
    assert tracker.update(_frame())[0].box.cx_px == pytest.approx(300.0)


def test_with_a_hint_the_place_is_the_hints_without_one_the_best_candidates() -> None:
    for hint, expected_px in ((_hint(), 300.0), (None, 300.0 + 64.0 * 80 / 127)):
        tracker, _ = _tracker(maps_with({(10, 18): 8.0}), maps_with(CENTRE))
        tracker.update(_frame(), hint)
        assert tracker.update(_frame())[0].box.cx_px == pytest.approx(expected_px)


def _grown(settings: TrackerSettings, step_s: float) -> float:
    """The share of the way to the size that the network sees, after one picture."""
    tracker, _ = _tracker(maps_with(CENTRE, box_px=95.0), settings=settings)
    width = tracker.update(_frame(t_s=step_s))[0].box.w_px
    return (width - 40.0) / (40.0 * 95.0 / 63.5 - 40.0)


def test_size_follows_by_the_picture_or_by_the_second() -> None:
    by_second = replace(SETTINGS, size_lr_per_s=True)
    official = _grown(SETTINGS, 1 / 30)
    assert 0.2 < official < 0.31
    assert {round(_grown(SETTINGS, step), 9) for step in (1 / 60, 1 / 10, 3.0)} == {round(official, 9)}
    assert _grown(by_second, 1 / 30) == pytest.approx(official)
    assert _grown(by_second, 1 / 10) == pytest.approx(1 - (1 - official) ** 3)
    assert _grown(by_second, 1 / 60) == pytest.approx(1 - (1 - official) ** 0.5)
    assert _grown(by_second, 0.001) == _grown(by_second, 1 / 120) > 0
    assert _grown(by_second, 60.0) == _grown(by_second, 0.5) < 1
    tracker, _ = _tracker(maps_with({}), maps_with(CENTRE, box_px=95.0), settings=by_second)
    tracker.update(_frame(t_s=5.0), _hint())
    late = tracker.update(_frame(t_s=5.0 + 1 / 30), _hint(size_px=(40.0, 40.0)))[0].box.w_px
    assert (late - 40.0) / (40.0 * 95.0 / 63.5 - 40.0) == pytest.approx(official)  # the time is that between pictures


@pytest.mark.parametrize("t_s", [float("nan"), float("inf"), -5.0, 0.0, 1e9])
def test_no_time_stamp_breaks_the_size(t_s: float) -> None:
    tracker, _ = _tracker(maps_with(CENTRE, box_px=95.0), settings=replace(SETTINGS, size_lr_per_s=True))
    assert 40.0 <= tracker.update(_frame(t_s=t_s))[0].box.w_px <= 40.0 * 95 / 63.5 + 1e-6
    assert 40.0 <= tracker.update(_frame(t_s=0.1))[0].box.w_px < 100.0


def test_economy_searches_a_small_crop_when_sure() -> None:
    small, full = maps_with({(6, 8): 6.0}, cells=13), maps_with({(10, 12): 6.0})
    tracker, engine = _tracker(small, full, settings=replace(SETTINGS, economy=True))
    boxes = [tracker.update(_frame(), _hint(sure=sure))[0].box for sure in (True, False)]
    assert [c.shape for c in engine.searched] == [(223, 223, 3), (287, 287, 3)]
    assert boxes[0].cx_px == pytest.approx(boxes[1].cx_px, rel=1e-3)
    assert boxes[0].cx_px == pytest.approx(300.0 + 16 * 80 / 127)
    tracker, engine = _tracker(full)
    tracker.update(_frame(), _hint(sure=True))
    assert engine.searched[0].shape == (287, 287, 3)
