"""What a vehicle adds to what the IMU measures, and to nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from messages.arrays import FloatArray
from sim_rig.walk.gait import GRAVITY_W_MPS2
from sim_rig.walk.ride import Push, Ride, Riding
from sim_rig.walk.scenario import scenario

BUS = scenario("bus-walking")


def turned(heading: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return the vectors (n, 3) turned about the vertical."""
    x, y, z = vectors.T
    cos, sin = np.cos(heading), np.sin(heading)
    return np.stack((cos * x - sin * y, sin * x + cos * y, z), axis=1)


@pytest.mark.parametrize("name", ["bus-walking", "bus-slow-walking", "lift-walking"])
def test_the_imu_feels_the_derivatives_of_its_motion_over_the_ground_outside(name: str) -> None:
    walked = scenario(name)
    assert walked.ride is not None
    riding, gait = Riding(walked.ride), walked.gait(1, 0)
    step_s = 1e-3
    t_s = np.arange(0.0, 32.0, step_s)
    t_ns = np.rint(1e9 * t_s).astype(np.int64)
    motion, floor = gait.at(t_ns), riding.at(t_s)
    turn_rate = floor.w_radps[:, 2]
    heading = np.concatenate(([0.0], np.cumsum(0.5 * step_s * (turn_rate[1:] + turn_rate[:-1]))))
    v_W = turned(heading, floor.v_mps + np.cross(floor.w_radps, motion.p_WB_m) + motion.v_WB_mps)
    sf_B, w_B = gait.imu(t_ns)
    felt_W = turned(heading, np.einsum("nij,nj->ni", motion.R_WB, sf_B)) + GRAVITY_W_MPS2
    np.testing.assert_allclose(np.gradient(v_W, step_s, axis=0)[1:-1], felt_W[1:-1], atol=0.05)
    more_B = w_B - motion.w_WB_B_radps
    np.testing.assert_allclose(np.einsum("nij,nj->ni", motion.R_WB, more_B), floor.w_radps, atol=1e-12)


def test_the_pose_over_the_floor_is_that_of_the_same_walk_on_firm_ground() -> None:
    firm = replace(BUS, ride=None)
    t_ns = np.arange(0, 30_000_000_000, 70_000_000)
    riding, walking = BUS.gait(4, 0).at(t_ns), firm.gait(4, 0).at(t_ns)
    np.testing.assert_array_equal(riding.R_WB, walking.R_WB)
    np.testing.assert_array_equal(riding.a_WB_mps2, walking.a_WB_mps2)


def test_rides_reach_what_they_are_said_to() -> None:
    t_s = np.arange(0.0, 45.0, 0.01)
    found = {}
    for name in ("bus", "bus-slow", "lift"):
        ride = scenario(name).ride
        assert ride is not None
        found[name] = Riding(ride).at(t_s)
    assert found["bus"].a_mps2[:, 0].max() == pytest.approx(1.2)
    assert found["bus"].v_mps[:, 0].max() == pytest.approx(6.0)
    assert np.rad2deg(found["bus"].w_radps[:, 2].max()) == pytest.approx(20.0)
    slow = found["bus-slow"].a_mps2[:, 0] > 0.29
    assert np.count_nonzero(slow) * 0.01 == pytest.approx(19.5, abs=0.3)
    assert np.abs(found["lift"].a_mps2[:, 2]).max() == pytest.approx(1.0)
    assert found["lift"].v_mps[:, 2].max() == pytest.approx(2.0)


def test_before_the_start_the_vehicle_is_at_rest() -> None:
    sf_B, _ = BUS.gait(1, 10_000_000_000).imu(np.arange(5_000_000_000, 10_000_000_000, 10_000_000))
    np.testing.assert_allclose(np.linalg.norm(sf_B, axis=1), 9.80665, atol=0.03)


def test_a_ride_that_does_not_end_at_rest_is_refused() -> None:
    with pytest.raises(ValueError, match=r"the ride ends at \+2\.40 m/s ahead, must end at rest"):
        Riding(Ride((Push(1.0, 2.0, ahead_mps2=1.2),), rest_s=1.0))
