"""What the filter foretells of the camera's motion: nothing before the start, then what the samples at rest were."""

import numpy as np
import pytest

from messages import Residual
from messages.constants import STANDARD_GRAVITY_MPS2
from perception.attitude.filter import AttitudeFilter, AttitudeSettings
from sim_rig.walk.gait import Gait
from tests.bench.seen_motion import START_NS, gait, imu_samples

BIAS = np.array([0.01, -0.02, 0.015])


def test_at_rest_the_samples_at_rest_and_no_velocity() -> None:
    found = AttitudeFilter(AttitudeSettings(), Residual())
    up_B = np.array([0.6, 0.0, 0.8])
    assert AttitudeFilter(AttitudeSettings(), Residual()).foretold is None
    for k in range(200):
        found.update(START_NS + k * 10_000_000, tuple(STANDARD_GRAVITY_MPS2 * up_B), tuple(BIAS))
    told = found.foretold
    assert told is not None
    assert told.t_ns == found.t_ns
    assert told.sf_at_rest_mps2 == pytest.approx(STANDARD_GRAVITY_MPS2 * up_B, abs=0.01)
    assert told.w_at_rest_radps == pytest.approx(BIAS, abs=0.002)
    assert np.abs(told.v_B_mps).max() < 0.02
    assert told.covariance is not None
    assert (np.linalg.eigvalsh(told.covariance) > 0.0).all()


def walked(walk: Gait) -> AttitudeFilter:
    """Return the filter after some seconds of a walk."""
    found = AttitudeFilter(AttitudeSettings(), Residual())
    for sample in imu_samples(walk, START_NS, START_NS + 4_500_000_000):
        found.update(sample.t_ns, sample.sf_B_mps2, sample.w_B_radps)
    return found


def test_on_a_walk_the_velocity_in_B_within_what_is_stated() -> None:
    walk = gait(7)
    told = walked(walk).foretold
    assert told is not None
    assert told.covariance is not None
    truth = walk.at(np.array([told.t_ns]))
    error = np.array(told.v_B_mps) - truth.R_WB[0].T @ truth.v_WB_mps[0]
    assert (np.abs(error) < 4.0 * np.sqrt(np.diag(told.covariance)[3:])).all()


def test_while_the_tilt_is_not_known_the_vertical_alone() -> None:
    found = walked(gait(7))
    up_B = found.R_WB[2]
    assert found.doubt_gyro(np.array([0.1, 0.1, 0.0]))
    told = found.foretold
    assert told is not None
    assert told.covariance is None
    assert told.sf_at_rest_mps2 == pytest.approx(STANDARD_GRAVITY_MPS2 * up_B, abs=0.5)
