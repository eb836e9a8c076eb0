"""How deep points lie in the ground, and which way out is shortest."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from messages import UserError
from sim_rig.prosthesis.profile import Profile
from sim_rig.walk.relief import Relief
from sim_rig.walk.world import WorldBuilder

STEP = WorldBuilder().level(2.0, "wood").step(0.2, "wood").level(2.0, "wood").step(-0.2, "wood").build()
RAMP = WorldBuilder().level(1.0, "wood").ramp(2.0, 10.0, "wood").ramp(2.0, -10.0, "wood").build()


def test_below_a_ramp_the_depth_is_square_to_it() -> None:
    slope_rad = math.radians(10.0)
    ground = Profile(RAMP)
    met = ground.met(2.0, math.tan(slope_rad) - 0.01)
    assert met is not None
    assert met.depth_m == pytest.approx(0.01 * math.cos(slope_rad))
    assert (met.normal_x, met.normal_z) == pytest.approx((-math.sin(slope_rad), math.cos(slope_rad)))
    assert ground.slope_rad(2.0) == pytest.approx(slope_rad)


def test_beside_a_riser_the_way_out_is_back_not_up() -> None:
    met = Profile(STEP).met(2.02, 0.1)
    assert met is not None
    assert met.depth_m == pytest.approx(0.02)
    assert (met.normal_x, met.normal_z) == (-1.0, 0.0)
    met = Profile(STEP).met(3.97, 0.1)
    assert met is not None
    assert (met.normal_x, met.normal_z) == (1.0, 0.0)


def test_under_both_levels_a_riser_is_no_way_out() -> None:
    met = Profile(STEP).met(2.02, -0.3)
    assert met is not None
    assert met.normal_z == 1.0


@given(st.floats(-9.0, 9.0), st.floats(-0.3, 0.5))
def test_a_point_is_met_where_it_is_below_the_surface_in_every_lap(x_m: float, z_m: float) -> None:
    for world in (STEP, RAMP):
        ground = Profile(world)
        met = ground.met(x_m, z_m)
        assert (met is not None) == (z_m < ground.height_m(x_m))
        if met is not None:
            assert 0.0 <= met.depth_m <= ground.height_m(x_m) - z_m
            assert math.hypot(met.normal_x, met.normal_z) == pytest.approx(1.0)


def test_under_a_nosing_stands_the_riser_below_the_lip() -> None:
    world = (
        WorldBuilder()
        .level(2.0, "wood")
        .step(0.2, "wood", nosing_m=0.03)
        .level(2.03, "wood")
        .step(-0.2, "wood")
        .build()
    )
    ground = Profile(world)
    assert ground.height_m(1.96) == 0.0
    assert ground.height_m(1.98) == pytest.approx(0.2)


def test_ground_with_bumps_is_refused() -> None:
    bumpy = WorldBuilder().level(4.0, "wood").build(Relief())
    with pytest.raises(UserError, match="bumps"):
        Profile(bumpy)
