"""Walks drawn from a seed are what they say, and such as a person walks."""

import dataclasses
import math
from collections import Counter

import numpy as np
import pytest

from sim_rig.walk.terrain_walks import CASES, LEAST_S, STANDING_S, steps_on_every_tread, terrain_walk
from sim_rig.walk.world import WorldBuilder

BLOCK = tuple(range(1, 2 * len(CASES)))
WALKS = {seed: terrain_walk(seed) for seed in BLOCK}


def test_every_block_of_seeds_holds_each_case_as_often() -> None:
    drawn = Counter(terrain_walk(seed).case for seed in range(5000, 5000 + len(CASES)))
    assert drawn == Counter(CASES)


@pytest.mark.parametrize("seed", BLOCK[:6])
def test_a_seed_draws_the_same_walk_again(seed: int) -> None:
    assert terrain_walk(seed) == WALKS[seed]
    assert terrain_walk(seed).scenario.world != terrain_walk(seed + 1).scenario.world


@pytest.mark.parametrize("seed", BLOCK)
def test_dimensions_are_within_what_is_built(seed: int) -> None:
    walk = WALKS[seed]
    assert walk.seconds >= LEAST_S
    assert 0.8 <= walk.scenario.hip_height_m <= 1.0
    assert abs(walk.scenario.course_rad) <= math.radians(35.0)
    world, sign = walk.scenario.world, 1.0 if walk.case.endswith("up") or walk.case == "below-stairs" else -1.0
    risers = [piece for piece in world.lap if piece.is_riser]
    for riser in risers:
        assert 0.0 <= riser.x0_m - riser.x1_m <= 0.025
        low = 0.06 if "kerb" in walk.case else 0.12
        assert low <= sign * (riser.z1_m - riser.z0_m) <= 0.20
    if "stairs" in walk.case:
        treads = np.diff([riser.lip_x_m for riser in risers])
        assert treads.min() >= 0.24 - 1e-9
        assert min(treads) <= 0.36
        assert len(risers) >= 3
    else:
        assert len(risers) == (walk.case.startswith(("kerb", "step")))
    assert (world.relief is not None) == (walk.case == "rough")


@pytest.mark.parametrize("seed", [s for s in BLOCK if WALKS[s].case in ("stairs-up", "stairs-down")])
def test_on_stairs_one_foot_lands_on_each_tread(seed: int) -> None:
    assert steps_on_every_tread(WALKS[seed].scenario, seed)


def test_a_step_that_leaves_a_tread_out_is_noticed() -> None:
    seed = next(s for s in BLOCK if WALKS[s].case == "stairs-up")
    walk = WALKS[seed].scenario
    pieces = [p for p in walk.world.lap if p.kind != "stairs" or p.is_riser]
    assert pieces
    start_m = next(p.x0_m for p in walk.world.lap if p.is_riser)
    narrow = WorldBuilder().level(start_m, "concrete").stairs(6, 0.15, 0.12, "wood", "wood").level(4.0, "wood")
    narrow.ramp(9.0, math.degrees(math.atan(-0.1)), "wood").level(4.0, "wood")
    assert not steps_on_every_tread(dataclasses.replace(walk, world=narrow.build()), seed)


@pytest.mark.parametrize("seed", BLOCK)
def test_the_wearer_stands_then_walks_over_the_change_and_on_before_the_lap_ends(seed: int) -> None:
    walk = WALKS[seed]
    gait = walk.scenario.gait(seed, 0)
    t_ns = (1e9 * np.arange(0.0, walk.seconds, 0.05)).astype(np.int64)
    motion = gait.at(t_ns)
    x_m, standing = motion.p_WB_m[:, 0], motion.standing
    if walk.case in ("above-stairs", "below-stairs"):
        assert standing.all()
        lip_m = next(piece.lip_x_m for piece in walk.scenario.world.lap if piece.is_riser)
        assert 0.5 <= lip_m / math.cos(walk.scenario.course_rad) <= 1.3
        return
    assert standing[t_ns < 0.95e9 * STANDING_S].all()
    assert not standing[t_ns > 1.2e9 * STANDING_S].any()
    assert walk.seconds < gait.lap_s
    begins_m = next((piece.x0_m for piece in walk.scenario.world.lap if piece.kind != "level"), 2.0)
    assert x_m[-1] > begins_m + 0.5
    heading = np.arctan2(motion.v_WB_mps[:, 1].mean(), motion.v_WB_mps[:, 0].mean())
    assert heading == pytest.approx(walk.scenario.course_rad, abs=0.03)
