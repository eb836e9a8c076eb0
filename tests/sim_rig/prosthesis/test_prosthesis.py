"""A prosthesis that walks: where it stands, what it bears, what it tells, and that nothing but the walk decides it."""

import math

import numpy as np
import pytest

from impedance.modulation.curve import Impedance
from messages import GaitPhase, Side, UserError
from messages.constants import STANDARD_GRAVITY_MPS2
from sim_rig.prosthesis.foot import STOPS_RAD
from sim_rig.prosthesis.prosthesis import MOST_NM_PER_KG, VirtualProsthesis
from sim_rig.walk.footholds import Footholds
from sim_rig.walk.legs import Stand
from sim_rig.walk.scenario import Pace, Scenario, scenario
from sim_rig.walk.world import WorldBuilder

START_NS = 5_000_000_000
MASS_KG = 75.0
WORLD = WorldBuilder().level(1.5, "wood").ramp(2.5, 7.0, "wood").level(1.5, "wood").ramp(2.5, -7.0, "wood").build()
WALK = Scenario("hill", "a short hill", WORLD, (Stand(0.5), Pace(1.2, 1.8).to(WORLD.length_m), Stand(0.5)))


class SameControls:
    """The same impedance whatever the ground, `stiffness` in Nm/rad per kg."""

    def __init__(self, stiffness: float) -> None:
        self._impedance = Impedance(0.0, stiffness * MASS_KG, 0.05 * MASS_KG)

    def impedance(self, _t_ns: int, _phase: GaitPhase, _share: float) -> Impedance:
        return self._impedance


def worn(walk: Scenario = WALK, side: Side = Side.RIGHT, seed: int = 3, stiffness: float = 4.0) -> VirtualProsthesis:
    gait = walk.gait(seed, START_NS)
    footholds = Footholds(walk.world, gait, seed)
    return VirtualProsthesis(walk, gait, footholds, SameControls(stiffness), side=side, mass_kg=MASS_KG, seed=seed)


@pytest.fixture(scope="module")
def walked() -> tuple[VirtualProsthesis, list[tuple[GaitPhase, float, float]]]:
    """Return the prosthesis after seven seconds, and phase, load and torque of every 10 ms."""
    prosthesis, felt = worn(), []
    for t_ns in range(START_NS, START_NS + 7_000_000_000, 10_000_000):
        prosthesis.advance_to(t_ns)
        felt.append((prosthesis.phase, prosthesis.load_n, prosthesis.torque_nm))
    return prosthesis, felt


def test_it_stands_where_the_rig_puts_the_foot_and_lies_on_the_ground(
    walked: tuple[VirtualProsthesis, list[tuple[GaitPhase, float, float]]],
) -> None:
    stances = [stance for stance in walked[0].stances if stance.foothold is not None and stance.left_ns is not None]
    assert {stance.foothold.kind for stance in stances if stance.foothold} == {"level", "ramp"}
    for stance in stances:
        assert stance.foothold is not None
        assert stance.flat_sole_m[0] == pytest.approx(stance.foothold.p_WF_m[0], abs=0.015)
        assert abs(stance.flat_sole_m[-1] - stance.flat_sole_m[0]) < 0.015
        assert np.median(stance.flat_pitch_rad) == pytest.approx(stance.foothold.slope_rad, abs=math.radians(1.5))
        assert stance.landed_ns == pytest.approx(stance.foothold.t_land_ns, abs=60_000_000)


def test_it_bears_the_wearer_and_never_hits_the_ground_in_mid_swing(
    walked: tuple[VirtualProsthesis, list[tuple[GaitPhase, float, float]]],
) -> None:
    prosthesis, felt = walked
    weight_n = MASS_KG * STANDARD_GRAVITY_MPS2
    assert 1.0 * weight_n < max(load for _, load, _ in felt) < 1.6 * weight_n
    assert not prosthesis.stumbles_ns
    assert not any(stance.saturated for stance in prosthesis.stances)
    pushed = min(torque for phase, _, torque in felt if phase is GaitPhase.STANCE)
    assert -MOST_NM_PER_KG * MASS_KG < pushed < -0.8 * MASS_KG


def test_its_motor_gives_no_more_than_it_can_and_says_so() -> None:
    prosthesis, torques = worn(stiffness=80.0), []
    for t_ns in range(START_NS, START_NS + 3_000_000_000, 1_000_000):
        prosthesis.advance_to(t_ns)
        torques.append(abs(prosthesis.torque_nm))
    assert 0.9 * MOST_NM_PER_KG * MASS_KG < max(torques) <= MOST_NM_PER_KG * MASS_KG
    assert any(stance.saturated for stance in prosthesis.stances)


def test_the_way_time_is_cut_up_changes_nothing() -> None:
    at_once, in_pieces = worn(), worn()
    at_once.advance_to(START_NS + 2_000_000_000)
    for t_ns in range(START_NS, START_NS + 2_000_000_001, 700_000):
        in_pieces.advance_to(min(t_ns, START_NS + 2_000_000_000))
    in_pieces.advance_to(START_NS + 2_000_000_000)
    assert in_pieces.foot == at_once.foot
    assert in_pieces.state() == at_once.state()


def test_what_it_tells_is_what_it_feels_but_for_its_sensors() -> None:
    prosthesis = worn()
    prosthesis.advance_to(START_NS + 400_000_000)
    told = prosthesis.state()
    assert told.phase is GaitPhase.STANCE
    assert told.t_sample_ns == START_NS + 400_000_000
    assert told.ankle_angle_rad == pytest.approx(prosthesis.angle_rad, abs=0.02)
    assert told.load_n == pytest.approx(prosthesis.load_n, rel=0.1)
    assert STOPS_RAD[0] < told.ankle_angle_rad < STOPS_RAD[1]


@pytest.mark.parametrize(("name", "why"), [("turns", "turns or rides"), ("bus", "turns or rides")])
def test_a_walk_out_of_its_plane_is_refused(name: str, why: str) -> None:
    with pytest.raises(UserError, match=why):
        worn(scenario(name))


@pytest.mark.parametrize("side", list(Side))
def test_both_sides_climb_stairs(side: Side) -> None:
    stairs = WorldBuilder().level(1.0, "wood").stairs(3, 0.16, 0.30, "wood", "wood").level(1.0, "wood")
    stairs.ramp(0.48 / math.tan(math.radians(10.0)), -10.0, "wood").level(1.0, "wood")
    walk = Scenario("flight", "three stairs", stairs.build(), (Stand(0.3), Pace(0.5, 1.6).to(stairs.x_m), Stand(0.5)))
    prosthesis = worn(walk, side)
    prosthesis.advance_to(START_NS + 5_000_000_000)
    assert not prosthesis.stumbles_ns
    stood = [s.foothold for s in prosthesis.stances if s.foothold is not None and s.left_ns is not None]
    assert max(float(foothold.p_WF_m[2]) for foothold in stood) > 0.3
