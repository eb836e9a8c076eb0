import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim_rig.walk.gait import GRAVITY_W_MPS2, Gait, Motion
from sim_rig.walk.legs import Stand, Walk
from sim_rig.walk.scenario import SCENARIOS, Pace, Scenario, scenario
from sim_rig.walk.world import WorldBuilder

START_NS = 5_000_000_000
STEP_NS = 100_000


def gait_of(walked: Scenario, seed: int = 1) -> Gait:
    return walked.gait(seed, START_NS)


def seconds(*t_s: float) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    return START_NS + np.rint(np.array(t_s) * 1e9).astype(np.int64)


def at(gait: Gait, t_s: float) -> Motion:
    return gait.at(seconds(t_s))


@pytest.mark.parametrize("name", SCENARIOS)
def test_velocity_acceleration_and_rate_are_the_derivatives_of_the_pose(name: str) -> None:
    gait = gait_of(scenario(name))
    t_ns = np.random.default_rng(3).integers(START_NS, START_NS + 150_000_000_000, 3000)
    h = STEP_NS * 1e-9
    before, now, after = gait.at(t_ns - STEP_NS), gait.at(t_ns), gait.at(t_ns + STEP_NS)
    velocity = (after.p_WB_m - before.p_WB_m) / (2 * h)
    acceleration = (after.v_WB_mps - before.v_WB_mps) / (2 * h)
    rate_B = Rotation.from_matrix(before.R_WB.transpose(0, 2, 1) @ after.R_WB).as_rotvec() / (2 * h)
    np.testing.assert_allclose(now.v_WB_mps, velocity, atol=2e-6)
    np.testing.assert_allclose(now.a_WB_mps2, acceleration, atol=5e-4)
    np.testing.assert_allclose(now.w_WB_B_radps, rate_B, atol=2e-5)


def test_position_velocity_and_acceleration_never_jump() -> None:
    gait = gait_of(scenario("mixed"))
    motion = gait.at(START_NS + np.arange(0, 55_000_000_000, 1_000_000))
    assert np.abs(np.diff(motion.p_WB_m, axis=0)).max() < 2e-3
    assert np.abs(np.diff(motion.v_WB_mps, axis=0)).max() < 8e-3
    assert np.abs(np.diff(motion.a_WB_mps2, axis=0)).max() < 0.8


def test_standing_measures_gravity_alone_and_hardly_moves() -> None:
    gait = gait_of(scenario("mixed"))
    motion = gait.at(seconds(*np.linspace(-3.0, 2.4, 500)))
    assert motion.standing.all()
    np.testing.assert_allclose(np.linalg.norm(motion.sf_B_mps2, axis=1), 9.80665, atol=0.03)
    assert np.ptp(motion.p_WB_m, axis=0).max() < 0.012
    assert 0 < np.rad2deg(np.abs(motion.w_WB_B_radps).max()) < 1.5
    pitch_rad = np.arcsin(-motion.R_WB[:, 2, 0])
    assert np.rad2deg(pitch_rad) == pytest.approx(45.0, abs=4.0)


def test_specific_force_is_acceleration_less_gravity_in_B() -> None:
    motion = gait_of(scenario("level")).at(seconds(6.0, 6.2))
    sf_W = np.einsum("nij,nj->ni", motion.R_WB, motion.sf_B_mps2)
    np.testing.assert_allclose(sf_W, motion.a_WB_mps2 - GRAVITY_W_MPS2, atol=1e-12)


def test_walking_keeps_its_pace_and_the_amplitudes_of_the_literature() -> None:
    gait = gait_of(scenario("level", Pace(1.3, 2.0)))
    motion = gait.at(seconds(*np.arange(6.0, 16.0, 0.002)))
    assert not motion.standing.any()
    assert motion.v_WB_mps[:, 0].mean() == pytest.approx(1.3, rel=0.01)
    assert np.std(motion.v_WB_mps[:, 0]) == pytest.approx(0.11, abs=0.04)
    assert np.ptp(motion.p_WB_m[:, 2]) == pytest.approx(0.045, abs=0.008)
    assert np.ptp(motion.p_WB_m[:, 1]) == pytest.approx(0.042, abs=0.010)
    hip = Rotation.from_matrix(motion.R_WB) * Rotation.from_euler("Y", -45.0, degrees=True)
    yaw, pitch, roll = hip.as_euler("ZYX", degrees=True).T
    assert np.ptp(yaw) == pytest.approx(11.0, abs=2.0)
    assert np.ptp(pitch) == pytest.approx(5.2, abs=1.2)
    assert np.ptp(roll) == pytest.approx(6.3, abs=1.2)
    spectrum = np.abs(np.fft.rfft(motion.p_WB_m[:, 2] - motion.p_WB_m[:, 2].mean()))
    assert np.fft.rfftfreq(5000, 0.002)[spectrum.argmax()] == pytest.approx(2.0, abs=0.05)


