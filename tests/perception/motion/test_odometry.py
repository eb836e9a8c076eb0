"""The motion in the heading frame: that of the optical centre, with the covariance that errors in W really give it."""

import numpy as np

from messages import Motion, Status, Vec3, upper_triangle, vec3
from perception import so3
from perception.attitude.movement import Movement
from perception.attitude.path_length import Way
from perception.motion.odometry import Odometry
from sim_rig.unit import draw_unit
from sim_rig.walk.truth import rectified_axis_L

UNIT = draw_unit(2)
CALIBRATION = UNIT.exact_calibration()
_AXIS_B = np.array(UNIT.X_BL.R) @ rectified_axis_L(UNIT.stereo)
R_BC = np.column_stack((np.zeros(3), np.zeros(3), _AXIS_B))
"""Of the camera only its optical axis counts."""

R_WB = so3.exp(np.array((0.0, 0.0, 0.7))) @ so3.exp(np.array((0.03, np.radians(45.0), 0.02)))
V_W: Vec3 = (1.1, 0.4, -0.2)
W_W: Vec3 = (0.3, -0.6, 0.8)


def movement(R: np.ndarray, v: Vec3, w: Vec3, covariance: np.ndarray) -> Movement:
    return Movement(R, v, w, covariance, Way(3.0, 0.01), ground_moves=True)


def numbers(motion: Motion) -> np.ndarray:
    return np.array((*motion.velocity_H_mps, *motion.rate_H_radps))


def test_the_optical_centre_moves_with_the_unit_and_around_it() -> None:
    found = Odometry(CALIBRATION, R_BC).motion(7, 3, movement(R_WB, V_W, W_W, np.zeros((9, 9))))
    p_WE = R_WB @ np.array(CALIBRATION.X_BL.p_m)
    v_W = np.array(V_W) + np.cross(W_W, p_WE)
    axis_W = R_WB @ _AXIS_B
    ahead = axis_W[:2] / np.hypot(*axis_W[:2])
    assert found.status is Status.VALID
    assert np.allclose(found.velocity_H_mps, (v_W[:2] @ ahead, ahead[0] * v_W[1] - ahead[1] * v_W[0], v_W[2]))
    assert np.isclose(found.rate_H_radps[2], W_W[2])
    assert (found.distance_m, found.distance_var_m2, found.ground_moves) == (3.0, 0.01, True)


def test_the_covariance_is_that_of_many_errors_drawn() -> None:
    rng = np.random.default_rng(4)
    factor = rng.normal(0.0, 1.0, (9, 9)) * np.repeat((2e-3, 5e-3, 2e-3), 3)[:, np.newaxis]
    covariance = factor @ factor.T
    odometry = Odometry(CALIBRATION, R_BC)
    told = odometry.motion(7, 3, movement(R_WB, V_W, W_W, covariance))
    differences = []
    for error in rng.multivariate_normal(np.zeros(9), covariance, 3_000):
        turn = so3.exp(error[:3])
        v, w = vec3(turn @ V_W + error[3:6]), vec3(turn @ W_W + error[6:])
        true = odometry.motion(7, 3, movement(turn @ R_WB, v, w, covariance))
        differences.append(numbers(true) - numbers(told))
    drawn = np.cov(np.array(differences).T)
    for part, stated in ((slice(0, 3), told.velocity_cov_H), (slice(3, 6), told.rate_cov_H)):
        assert np.allclose(upper_triangle(drawn[part, part]), stated, rtol=0.0, atol=0.1 * max(stated))
