"""The foot on the ground: statics that can be written down, and contacts that make no energy."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from messages.constants import STANDARD_GRAVITY_MPS2
from sim_rig.prosthesis.foot import (
    _INERTIA_KGM2,
    _MASS_KG,
    _STIFFNESS_N_PER_M,
    ANKLE_ABOVE_M,
    BALL_M,
    HEEL_M,
    POINTS_M,
    STEP_S,
    Foot,
)
from sim_rig.prosthesis.profile import Profile
from sim_rig.walk.world import WorldBuilder

LEVEL = Profile(WorldBuilder().level(8.0, "wood").build())
LOAD_N = 700.0


def ramp(slope_deg: float) -> Profile:
    return Profile(WorldBuilder().ramp(4.0, slope_deg, "wood").ramp(4.0, -slope_deg, "wood").build())


def settled(ground: Profile, ankle_nm: float, seconds: float = 0.6, pitch_rad: float = 0.0) -> Foot:
    """Return a foot that has stood under a load and an ankle's torque, the leg's damping slowing it."""
    foot = Foot(2.0, ground.height_m(2.0) + ANKLE_ABOVE_M / math.cos(pitch_rad), pitch_rad)
    for _ in range(round(seconds / STEP_S)):
        leg_n = -100.0 * foot.vx_mps, -LOAD_N - 100.0 * foot.vz_mps
        foot.step(ground, leg_n, ankle_nm, 0.0, 0.0)
    return foot


def test_the_ground_bears_load_and_weight() -> None:
    x_n, z_n = settled(LEVEL, 0.0).ground_n
    assert x_n == pytest.approx(0.0, abs=0.5)
    assert z_n == pytest.approx(LOAD_N + _MASS_KG * STANDARD_GRAVITY_MPS2, rel=1e-3)


@pytest.mark.parametrize("ankle_nm", [-60.0, -20.0, 20.0])
def test_the_ankles_torque_moves_the_load_between_heel_and_ball(ankle_nm: float) -> None:
    foot = settled(LEVEL, ankle_nm)
    cos, sin = math.cos(foot.pitch_rad), math.sin(foot.pitch_rad)
    arms_m = [(ahead * cos - up * sin, ahead * sin + up * cos) for ahead, up in POINTS_M]
    moment_nm = sum(rx * fz - rz * fx for (rx, rz), (fx, fz) in zip(arms_m, foot.forces_n, strict=True))
    assert moment_nm == pytest.approx(-ankle_nm, abs=0.2)
    heel_n, ball_n, _ = (z for _, z in foot.forces_n)
    assert (heel_n > ball_n) == (ankle_nm > -0.5 * LOAD_N * (HEEL_M[0] + BALL_M[0]))


def test_on_a_ramp_the_foot_lies_on_it_and_holds() -> None:
    slope_rad = math.radians(10.0)
    foot = settled(ramp(10.0), 0.0, 1.0, slope_rad)
    assert foot.pitch_rad == pytest.approx(slope_rad, abs=0.06)
    assert foot.x_m == pytest.approx(2.0, abs=0.02)


def test_what_is_steeper_than_friction_lets_it_slide() -> None:
    slid = settled(ramp(45.0), 0.0, 0.6, math.radians(45.0))
    assert slid.x_m < 1.7


@settings(max_examples=20)
@given(st.floats(0.0, 0.05), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_a_foot_that_falls_gains_no_energy(drop_m: float, pitch_rad: float, vx_mps: float) -> None:
    lowest_m = min(ahead * math.sin(pitch_rad) + up * math.cos(pitch_rad) for ahead, up in POINTS_M)
    foot = Foot(2.0, drop_m - lowest_m, pitch_rad, vx_mps=vx_mps)

    def energy_j() -> float:
        moving = 0.5 * _MASS_KG * (foot.vx_mps**2 + foot.vz_mps**2) + 0.5 * _INERTIA_KGM2 * foot.pitch_radps**2
        return moving + _MASS_KG * STANDARD_GRAVITY_MPS2 * foot.z_m

    before_j = energy_j()
    for _ in range(400):
        foot.step(LEVEL, (0.0, 0.0), 0.0, 0.0, -foot.pitch_radps)
        assert energy_j() < before_j + 0.02
    assert foot.z_m < 0.5
    assert _STIFFNESS_N_PER_M * STEP_S**2 < 0.1 * _MASS_KG