def test_heel_strikes_shake_the_hip_once_a_step() -> None:
    gait = gait_of(scenario("level", Pace(1.2, 1.8)))
    motion = gait.at(seconds(*np.arange(6.0, 16.0, 0.001)))
    jerk = np.abs(np.diff(motion.a_WB_mps2[:, 2])) / 1e-3
    burst = jerk > 0.5 * jerk.max()
    onsets = np.flatnonzero(burst[1:] & ~burst[:-1])
    strikes = onsets[np.diff(onsets, prepend=-1000) > 200]
    assert len(strikes) == pytest.approx(18, abs=1)
    assert 3.0 < np.abs(motion.a_WB_mps2[:, 2]).max() < 9.0


def test_the_hip_follows_the_ground_lap_after_lap() -> None:
    walked = scenario("mixed")
    gait = gait_of(walked)
    motion = gait.at(START_NS + np.arange(0, 120_000_000_000, 20_000_000))
    x_m = motion.p_WB_m[:, 0]
    assert x_m[-1] > 2 * walked.world.length_m
    above_m = motion.p_WB_m[:, 2] - walked.world.heights(x_m)
    assert above_m.mean() == pytest.approx(walked.hip_height_m, abs=0.02)
    assert 0.7 < above_m.min() < above_m.max() < 1.2


def test_a_stop_comes_to_rest_where_it_was_planned() -> None:
    world = WorldBuilder().level(20.0, "concrete").build()
    legs = (Stand(1.0), Walk(7.0, 1.0, 1.8), Stand(2.0), Walk(20.0, 1.0, 1.8), Stand(1.0))
    gait = Gait(world, legs, 0.95, 1, START_NS)
    t_s = np.arange(0.0, 30.0, 0.01)
    motion = gait.at(seconds(*t_s))
    paused = motion.standing & (t_s > 5.0) & (t_s < 15.0)
    assert np.count_nonzero(paused) == pytest.approx(200, abs=2)
    assert motion.p_WB_m[paused, 0] == pytest.approx(7.0, abs=0.01)


def test_a_leg_too_short_to_change_pace_is_refused() -> None:
    world = WorldBuilder().level(4.0, "concrete").build()
    with pytest.raises(ValueError, match=r"walk to 0\.5 m is 0\.50 m too short"):
        Gait(world, (Walk(0.5, 1.0, 1.8), Stand(1.0)), 0.95, 1, START_NS)


def test_a_seed_is_a_person() -> None:
    walked = scenario("mixed")
    t_ns = seconds(*np.arange(4.0, 8.0, 0.1))
    np.testing.assert_array_equal(gait_of(walked, 3).at(t_ns).R_WB, gait_of(walked, 3).at(t_ns).R_WB)
    assert np.abs(gait_of(walked, 3).at(t_ns).R_WB - gait_of(walked, 4).at(t_ns).R_WB).max() > 1e-3


def test_one_instant_or_many_the_motion_is_the_same() -> None:
    gait = gait_of(scenario("mixed"))
    t_ns = seconds(*np.linspace(0.0, 60.0, 25))
    together = gait.imu(t_ns)
    for k, one_ns in enumerate(t_ns):
        sf_B, w_B = gait.imu(np.array([one_ns]))
        np.testing.assert_allclose(sf_B[0], together[0][k], rtol=0, atol=1e-10)
        np.testing.assert_allclose(w_B[0], together[1][k], rtol=0, atol=1e-10)
    assert at(gait, 1.0).standing.shape == (1,)
