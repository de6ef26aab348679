"""What the suite is to reach. A run reaches its aim when it meets the scenario's own criterion for the aim's metric."""

from __future__ import annotations

from dataclasses import dataclass

SEEDS = tuple(range(20))  # those that floors are for
# Shares are of the sources of candidates (run.json); floors are from the first honest run, and may only rise.
PIXELS, GEOMETRY = "pixels", "geometry"


@dataclass(frozen=True, slots=True)
class Aim:
    """`share`: least share of the runs that meet the criterion for `metric`; or `mean`: the greatest mean of it.

    `floors` gate: least share, or greatest mean, by the source of the candidates; without one nothing does.
    """

    scenario: str
    metric: str
    says: str
    share: float | None = None
    mean: float | None = None
    floors: tuple[tuple[str, float], ...] = ()

    def floor(self, source: str) -> float | None:
        """The floor for runs of a source of candidates."""
        return dict(self.floors).get(source)


AIMS = (
    Aim("occlusion_short", "reacquired", "re-acquired after 1.5 s in 95 %", share=0.95),
    Aim("occlusion_long", "reacquired", "re-acquired after 5 s in 80 %", share=0.80),
    Aim("lookalike", "false_confirmed_share", "at most 2 % of pictures false-confirmed", mean=0.02),
    Aim("leaves", "leave_locked_s", "not LOCKED within 0.7 s in 95 %", share=0.95),
    Aim("returns", "reacquired", "re-acquired after 4 s in 80 %", share=0.80),
)
BY_NAME = {aim.scenario: aim for aim in AIMS}
