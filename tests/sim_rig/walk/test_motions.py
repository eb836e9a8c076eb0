"""Turning, sitting, stumbling, limping and starting: the bounds of each motion."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from messages.arrays import FloatArray
from sim_rig.walk.gait import Gait, Habits, Motion
from sim_rig.walk.legs import Bend, Leg, Sit, Stand, Turn, Walk
from sim_rig.walk.scenario import Pace, scenario
from sim_rig.walk.world import WorldBuilder

LEVEL = WorldBuilder().level(20.0, "concrete").build()


def gait_of(*legs: Leg, habits: Habits | None = None) -> Gait:
    return Gait(LEVEL, legs, 0.95, 1, 0, habits=habits or Habits())


def at(gait: Gait, t_s: FloatArray) -> Motion:
    return gait.at(np.rint(t_s * 1e9).astype(np.int64))


def hip_deg(motion: Motion) -> FloatArray:
    """Return yaw, pitch and roll (3, n) of the hip."""
    hip = Rotation.from_matrix(motion.R_WB) * Rotation.from_euler("Y", -45.0, degrees=True)
    angles: FloatArray = hip.as_euler("ZYX", degrees=True).T
    return angles


legs = st.one_of(
    st.builds(Stand, st.floats(0.2, 2.0)),
    st.builds(Turn, st.floats(-4.0, 4.0), st.floats(1.0, 3.0)),
    st.builds(Sit, st.floats(0.5, 2.0)),
)


@settings(max_examples=20, deadline=None)
@given(st.lists(legs, min_size=1, max_size=3), st.floats(0.5, 2.0), st.floats(-3.0, 3.0), st.floats(0.0, 1.0))
def test_whatever_the_legs_rates_and_accelerations_are_derivatives_of_the_pose(
    before: list[Leg], acceleration_mps2: float, turn_rad: float, limp: float
) -> None:
    walk = Walk(9.0, 1.2, 1.8, acceleration_mps2, turn_rad=turn_rad, stumbles_at_m=(5.0,))
    turned = turn_rad + sum(leg.turn_rad for leg in before if isinstance(leg, Turn))
    gait = gait_of(*before, walk, Turn(-turned, 2.0), Stand(0.5), habits=Habits(limp=limp, step_scatter_s=0.02))
    t_s, h_s = np.random.default_rng(3).uniform(0.0, gait.lap_s, 300), 1e-4
    earlier, now, later = at(gait, t_s - h_s), at(gait, t_s), at(gait, t_s + h_s)
    rate_B = Rotation.from_matrix(earlier.R_WB.transpose(0, 2, 1) @ later.R_WB).as_rotvec() / (2 * h_s)
    np.testing.assert_allclose(now.v_WB_mps, (later.p_WB_m - earlier.p_WB_m) / (2 * h_s), atol=5e-6)
    np.testing.assert_allclose(now.a_WB_mps2, (later.v_WB_mps - earlier.v_WB_mps) / (2 * h_s), atol=0.02)
    np.testing.assert_allclose(now.w_WB_B_radps, rate_B, atol=1e-4)


@pytest.mark.parametrize("acceleration_mps2", [0.5, 0.8, 2.0])
def test_a_start_has_the_acceleration_it_states(acceleration_mps2: float) -> None:
    walked = scenario("start", Pace(acceleration_mps2=acceleration_mps2))
    starting_s = 1.2 / acceleration_mps2
    motion = walked.gait(1, 0).at(np.array([1_500_000_000, round(1e9 * (1.5 + starting_s))]))
    mean_mps2 = np.diff(motion.v_WB_mps[:, 0])[0] / starting_s
    assert mean_mps2 == pytest.approx(acceleration_mps2, rel=0.2)  # the ripple of a step at either end
    assert motion.p_WB_m[1, 0] == pytest.approx(0.5 * 1.2 * starting_s, abs=0.03)


def test_a_pace_changes_within_a_second_where_no_acceleration_is_stated() -> None:
    said = [gait_of(Stand(1.0), Walk(9.0, 1.2, 1.8, a), Stand(1.0)).lap_s for a in (None, 1.2)]
    assert said[0] == said[1]


def test_a_turn_in_place_turns_by_its_angle_and_stays() -> None:
    motion = at(gait_of(Stand(1.0), Turn(np.pi, 2.0), Stand(1.0), Turn(np.pi, 2.0)), np.arange(0.0, 3.9, 0.01))
    yaw = np.unwrap(hip_deg(motion)[0], period=360.0)
    assert yaw[-1] - yaw[0] == pytest.approx(180.0, abs=3.0)
    assert np.abs(motion.p_WB_m[:, :2]).max() < 0.05
    assert motion.standing[:100].all()
    assert not motion.standing[102:298].any()


def test_a_bend_leads_the_walk_along_its_heading() -> None:
    motion = at(scenario("turns").gait(1, 0), np.arange(5.0, 25.0, 0.01))
    yaw = np.deg2rad(hip_deg(motion)[0])
    ahead = np.cos(yaw) * motion.v_WB_mps[:, 0] + np.sin(yaw) * motion.v_WB_mps[:, 1]
    left = np.cos(yaw) * motion.v_WB_mps[:, 1] - np.sin(yaw) * motion.v_WB_mps[:, 0]
    assert ahead.mean() == pytest.approx(1.2, abs=0.02)
    assert np.abs(left).max() < 0.35
    assert np.ptp(motion.p_WB_m[:, 1]) == pytest.approx(2.8, abs=0.2)  # a half circle of 6.8 m less the metre before it


def test_who_sits_down_sinks_and_leans_and_comes_back() -> None:
    t_s = np.arange(0.0, 10.0, 0.01)
    motion = at(gait_of(Stand(1.0), Sit(4.0), Stand(1.0)), t_s)
    sunk, pitch = motion.p_WB_m[0, 2] - motion.p_WB_m[:, 2], hip_deg(motion)[1]
    assert sunk[(t_s > 3.0) & (t_s < 7.0)] == pytest.approx(0.40, abs=0.005)
    assert sunk[t_s > 9.0] == pytest.approx(0.0, abs=0.005)
    assert pitch.max() - pitch[0] == pytest.approx(35.0, abs=1.0)
    assert pitch[t_s > 9.0] == pytest.approx(pitch[0], abs=1.0)
    np.testing.assert_array_equal(motion.standing, (t_s <= 1.0) | (t_s >= 9.0))
    assert np.abs(motion.a_WB_mps2).max() < 3.0


def test_who_bends_down_sinks_and_leans_for_as_long_as_that_takes() -> None:
    t_s = np.arange(0.0, 6.4, 0.01)
    motion = at(gait_of(Stand(1.0), Bend(2.0), Stand(1.0)), t_s)
    sunk, pitch = motion.p_WB_m[0, 2] - motion.p_WB_m[:, 2], hip_deg(motion)[1]
    bent = (t_s > 2.2) & (t_s < 4.2)
    assert sunk[bent] == pytest.approx(0.12, abs=0.005)
    assert pitch[bent] - pitch[0] == pytest.approx(30.0, abs=1.0)
    assert sunk[t_s > 5.4] == pytest.approx(0.0, abs=0.005)
    np.testing.assert_array_equal(motion.standing, (t_s <= 1.0) | (t_s >= 5.4))


def test_a_stumble_pitches_the_hip_suddenly_and_is_over_within_half_a_second() -> None:
    t_s = np.arange(5.0, 12.0, 0.005)
    steady = Walk(15.0, 1.2, 1.8)
    stumbling = at(gait_of(Stand(1.0), replace(steady, stumbles_at_m=(8.0,)), Stand(1.0)), t_s)
    walking = at(gait_of(Stand(1.0), steady, Stand(1.0)), t_s)
    more_deg = hip_deg(stumbling)[1] - hip_deg(walking)[1]
    begin_s, end_s = t_s[np.flatnonzero(np.abs(more_deg) > 0.01)[[0, -1]]]
    assert more_deg.max() == pytest.approx(14.0, abs=0.5)
    assert end_s - begin_s == pytest.approx(0.5, abs=0.05)
    assert begin_s == pytest.approx(1.5 + 8.0 / 1.2, abs=0.05)
    assert np.rad2deg(np.abs(np.diff(more_deg)).max() / 0.005) > 100.0


def test_a_limp_makes_steps_unequal_in_time_and_height() -> None:
    even, lame = (gait_of(Stand(1.0), Walk(18.0, 0.9, 1.5), Stand(1.0), habits=Habits(limp=x)) for x in (0.0, 1.0))
    for gait, asymmetry in ((even, 0.0), (lame, 0.24)):
        times_s = np.diff(gait.strike_s)[4:20]
        assert abs(times_s[::2].mean() - times_s[1::2].mean()) * 1.5 == pytest.approx(asymmetry, abs=0.01)
    heights_m = np.array([at(gait, gait.strike_s).p_WB_m[4:20, 2] for gait in (even, lame)])
    asymmetry_m = np.abs(heights_m[:, ::2].mean(axis=1) - heights_m[:, 1::2].mean(axis=1))
    assert asymmetry_m[0] < 0.002
    assert 0.01 < asymmetry_m[1] < 0.03


def test_landings_differ_in_time_by_their_scatter() -> None:
    gait = gait_of(Stand(1.0), Walk(200.0, 1.2, 1.8), Stand(1.0), habits=Habits(step_scatter_s=0.02))
    step_s = np.diff(gait.strike_s)[5:-5]
    assert step_s.mean() == pytest.approx(1.0 / 1.8, abs=0.002)
    assert step_s.std() == pytest.approx(0.02 * np.sqrt(2.0), rel=0.15)


def test_a_lap_that_does_not_close_its_heading_is_refused() -> None:
    with pytest.raises(ValueError, match=r"a lap turns the wearer by 90\.0° in all, must be whole turns"):
        gait_of(Turn(np.pi / 2, 2.0), Stand(1.0))


def test_a_turn_without_time_is_refused() -> None:
    with pytest.raises(ValueError, match=r"a turn takes 0\.5 s, must be more than 0\.8 s"):
        gait_of(Turn(np.pi, 0.5))


def test_a_stumble_outside_its_walk_is_refused() -> None:
    with pytest.raises(ValueError, match="a change lasts until"):
        gait_of(Stand(1.0), Walk(9.0, 1.2, 1.8, stumbles_at_m=(12.0,)))
