"""`--realtime`: the run is held back to the wall clock, and never hurried after it."""

from __future__ import annotations

import pytest

from uavfollow.sim import session


class Wall:
    """A wall clock that sleeping moves."""

    def __init__(self) -> None:
        self.now_s = 500.0
        self.slept_s = 0.0

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        assert seconds > 0
        self.now_s += seconds
        self.slept_s += seconds


@pytest.fixture
def wall(monkeypatch):
    made = Wall()
    monkeypatch.setattr(session, "time", made)
    return made


def test_simulated_time_keeps_step_with_the_wall(wall):
    pacer = session.Pacer()
    for k in range(1000):
        wall.now_s += 0.001  # what the step itself takes
        pacer.wait(k * 0.005)
        assert wall.now_s - 500.001 == pytest.approx(k * 0.005)


def test_a_slow_run_is_not_held(wall):
    pacer = session.Pacer()
    for k in range(100):
        wall.now_s += 0.02
        pacer.wait(k * 0.005)
    assert wall.slept_s == 0.0


def test_after_a_long_halt_it_does_not_hurry(wall):
    pacer = session.Pacer()
    pacer.wait(0.0)
    wall.now_s += 60.0
    pacer.wait(0.005)
    before_s = wall.now_s
    pacer.wait(1.005)
    assert wall.now_s - before_s == pytest.approx(1.0)
