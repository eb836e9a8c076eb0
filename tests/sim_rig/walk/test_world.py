import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from messages import UserError
from sim_rig.walk.scenario import SCENARIOS, Pace, scenario, scenario_names
from sim_rig.walk.shade import Shade
from sim_rig.walk.world import WorldBuilder

MIXED = scenario("mixed").world


def stairs() -> WorldBuilder:
    return WorldBuilder().level(2.0, "concrete").stairs(3, 0.17, 0.29, "kerbstone", "wood")


def test_stairs_rise_by_riser_and_tread() -> None:
    builder = stairs().level(1.0, "wood").step(-3 * 0.17, "kerbstone").level(1.0, "grass")
    world = builder.build()
    assert world.length_m == pytest.approx(2.0 + 2 * 0.29 + 2.0)
    for x_m, height_m in ((1.9, 0.0), (2.1, 0.17), (2.4, 0.34), (2.7, 0.51), (4.0, 0.0)):
        ground = world.segment_at(x_m)
        assert ground.height_at(x_m) == pytest.approx(height_m)
        assert ground.slope_rad == 0.0
    assert world.segment_at(2.1).kind == "stairs"


def test_a_lap_that_does_not_close_is_refused() -> None:
    with pytest.raises(ValueError, match=r"lap ends \+0\.510 m off"):
        stairs().build()


def test_ramps_have_their_slope_in_every_piece() -> None:
    world = WorldBuilder().ramp(9.0, 5.0, "brick").ramp(9.0, -5.0, "brick").build()
    for x_m in (0.5, 4.4, 8.9):
        assert math.degrees(world.segment_at(x_m).slope_rad) == pytest.approx(5.0)
    assert math.degrees(world.segment_at(9.1).slope_rad) == pytest.approx(-5.0)


def test_an_edge_is_a_riser_or_a_crease_but_not_a_seam_between_slabs() -> None:
    world = WorldBuilder().level(10.0, "concrete").ramp(2.0, 5.0, "brick").ramp(2.0, -5.0, "brick").build()
    assert len(world.lap) > 3
    assert not world.has_edge(0.5, 9.9)
    assert world.has_edge(9.9, 10.1)
    assert world.has_edge(13.9, 14.1)
    kerb = WorldBuilder().level(2.0, "concrete").step(0.1, "brick").level(1.0, "brick").step(-0.1, "brick").build()
    assert kerb.has_edge(1.9, 2.1)
    assert not kerb.has_edge(2.05, 2.95)


@given(x_m=st.floats(-100.0, 100.0))
def test_the_world_repeats_and_its_descriptions_agree(x_m: float) -> None:
    here, a_lap_on = MIXED.segment_at(x_m), MIXED.segment_at(x_m + MIXED.length_m)
    assert here.x0_m - 1e-9 <= x_m <= here.x1_m + 1e-9
    height_m = here.height_at(x_m)
    if min(x_m - here.x0_m, here.x1_m - x_m) > 1e-6:
        assert a_lap_on.height_at(x_m + MIXED.length_m) == pytest.approx(height_m, abs=1e-9)
        assert MIXED.heights(np.array([x_m]))[0] == pytest.approx(height_m, abs=1e-9)
    assert any(s == here for s in MIXED.between(x_m - 0.1, x_m + 0.1))


def test_every_scenario_has_a_line_and_can_be_made() -> None:
    assert scenario_names("all") == list(SCENARIOS)
    assert scenario_names("level,bus-walking") == ["level", "bus-walking"]
    for name, line in SCENARIOS.items():
        assert scenario(name).name == name
        assert "\n" not in line
    with pytest.raises(UserError, match="scenario is 'moon', known are mixed"):
        scenario_names("level,moon")


@pytest.mark.parametrize(("speed_mps", "step_hz", "named"), [(3.0, 1.8, "speed is 3.0 m/s"), (1.2, 0.2, "cadence is")])
def test_a_pace_out_of_range_is_one_clear_line(speed_mps: float, step_hz: float, named: str) -> None:
    with pytest.raises(UserError, match=named):
        Pace(speed_mps, step_hz)


def test_mixed_holds_every_kind_of_ground() -> None:
    assert {s.kind for s in MIXED.lap} == {"level", "ramp", "kerb", "stairs"}


@pytest.mark.parametrize("rise_m", [0.17, -0.17])
def test_a_nosing_juts_out_over_the_lower_surface_and_carries_the_foot(rise_m: float) -> None:
    flight = WorldBuilder().level(2.0, "concrete").stairs(3, rise_m, 0.29, "kerbstone", "wood", 0.025)
    world = flight.level(1.0, "wood").ramp(2.0, math.degrees(math.atan(-3 * rise_m / 2.0)), "brick").build()
    lips = [piece.lip_x_m for piece in world.lap if piece.is_riser]
    assert np.diff(lips) == pytest.approx([0.29, 0.29])
    first = 2.0 if rise_m < 0 else 2.0 - 0.025
    assert lips[0] == pytest.approx(first)
    for k, lip in enumerate(lips):
        upper, lower = max(k * rise_m, (k + 1) * rise_m), min(k * rise_m, (k + 1) * rise_m)
        towards_lower = -math.copysign(0.01, rise_m)
        for x_m, z_m in ((lip - towards_lower, upper), (lip + towards_lower, lower)):
            assert world.segment_at(x_m).height_at(x_m) == pytest.approx(z_m)
            assert world.heights(np.array([x_m - 1.0, x_m]))[1] == pytest.approx(z_m)
    assert world.between_risers(lips[1] - 0.1) == pytest.approx((lips[0], lips[1]))


def test_shades_repeat_with_the_world() -> None:
    shade = Shade((0.6, 0.0, 0.8), 1.0, 1.5, 0.5)
    world = WorldBuilder().level(4.0, "concrete").build(shades=(shade,))
    points = np.array([[x, 0.3, 0.0] for x in np.arange(-7.9, 8.0, 0.05)])
    light = np.prod([each.light(points) for each in world.shades_between(-8.0, 8.0)], axis=0)
    expected = [0.5 if 1.0 <= 0.6 * (x % 4.0) < 1.5 else 1.0 for x in points[:, 0]]
    np.testing.assert_allclose(light, expected)
