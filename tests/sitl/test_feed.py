"""From the shutter to the application: latency, jitter, loss, and only the newest picture."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.feed import CameraFeed, Exposure
from sitl.scene import CameraPose

POSE = CameraPose((0.0, 0.0, -10.0), 0.0, 0.0, 0.0)
FPS = 30


def exposure(seq: int, t_s: float, available_s: float) -> Exposure:
    return Exposure(seq, t_s, t_s, available_s, POSE, (0.0, 0.0, -10.0), (0.0, 0.0, 0.0), 0.0)


def filled(feed: CameraFeed, count: int) -> list[float | None]:
    arrivals = []
    for k in range(count):
        seq, arrival_s = feed.next_exposure(k / FPS)
        arrivals.append(arrival_s)
        if arrival_s is not None:
            feed.put(exposure(seq, k / FPS, arrival_s))
    return arrivals


def test_without_jitter_every_picture_is_exactly_late():
    arrivals = filled(CameraFeed(0.06, 0.0, 0.0, 0), 5)
    assert arrivals == pytest.approx([k / FPS + 0.06 for k in range(5)])


def test_only_the_newest_arrived_picture_is_taken_and_only_once():
    feed = CameraFeed(0.06, 0.0, 0.0, 0)
    filled(feed, 10)
    assert feed.newest(0.05) is None
    assert feed.newest(0.06 + 3 / FPS + 1e-6).seq == 3
    assert feed.newest(0.06 + 3 / FPS + 1e-6) is None
    assert feed.newest(10.0).seq == 9
    assert feed.exposed == 10


@given(st.floats(0, 0.2), st.floats(0, 0.1), st.integers(0, 1000))
def test_pictures_are_late_and_never_overtake(latency_s, jitter_s, seed):
    arrivals = [a for a in filled(CameraFeed(latency_s, jitter_s, 0.1, seed), 60) if a is not None]
    assert arrivals == sorted(arrivals)
    exact = [k / FPS + latency_s for k in range(60)]
    lost_none = filled(CameraFeed(latency_s, jitter_s, 0.0, seed), 60)
    assert all(a >= e for a, e in zip(lost_none, exact, strict=True))


def test_the_share_of_lost_pictures_and_the_seed():
    lost = [a is None for a in filled(CameraFeed(0.06, 0.008, 0.2, 7), 2000)]
    assert sum(lost) / len(lost) == pytest.approx(0.2, abs=0.03)
    assert lost == [a is None for a in filled(CameraFeed(0.06, 0.008, 0.2, 7), 2000)]
    assert lost != [a is None for a in filled(CameraFeed(0.06, 0.008, 0.2, 8), 2000)]
