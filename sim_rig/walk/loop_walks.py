"""Walks for a prosthesis in the loop, drawn from a seed: level, a ramp up and one down, stairs up, straight on.

Every walk is over before its lap ends; a ramp far behind closes the lap. Light, surfaces and pace are drawn as well.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from sim_rig.walk.gait import Habits
from sim_rig.walk.scenario import Pace, Scenario
from sim_rig.walk.terrain_walks import (
    GROUNDS,
    RISERS,
    RUN_UP_GRID_M,
    RUN_UPS,
    close_lap,
    legs_over_flight,
    passes_s,
    steps_on_every_tread,
)
from sim_rig.walk.world import World, WorldBuilder

BEYOND_M: Final = 2.0
"""Walked beyond the stairs."""


@dataclass(frozen=True)
class LoopWalk:
    """One drawn walk of `seconds`; of the ramp up `ramp_m` is where it begins and where it ends."""

    seed: int
    seconds: float
    ramp_m: tuple[float, float]
    scenario: Scenario


def loop_walk(seed: int) -> LoopWalk:
    """Return the walk that `seed` draws."""
    chance = np.random.default_rng([seed, 33])
    speed_mps = float(chance.uniform(0.8, 1.4))
    pace = Pace(speed_mps, float((0.95 + 0.7 * speed_mps) * chance.uniform(0.96, 1.04)))
    drawn = _Drawn(chance)
    for attempt in range(RUN_UPS):
        world, marks_m = drawn.world(attempt * RUN_UP_GRID_M)
        scenario = Scenario(
            name=f"loop-{seed}",
            description=f"level, a ramp up and one down, stairs up, drawn by seed {seed}",
            world=world,
            legs=legs_over_flight(marks_m[2], marks_m[3], world.length_m, pace, drawn.tread_m, drawn.stairs_hz),
            hip_height_m=drawn.camera_m,
            habits=Habits(step_scatter_s=0.015),
            contrast=drawn.contrast,
        )
        if steps_on_every_tread(scenario, seed):
            break
    return LoopWalk(seed, passes_s(scenario, seed, marks_m[3] + BEYOND_M), (marks_m[0], marks_m[1]), scenario)


class _Drawn:
    """The dimensions of one walk."""

    def __init__(self, chance: np.random.Generator) -> None:
        self._up_deg, self._down_deg = (float(each) for each in chance.uniform(4.0, 10.0, 2))
        self._ramps_m = [float(each) for each in chance.uniform(3.0, 4.5, 2)]
        self._levels_m = [float(each) for each in chance.uniform(2.5, 3.5, 3)]
        self._rise_m, self._count = float(chance.uniform(0.13, 0.18)), int(chance.integers(5, 7))
        self._surfaces = [str(each) for each in chance.choice(GROUNDS, 5)]
        self._riser = str(chance.choice(RISERS))
        self.tread_m, self.stairs_hz = float(chance.uniform(0.27, 0.32)), float(chance.uniform(1.3, 1.7))
        self.camera_m, self.contrast = float(chance.uniform(0.85, 1.0)), float(chance.uniform(0.5, 1.0))

    def world(self, further_m: float) -> tuple[World, list[float]]:
        """Return the world, and where ramp up, its end, stairs and their end are; stairs begin `further_m` later."""
        plain, first, top, last, tread = self._surfaces
        ground = WorldBuilder().level(self._levels_m[0], plain)
        ground.ramp(self._ramps_m[0], self._up_deg, first)
        marks_m = [self._levels_m[0], ground.x_m]
        ground.level(self._levels_m[1], top).ramp(self._ramps_m[1], -self._down_deg, last)
        ground.level(self._levels_m[2] + further_m, plain)
        marks_m.append(ground.x_m)
        ground.stairs(self._count, self._rise_m, self.tread_m, self._riser, tread)
        marks_m.append(ground.x_m)
        close_lap(ground, plain)
        return ground.build(), marks_m
