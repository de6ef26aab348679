"""One seed of a run, made into independent seeds for each thing that chance decides."""

from __future__ import annotations

import numpy as np

from sitl.scenario.schema import Scenario, Vary

# A target of the same scenario is this much slower or faster: another encounter at each tree, the same story.
SPEED_SHARE = 0.1
# Fixed numbers of the streams: a new one gets a new number, so that the others keep their draws.
_STREAM = {
    Vary.TEXTURE: 1, Vary.LIGHT: 2, Vary.WIND: 3, Vary.NOISE: 4, Vary.CLICK: 5, Vary.SPEED: 6, Vary.COLOUR: 7,
    Vary.PLACE: 8,
}  # fmt: skip


def seed_for(scenario: Scenario, seed: int, what: Vary) -> int:
    """Seed of one thing in a run with `seed` (0 or more): that of seed 0 when `seed_policy` does not list it.

    Raises ValueError for a negative seed.
    """
    if seed < 0:
        raise ValueError(f"seed = {seed}: must be 0 or more")
    used = seed if what in scenario.seed_policy else 0
    return int(np.random.SeedSequence((used, _STREAM[what])).generate_state(1)[0])


def speed_factor(scenario: Scenario, seed: int) -> float:
    """What the target's speed is multiplied by, within 0.9 to 1.1; 1 when the seed may not change the speed."""
    if Vary.SPEED not in scenario.seed_policy:
        return 1.0
    rng = np.random.default_rng(seed_for(scenario, seed, Vary.SPEED))
    return float(rng.uniform(1.0 - SPEED_SHARE, 1.0 + SPEED_SHARE))
