"""How the IMU moves over the ground that the camera sees, with the covariance of that, out of the filter's state."""

from typing import NamedTuple

import numpy as np

from messages import Vec3
from messages.arrays import FloatArray
from perception import so3
from perception.attitude.error_state import (
    BEGINNING,
    GROUND_TURN,
    GYRO_BIAS,
    GYRO_MATRIX,
    ROTATION,
    SIZE,
    TRAVEL,
    VELOCITY,
)
from perception.attitude.kalman import AttitudeKalman
from perception.attitude.path_length import Travel, Way
from perception.attitude.state import AttitudeState


class Movement(NamedTuple):
    """Velocity (m/s) of the IMU and angular rate (rad/s) in W, relative to the ground that the camera sees, and the
    camera's way over it.

    `covariance` (9, 9) is that of the small rotation in W between R_WB and the truth, of the velocity and of the rate,
    the two without what that rotation adds. `ground_moves` is whether that ground accelerates or turns itself.
    """

    R_WB: FloatArray
    v_W_mps: Vec3
    w_W_radps: Vec3
    covariance: FloatArray
    way: Way
    ground_moves: bool


def movement_covariance(kalman: AttitudeKalman, state: AttitudeState) -> FloatArray:
    """Return (θ, δv, δw) of the newest sample, with δw = −R_WB (δb + δM w_measured) − δρ e_z + n_w, as (9, 9)."""
    R_WB = so3.matrix_from_quaternion(state.q_WB)
    J = np.zeros((9, SIZE))
    J[0:3, ROTATION] = J[3:6, VELOCITY] = np.eye(3)
    J[6:9, GYRO_BIAS] = -R_WB
    J[6:9, GYRO_MATRIX] = -(R_WB[:, :, np.newaxis] * np.array(state.w_measured)).reshape(3, 9)
    J[8, GROUND_TURN] = -1.0
    covariance: FloatArray = J @ state.covariance @ J.T
    rate_var = kalman.settings.gyro_noise_radps_rthz**2 / max(state.usual_step_s, _LEAST_STEP_S)
    covariance[6:9, 6:9] += rate_var * np.eye(3)
    return covariance


def unseen_travel(kalman: AttitudeKalman, state: AttitudeState, lever_B_m: Vec3) -> Travel | None:
    """Return how far the samples carried a point of B since a step of the camera began; None where none has begun."""
    if state.q_WB_beginning is None:
        return None
    kalman.correct(state)
    R0, R1 = so3.matrix_from_quaternion(state.q_WB_beginning), so3.matrix_from_quaternion(state.q_WB)
    lever_0_W, lever_1_W = R0 @ lever_B_m, R1 @ lever_B_m
    J = np.zeros((3, SIZE))
    J[:, TRAVEL] = np.eye(3)
    J[:, ROTATION], J[:, BEGINNING] = -so3.skew(lever_1_W), so3.skew(lever_0_W)
    return Travel(np.array(state.travel_W) + lever_1_W - lever_0_W, J @ state.covariance @ J.T)


_LEAST_STEP_S = 1e-3
