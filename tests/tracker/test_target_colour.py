"""What is found after a longer absence must have the target's colours too."""

from collections.abc import Sequence

import pytest

from tests.tracker.confidence.candidates import bare, candidate
from tests.tracker.scripted import EPS, evidence, play, reasons, seen, until
from tracker.confidence.reference import Reference
from tracker.likeness import UNKNOWN_COLOUR
from tracker.messages import Candidate, Evidence, TargetReason, TargetStatus
from tracker.target import TargetConfig, TargetTracker

LOCKED = TargetStatus.LOCKED
SHARE = TargetConfig().colour_share
USUAL = 0.9


def found_again(
    back: Evidence, hidden_s: float = 3.0, *, usual: float | None = USUAL, seen_s: float = 2.0, share: float = SHARE
) -> tuple[bool, list[TargetReason]]:
    """Whether it is locked after having been hidden, and the reasons told."""
    first = [seen(of=evidence(colour=usual))]

    def script(t: float) -> Sequence[Candidate]:
        return first if t <= seen_s + EPS else [] if t < seen_s + hidden_s else [seen(0.9, of=back)]

    states = play(script, 6.0, tracker=TargetTracker(TargetConfig(colour_share=share)))
    later = [s for s in states if s.t_s > seen_s + EPS]
    return LOCKED in {s.status for s in later}, reasons(later)


@pytest.mark.parametrize("hidden_s", [0.6, 3.0])
@pytest.mark.parametrize(
    ("back", "taken"),
    [
        (evidence(colour=USUAL), True),
        (evidence(colour=SHARE * USUAL + 0.01), True),
        (evidence(colour=SHARE * USUAL - 0.01), False),
        (evidence(None, recent=None, colour=SHARE * USUAL - 0.01), False),  # though nothing else is known of it
        (evidence(None, recent=None, colour=USUAL), False),  # colour alone is not enough
        (evidence(0.4, colour=1.0), False),
        (evidence(colour=None), True),  # not compared
        (evidence(colour=float("nan")), False),
    ],
)
def test_what_is_found_after_a_longer_absence_must_have_the_targets_colours(back, taken, hidden_s):
    was_locked, told = found_again(back, hidden_s)
    assert was_locked is taken
    alike = back.exemplar is None and back.colour == USUAL
    assert taken or hidden_s < 1.0 or (TargetReason.CONFIRMING if alike else TargetReason.UNLIKE_EXEMPLAR) in told


def test_the_share_is_of_this_targets_own_usual_similarity():
    for usual in (0.6, 1.0):
        assert found_again(evidence(colour=SHARE * usual + 0.01), usual=usual)[0]
        assert not found_again(evidence(colour=SHARE * usual - 0.01), usual=usual)[0]
    assert found_again(evidence(colour=0.5 * USUAL), share=0.45)[0]


def test_a_target_whose_usual_similarity_is_not_known_is_held_to_that_of_most():
    for change, taken in ((0.01, True), (-0.01, False)):
        back = evidence(colour=SHARE * UNKNOWN_COLOUR + change)
        assert found_again(back, usual=None)[0] is taken
        assert found_again(back, usual=1.0, seen_s=0.8)[0] is taken, "not seen for a second"


def test_a_short_absence_asks_nothing():
    assert found_again(evidence(colour=0.1), 0.1)[0]


@pytest.mark.parametrize("exemplar", [0.9, None])
def test_what_has_other_colours_or_was_not_compared_is_not_remembered(exemplar):
    """Else one wrong picture opens the colours to all that look like it."""

    def kept(later: Evidence) -> list[float]:
        states = play(until(2, [seen(0.95, of=evidence(colour=USUAL))], [seen(0.95, of=later)]), 6.0)
        assert all(s.status is LOCKED for s in states if s.t_s > 1), "else it proves nothing"
        return [s.t_s for s in states if s.memory is not None and s.t_s > 2 + EPS]

    assert (kept(evidence(exemplar, colour=USUAL)) == []) is (exemplar is None)
    assert kept(evidence(exemplar, colour=0.15)) == []


def test_the_reference_is_the_mean_over_the_first_second_and_then_stays():
    reference = Reference()
    for k in range(11):
        assert reference.colour is None
        reference.add(candidate(colour={3: 0.7, 5: 0.9, 6: float("nan")}.get(k)), k / 10)
    reference.add(bare(0.9), 1.1)
    reference.add(candidate(colour=0.1), 1.2)
    assert reference.colour == pytest.approx(0.8)
    reference.clear()
    assert reference.colour is None
    for k in range(11):
        reference.add(candidate(), k / 10)
    assert reference.ready
    assert reference.colour is None, "never compared"


@pytest.mark.parametrize("value", [-0.1, 1.1, float("nan")])
def test_the_share_lies_between_0_and_1(value):
    with pytest.raises(ValueError, match="target colour_share is"):
        TargetConfig(colour_share=value)
