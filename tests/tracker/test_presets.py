from __future__ import annotations

from tracker.box import Box
from tracker.filter import BoxFilter
from tracker.presets import PRESETS, TargetKind


def _coasted_px(kind: TargetKind) -> float:
    """How far the prediction goes in two seconds unseen after a second of steady motion."""
    estimate = BoxFilter(PRESETS[kind].filter)
    estimate.start(Box(100, 100, 40, 40), 0.0)
    for k in range(1, 31):
        estimate.predict(k / 30)
        estimate.update(Box(100 + 2 * k, 100, 40, 40), 1.0)
    estimate.predict(3.0)
    return estimate.box.cx_px - 160


def test_every_kind_has_a_preset_that_the_target_tracker_takes() -> None:
    assert set(PRESETS) == set(TargetKind)
    for preset in PRESETS.values():
        assert preset.target.status.coast_s == preset.coast_s
        assert preset.target.status.coast_still_s == preset.coast_still_s <= preset.coast_s
        assert len(preset.reason) > 10


def test_the_steadier_the_kind_the_further_it_coasts() -> None:
    ways = [_coasted_px(k) for k in (TargetKind.STATIC, TargetKind.PERSON, TargetKind.VEHICLE, TargetKind.BOAT)]
    assert ways == sorted(ways)
    assert ways[0] < 40 < ways[-1]
