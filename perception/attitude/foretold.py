"""What the attitude filter expects the camera to see next."""

from dataclasses import dataclass

import numpy as np

from messages import Vec3, vec3
from messages.arrays import FloatArray
from perception import so3
from perception.attitude.error_state import GYRO_BIAS, VELOCITY
from perception.attitude.kalman import AttitudeKalman
from perception.attitude.state import AttitudeState


@dataclass(frozen=True)
class MotionForetold:
    """The motion of B over the ground, as of `t_ns`, in B as it is then.

    `v_B_mps` is its velocity. At rest on that ground the IMU would measure the rate `w_at_rest_radps`, its bias and how
    the ground turns, and the specific force `sf_at_rest_mps2`, its bias, gravity and how the ground accelerates.
    `covariance` (6, 6) is that of the rate at rest and of the velocity; None where nothing bounds these; then the
    vertical alone is worth something: it tells what of the specific force is gravity.
    """

    t_ns: int
    w_at_rest_radps: Vec3
    sf_at_rest_mps2: Vec3
    v_B_mps: Vec3
    covariance: FloatArray | None


def foretold(kalman: AttitudeKalman, state: AttitudeState) -> MotionForetold | None:
    """Return what `state` makes of the motion; None before it has begun."""
    if state.t_ns is None or not state.started:
        return None
    ground = state.ground
    R_BW = so3.matrix_from_quaternion(state.q_WB).T
    at_rest_W = np.array(ground.acceleration_W) + kalman.settings.gravity_mps2 * _UP
    return MotionForetold(
        state.t_ns,
        vec3(np.array(state.gyro_bias) + ground.turn_radps * R_BW[:, 2]),
        vec3(np.array(state.sf_bias) + R_BW @ at_rest_W),
        vec3(R_BW @ np.array(state.v_W)),
        _covariance(state, R_BW) if kalman.knows_tilt(state, kalman.settings.usable_tilt_rad) else None,
    )


def _covariance(state: AttitudeState, R_BW: FloatArray) -> FloatArray:
    covariance: FloatArray = state.covariance[_KNOWN]
    covariance[3:] = R_BW @ covariance[3:]
    covariance[:, 3:] = covariance[:, 3:] @ R_BW.T
    return covariance


_KNOWN = np.ix_(np.r_[GYRO_BIAS, VELOCITY], np.r_[GYRO_BIAS, VELOCITY])
_UP = np.array([0.0, 0.0, 1.0])
