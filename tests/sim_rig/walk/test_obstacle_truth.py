"""Things that stand beside the way, and the truth about what of them is on the path."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sim_rig.walk.legs import Stand
from sim_rig.walk.scenario import Scenario, scenario
from sim_rig.walk.standing_things import POSTS, SHOES, Standing
from sim_rig.walk.things import Block, Thing
from sim_rig.walk.world import WorldBuilder
from sim_rig.wearer import SimulatedWearer

START_NS = 5_000_000_000


def standing(things: tuple[Thing, ...], course_rad: float = 0.0) -> SimulatedWearer:
    world = WorldBuilder().level(8.0, "concrete").build()
    return SimulatedWearer(
        3, Scenario("here", "", world, (Stand(60.0),), things=things, course_rad=course_rad), START_NS
    )


@pytest.mark.parametrize("course_rad", [0.0, 0.15, -0.2])
def test_the_nearest_part_of_a_post_on_the_path_is_told(course_rad: float) -> None:
    post = Standing(((Block((0.08, 0.12, 0.5), "print"), (0.0, 0.0, 0.25)),), first_m=1.2, left_m=0.0)
    wearer = standing((post,), course_rad)
    t_ns = START_NS + 2_000_000_000
    [told] = wearer.obstacles(t_ns)
    eye_m = 1.2 - wearer.terrain(t_ns).x_W_m  # to the post's middle, across the world
    way = wearer.terrain(t_ns).way_m
    half_m = 0.04 * way + 0.06 * math.sqrt(1.0 - way**2)  # of a cuboid met at an angle
    assert told.distance_m == pytest.approx(eye_m * way - half_m, abs=0.03)
    assert told.height_m == pytest.approx(0.5)
    assert (told.stands, told.moves_with_wearer) == (True, False)


def test_what_is_beside_the_path_or_overhead_is_none_of_it() -> None:
    block = Block((0.1, 0.1, 0.4), "print")
    assert standing((Standing(((block, (0.0, 0.0, 0.2)),), first_m=1.2, left_m=0.45),)).obstacles(START_NS) == []
    assert standing((Standing(((block, (0.0, 0.0, 0.8)),), first_m=1.2, left_m=0.0),)).obstacles(START_NS) == []


def test_own_legs_are_said_to_move_with_the_wearer() -> None:
    wearer = SimulatedWearer(3, scenario("own-legs"), START_NS)
    found = [each for k in range(60, 120) for each in wearer.obstacles(START_NS + k * 50_000_000)]
    assert found
    assert all(each.moves_with_wearer and not each.stands and each.distance_m < 0.65 for each in found)


@pytest.mark.parametrize("thing", [POSTS, SHOES])
def test_standing_things_stand_on_the_ground_where_they_were(thing: Standing) -> None:
    wearer = SimulatedWearer(3, replace(scenario("posts"), things=(thing,)), START_NS)
    at_m: dict[int, list[float]] = {}
    for k in range(50, 110):
        t_ns = START_NS + k * 50_000_000
        truth = wearer.terrain(t_ns)
        for each in wearer.obstacles(t_ns):
            if each.distance_m > 0.5:
                x_m = truth.x_W_m + each.distance_m * truth.way_m
                at_m.setdefault(round((x_m - thing.first_m) / thing.every_m), []).append(x_m)
    assert len(at_m) >= 2
    assert all(np.ptp(places) < 0.08 for places in at_m.values())
