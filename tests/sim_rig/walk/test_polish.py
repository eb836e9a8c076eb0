"""A polished floor shows the ceiling as far below it as that is above, and more of it at flat angles."""

from dataclasses import replace

import numpy as np
import pytest

from messages.arrays import FloatArray
from sim_rig.camera.renderer import Effects, Renderer
from sim_rig.unit import HEIGHT_PX, WIDTH_PX, draw_unit
from sim_rig.walk.polish import Polish
from sim_rig.walk.scenario import Scenario, scenario
from sim_rig.walk.world import World, WorldBuilder

START_NS = 1_000_000_000
GEOMETRY = Effects(motion_blur=False, noise=False)


def left_light(walk: Scenario) -> FloatArray:
    renderer = Renderer(draw_unit(3), walk.world, walk.gait(3, START_NS), 3, GEOMETRY)
    return renderer.light(START_NS + 4_000_000_000, 0.005)[0].astype(np.float64)


def with_polish(polish: Polish | None) -> Scenario:
    walk = scenario("polished-floor")
    return replace(walk, world=World(walk.world.lap, polish=polish))


def test_what_is_mirrored_is_added_to_the_floor_and_grows_towards_the_horizon() -> None:
    added = left_light(with_polish(Polish())) - left_light(with_polish(None))
    assert added.shape == (HEIGHT_PX, WIDTH_PX)
    assert added.min() > -1.0  # rounding
    far, near = (added[rows, 400:880].mean() for rows in (slice(60, 200), slice(520, 700)))
    assert far > 1.5 * near > 0.0


def test_a_higher_ceiling_is_mirrored_elsewhere_and_the_floor_stays_where_it_is() -> None:
    low, high = (left_light(with_polish(Polish(ceiling_m=each))) for each in (2.4, 4.0))
    assert np.abs(low - high).mean() > 2.0
    plain = left_light(with_polish(None))
    np.testing.assert_array_equal(left_light(with_polish(Polish(share=0.0, lamp_grey=0.0))), plain)


def test_the_share_follows_schlick() -> None:
    polish = Polish(share=0.04)
    assert polish.mirrored(np.array((1.0, 0.5, 0.0))) == pytest.approx((0.04, 0.04 + 0.96 / 32, 1.0))


def test_a_polish_lies_on_level_ground_only() -> None:
    ramp = WorldBuilder().ramp(4.0, 5.0, "wood").ramp(4.0, -5.0, "wood").build()
    with pytest.raises(ValueError, match="a polish, lies on level ground"):
        World(ramp.lap, polish=Polish())
