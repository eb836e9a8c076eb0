"""Where and when the feet land."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_rig.walk.footholds import Foothold, Footholds
from sim_rig.walk.scenario import SCENARIOS, Scenario, scenario
from sim_rig.wearer import SimulatedWearer

START_NS = 5_000_000_000
STAIRS = scenario("stairs")


def footholds(walked: Scenario, seed: int = 1) -> Footholds:
    return Footholds(walked.world, walked.gait(seed, START_NS), seed)


FEET, AGAIN = footholds(STAIRS), footholds(STAIRS)


def landings(walked: Scenario, seconds: float, seed: int = 1) -> list[Foothold]:
    feet, found = footholds(walked, seed), []
    t_ns = START_NS
    while (landing := feet.next_after(t_ns)) is not None and landing.t_land_ns < START_NS + round(1e9 * seconds):
        found.append(landing)
        t_ns = landing.t_land_ns
    return found


@pytest.mark.parametrize("name", sorted({*SCENARIOS} - {"standing", "bus", "bus-slow", "lift"}))
def test_feet_land_in_turn_on_the_ground_and_off_its_edges(name: str) -> None:
    walked = scenario(name)
    found = landings(walked, 60.0)
    assert len(found) > 40
    for landing in found:
        ground = walked.world.segment_at(float(landing.p_WF_m[0]))
        assert landing.p_WF_m[2] == pytest.approx(ground.height_at(float(landing.p_WF_m[0])))
        assert (landing.slope_rad, landing.kind) == (ground.slope_rad, ground.kind)
        risers = [s.x0_m for s in walked.world.between(landing.p_WF_m[0] - 1, landing.p_WF_m[0] + 1) if s.is_riser]
        assert min((abs(x - landing.p_WF_m[0]) for x in risers), default=1.0) > 0.09


def test_on_level_ground_feet_land_a_step_apart_with_their_scatter() -> None:
    found = landings(scenario("start"), 30.0)[4:]
    apart_m = np.diff([landing.p_WF_m[:2] for landing in found], axis=0)
    assert apart_m[:, 0].mean() == pytest.approx(1.2 / 1.8, abs=0.01)
    assert 0.03 < apart_m[:, 0].std() < 0.08
    assert np.abs(apart_m[:, 1]).mean() == pytest.approx(0.12, abs=0.01)
    assert 0.01 < np.abs(apart_m[:, 1]).std() < 0.05


def test_feet_land_when_the_heel_strikes_shake_the_hip() -> None:
    gait = scenario("start").gait(1, START_NS)
    for landing in landings(scenario("start"), 12.0)[4:]:
        t_ns = landing.t_land_ns + np.arange(-40, 41) * 1_000_000
        jerk = np.abs(np.diff(gait.at(t_ns).a_WB_mps2[:, 2]))
        assert jerk[40:].max() > 3.0 * jerk[:40].max()


@given(st.integers(-(10**9), 50_000_000_000))
def test_a_seed_lands_the_same_feet_and_the_next_follows_the_last(since_ns: int) -> None:
    t_ns = START_NS + since_ns
    following, last, same = FEET.next_after(t_ns), FEET.last_before(t_ns), AGAIN.next_after(t_ns)
    assert following is not None
    assert same is not None
    np.testing.assert_array_equal(following.p_WF_m, same.p_WF_m)
    assert following.t_land_ns > t_ns
    assert last is None or last.t_land_ns <= t_ns


def test_on_stairs_every_tread_is_stepped_on() -> None:
    treads = [s for s in STAIRS.world.lap if s.kind == "stairs" and not s.is_riser]
    feet = [landing.p_WF_m[0] for landing in landings(STAIRS, 21.0) if landing.kind == "stairs"]
    assert {sum(t.x0_m < x < t.x1_m for x in feet) for t in treads} <= {1, 2}


def test_the_truth_sees_the_next_landing_from_H() -> None:
    wearer = SimulatedWearer(1, STAIRS, START_NS, perfect_calibration=True)
    climbed = []
    for t_ns in range(START_NS + 3_000_000_000, START_NS + 9_000_000_000, 50_000_000):
        seen = wearer.next_foothold(t_ns)
        landing = wearer.footholds.next_after(t_ns)
        assert seen is not None
        assert landing is not None
        ground = wearer.truth(t_ns, seen.ahead_m)
        assert 0.0 < seen.ahead_m < 1.5
        assert abs(seen.left_m) < 0.3
        assert seen.t_land_ns == landing.t_land_ns
        if seen.kind == "level" == ground.kind and not ground.transition:
            assert seen.below_m == pytest.approx(ground.height_m, abs=1e-6)
        climbed.append(seen.rise_m)
    assert np.nanmax(climbed) == pytest.approx(0.17, abs=1e-9)


def test_who_stands_lands_nowhere() -> None:
    wearer = SimulatedWearer(1, scenario("standing"), START_NS, perfect_calibration=True)
    assert wearer.next_foothold(START_NS) is None
