"""The judge of a prosthesis, and those who tell it the ground: the truth, and its own foot a step late."""

import math

import numpy as np
import pytest

from impedance.modulation.table import published
from lab.prosthesis.controls import InertialSlope, OfGround, ToldByTruth, true_kind
from lab.prosthesis.judge import JudgedProsthesis, JudgedStep
from messages import Side, TerrainKind
from sim_rig.prosthesis.profile import Profile
from sim_rig.prosthesis.prosthesis import VirtualProsthesis
from sim_rig.walk.footholds import Foothold, Footholds
from sim_rig.walk.legs import Stand
from sim_rig.walk.scenario import Pace, Scenario
from sim_rig.walk.world import WorldBuilder

START_NS = 5_000_000_000
MASS_KG = 70.0
RAMP_DEG = 7.0
WORLD = WorldBuilder().level(2.2, "wood").ramp(2.6, RAMP_DEG, "wood").ramp(2.6, -RAMP_DEG, "wood").build()
WALK = Scenario("hill", "a hill", WORLD, (Stand(0.4), Pace(1.2, 1.8).to(WORLD.length_m), Stand(0.5)))


def judged(controls: ToldByTruth | InertialSlope) -> list[JudgedStep]:
    gait = WALK.gait(4, START_NS)
    footholds = Footholds(WORLD, gait, 4)
    prosthesis = VirtualProsthesis(WALK, gait, footholds, controls, side=Side.RIGHT, mass_kg=MASS_KG, seed=4)
    controls.watch(prosthesis)
    judge = JudgedProsthesis(prosthesis, OfGround(MASS_KG))
    judge.advance_to(START_NS + 6_200_000_000)
    return judge.steps()


@pytest.fixture(scope="module")
def by_foot() -> list[JudgedStep]:
    return judged(InertialSlope(OfGround(MASS_KG), 4))


def test_who_is_told_the_truth_makes_no_error() -> None:
    steps = judged(ToldByTruth(OfGround(MASS_KG)))
    assert len(steps) >= 4
    assert max(step.error_nm_per_kg for step in steps) < 1e-9
    assert not any(step.unsafe for step in steps)


def test_a_foot_is_wrong_on_the_first_step_after_a_change_and_right_on_the_next(by_foot: list[JudgedStep]) -> None:
    first = [step.error_nm_per_kg for step in by_foot if step.since_change == 1]
    later = [step.error_nm_per_kg for step in by_foot if step.since_change == 2]
    assert len(first) == 2
    assert min(first) > 0.15
    assert max(later) < 0.4 * min(first)


def test_steps_are_counted_from_each_change(by_foot: list[JudgedStep]) -> None:
    ramp = [step.since_change for step in by_foot if step.slope_deg > 1.0]
    assert ramp == list(range(1, len(ramp) + 1))
    assert [step.since_change for step in by_foot if step.kind == "level"] == [0] * sum(
        step.kind == "level" for step in by_foot
    )
    assert [step.is_new for step in by_foot if step.since_change == 3] == [False] * sum(
        step.since_change == 3 for step in by_foot
    )


def test_stairs_and_what_is_too_steep_are_walked_as_level_ground() -> None:
    of_ground, level = OfGround(MASS_KG), published().level(MASS_KG).points
    for slope_rad, kind in ((0.0, TerrainKind.STAIRS_UP), (math.radians(20.0), TerrainKind.RAMP_UP)):
        assert np.array_equal(of_ground.curve(slope_rad, kind).points, level)
    assert not np.array_equal(of_ground.curve(math.radians(5.0), TerrainKind.RAMP_UP).points, level)


def test_kinds_of_ground_are_told_apart() -> None:
    flight = WorldBuilder().level(2.0, "wood").stairs(2, 0.16, 0.3, "wood", "wood").level(1.0, "wood")
    flight.stairs(2, -0.16, 0.3, "wood", "wood").level(1.0, "wood")
    ground = Profile(flight.build())

    def kind(x_m: float, slope_rad: float, name: str) -> TerrainKind:
        return true_kind(ground, Foothold(0, np.array((x_m, 0.0, ground.height_m(x_m))), True, slope_rad, name))

    assert kind(2.15, 0.0, "stairs") is TerrainKind.STAIRS_UP
    assert kind(3.45, 0.0, "stairs") is TerrainKind.STAIRS_DOWN
    assert kind(1.0, 0.0, "level") is TerrainKind.LEVEL
    assert kind(1.0, -0.1, "ramp") is TerrainKind.RAMP_DOWN
