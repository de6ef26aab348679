from __future__ import annotations

from dataclasses import replace

import pytest

from sitl.metrics.occlusions import occlusion_metrics, occlusions
from sitl.metrics.sample import Sample
from tests.sitl.metrics.samples import DT_S, FAR_BOX, HIDDEN, TRUTH, run


def hidden(first: int, last: int, unlocked: int, found: int, i: int, s: Sample) -> Sample:
    """Hidden in [first, last), not LOCKED in [unlocked, found)."""
    if first <= i < last:
        s = replace(s, truth=HIDDEN)
    return replace(s, status="COASTING") if unlocked <= i < found else s


def test_no_occlusion() -> None:
    assert occlusion_metrics(run(90)) == {
        "occlusion_longest_survived_s": None,
        "reacquire_median_s": None,
        "declare_loss_median_s": None,
    }


def test_one_occlusion_that_is_survived() -> None:
    found = occlusion_metrics(run(150, lambda i, s: hidden(30, 60, 33, 66, i, s)))
    assert found["occlusion_longest_survived_s"] == pytest.approx(30 * DT_S)
    assert found["declare_loss_median_s"] == pytest.approx(3 * DT_S)
    assert found["reacquire_median_s"] == pytest.approx(6 * DT_S)


def test_found_again_too_late_is_not_survived() -> None:
    found = occlusion_metrics(run(200, lambda i, s: hidden(30, 60, 30, 60 + 61, i, s)))
    assert found["occlusion_longest_survived_s"] == 0.0
    assert found["reacquire_median_s"] == pytest.approx(61 * DT_S)


def test_never_found_again_and_never_declared() -> None:
    lost = occlusion_metrics(run(150, lambda i, s: hidden(30, 60, 30, 999, i, s)))
    assert lost["occlusion_longest_survived_s"] == 0.0
    assert lost["reacquire_median_s"] is None
    blind = occlusion_metrics(run(150, lambda i, s: hidden(30, 60, 999, 999, i, s)))
    assert blind["declare_loss_median_s"] is None
    assert blind["reacquire_median_s"] is None


def test_a_lock_on_something_else_is_not_found_again() -> None:
    def change(i: int, s: Sample) -> Sample:
        s = hidden(30, 60, 33, 60, i, s)
        return replace(s, box=FAR_BOX) if i >= 60 else s

    assert occlusion_metrics(run(150, change))["occlusion_longest_survived_s"] == 0.0


def test_the_median_of_three_and_the_longest_survived() -> None:
    def change(i: int, s: Sample) -> Sample:
        for first, last, unlocked, until in ((20, 30, 21, 32), (60, 90, 65, 91), (120, 160, 122, 400)):
            s = hidden(first, last, unlocked, until, i, s) if first <= i < max(last, until) else s
        return s

    found = occlusion_metrics(run(300, change))
    assert found["occlusion_longest_survived_s"] == pytest.approx(30 * DT_S)
    assert found["declare_loss_median_s"] == pytest.approx(2 * DT_S)
    assert found["reacquire_median_s"] == pytest.approx(2 * DT_S)  # of 2, 1 and never


def test_flickers_unfinished_ones_and_those_before_the_first_lock_do_not_count() -> None:
    assert occlusions(run(90, lambda i, s: hidden(30, 32, 30, 32, i, s))) == ()
    assert len(occlusions(run(90, lambda i, s: hidden(30, 33, 30, 33, i, s)))) == 1
    assert occlusions(run(90, lambda i, s: hidden(30, 99, 30, 99, i, s))) == ()
    early = run(90, lambda i, s: replace(s, status="ACQUIRING", truth=HIDDEN) if i < 30 else s)
    assert occlusions(early) == ()


def test_partly_visible_is_not_hidden() -> None:
    part = replace(TRUTH, visibility=0.1)
    assert occlusions(run(90, lambda i, s: replace(s, truth=part) if 30 <= i < 60 else s)) == ()
    little = replace(TRUTH, visibility=0.09)
    assert len(occlusions(run(90, lambda i, s: replace(s, truth=little) if 30 <= i < 60 else s))) == 1


def test_black_pictures_hide_the_target() -> None:
    (one,) = occlusions(run(90, lambda i, s: replace(s, truth=None, status="SEARCHING") if 30 <= i < 60 else s))
    assert one.duration_s == pytest.approx(1.0)
    assert one.survived


def test_found_only_after_the_next_occlusion_is_not_found_after_this_one() -> None:
    def change(i: int, s: Sample) -> Sample:
        return hidden(30, 45, 30, 75, i, hidden(60, 70, 30, 75, i, s))

    first, second = occlusions(run(150, change))
    assert first.found_s is None
    assert not first.survived
    assert second.found_s == pytest.approx(75 * DT_S)
