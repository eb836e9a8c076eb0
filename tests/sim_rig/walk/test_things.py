"""Legs, rollator, cane and passers-by without a picture: where their blocks are while the wearer walks."""

import numpy as np
import pytest

from messages.arrays import FloatArray
from sim_rig.walk.footholds import Foothold
from sim_rig.walk.own_legs import OwnLegs
from sim_rig.walk.passers_by import PassersBy
from sim_rig.walk.scenario import scenario
from sim_rig.walk.things import BAG, Placed, Thing, Walker
from sim_rig.walk.walking_aids import Rollator, WhiteCane

WALK = scenario("own-legs")
SEED = 3
GAIT = WALK.gait(SEED, 0)
WALKER = Walker(GAIT, WALK.world, SEED)
T_NS = np.arange(0, 9_000_000_000, 10_000_000)


def placed(thing: Thing, t_ns: int) -> list[Placed]:
    instants_ns = np.array([t_ns - 5_000_000, t_ns, t_ns + 5_000_000])
    return list(thing.placed(WALKER, instants_ns, GAIT.at(instants_ns)))


def end(block: Placed, side: float) -> FloatArray:
    """Return the middle of a block's upper (1) or lower (−1) face at the middle instant."""
    p_W: FloatArray = block.p_WT_m[1] + side * 0.5 * block.block.size_m[2] * block.R_WT[1][:, 2]
    return p_W


@pytest.mark.parametrize(
    "thing", [OwnLegs(), Rollator(), WhiteCane(), PassersBy(), *BAG], ids=lambda thing: type(thing).__name__
)
def test_blocks_have_rotations_and_the_same_place_for_the_same_instant(thing: Thing) -> None:
    for t_ns in (0, 2_400_000_000, 5_130_000_000):
        blocks, again = placed(thing, t_ns), placed(thing, t_ns)
        assert blocks
        for one, other in zip(blocks, again, strict=True):
            np.testing.assert_array_equal(one.p_WT_m, other.p_WT_m)
            np.testing.assert_allclose(one.R_WT @ one.R_WT.transpose(0, 2, 1), np.tile(np.eye(3), (3, 1, 1)), atol=1e-9)
            np.testing.assert_allclose(np.linalg.det(one.R_WT), 1.0)


def test_thigh_shin_and_foot_hang_together() -> None:
    for t_ns in T_NS[::9].tolist():
        for foot, thigh, shin in np.array(placed(OwnLegs(), t_ns), dtype=object).reshape(2, 3):
            np.testing.assert_allclose(end(thigh, -1.0), end(shin, 1.0), atol=1e-9)
            assert np.linalg.norm(end(shin, -1.0) - foot.p_WT_m[1]) < 0.25
            knee_B = GAIT.at(np.array([t_ns])).R_WB[0].T @ (end(shin, 1.0) - end(thigh, 1.0))
            assert knee_B[0] > 0.0  # the knee is down and ahead along x of B, which looks down at 45°


def test_a_foot_stands_where_it_landed() -> None:
    landings: list[Foothold] = []
    while len(landings) < 8:
        after_ns = landings[-1].t_land_ns + 1000 if landings else 0
        landing = WALKER.footholds.next_after(after_ns)
        assert landing is not None
        landings.append(landing)
    for landing in landings:
        for later_ns in (0, 150_000_000, 250_000_000):
            foot = placed(OwnLegs(), landing.t_land_ns + later_ns + 6_000_000)[0 if landing.left else 3]
            np.testing.assert_allclose(end(foot, -1.0), landing.p_WF_m, atol=1e-6)


def test_a_rollator_rolls_without_the_hips_bobbing() -> None:
    height_m = np.array([placed(Rollator(), t_ns)[0].p_WT_m[1, 2] for t_ns in T_NS[300::10].tolist()])
    assert np.ptp(height_m) < 1e-9
    assert np.ptp(GAIT.at(T_NS[300:]).p_WB_m[:, 2]) > 0.02


def test_the_canes_tip_sweeps_the_ground_ahead() -> None:
    tips_W = np.array([end(placed(WhiteCane(), t_ns)[0], -1.0) for t_ns in T_NS[300::5].tolist()])
    np.testing.assert_allclose(tips_W[:, 2], 0.0, atol=1e-9)
    ahead_m = tips_W[:, 0] - GAIT.at(T_NS[300::5]).p_WB_m[:, 0]
    assert ahead_m.min() > 0.8
    assert np.ptp(tips_W[:, 1]) > 0.6


def test_passers_by_keep_their_distance_and_cross() -> None:
    met = []
    for t_ns in T_NS[::20].tolist():
        here = GAIT.at(np.array([t_ns])).p_WB_m[0]
        trunks_W = np.array([block.p_WT_m[1] for block in placed(PassersBy(), t_ns)[::3]])
        met.append(np.linalg.norm((trunks_W - here)[:, :2], axis=1).min())
    assert 0.3 < min(met) < 2.0
