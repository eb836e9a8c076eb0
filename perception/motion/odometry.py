"""The wearer's motion as it is published: velocity and rate in the heading frame H, the way walked, and how sure.

H turns with the camera, and its heading is only as sure as the attitude. Where R_WC is off by a small rotation θ in W,
H's x, the horizontal part h of the optical axis a, is off about e_z by

    ψ = θ · u,   u = e_z − (a_z / |a_h|) h                                                   (1)

so a vector x_H = R_HW x of W whose own error is δx errs by R_HW (δx + θ × x − ψ e_z × x): what turns heading and vector
alike does no harm.
"""

import numpy as np

from messages import Motion, Reason, Status, UnitCalibration, upper_triangle, vec3
from messages.arrays import FloatArray
from perception.attitude.movement import Movement
from perception.heading import heading
from perception.so3 import skew

_UP = np.array([0.0, 0.0, 1.0])
_ABOUT_UP = skew(_UP)
"""e_z × x = _ABOUT_UP x."""


class Odometry:
    """Tells the motion of the left optical centre. `R_BC` (3, 3) takes vectors of the rectified left camera to B."""

    def __init__(self, calibration: UnitCalibration, R_BC: FloatArray) -> None:
        self._calibration_id = calibration.id
        self._R_BC = R_BC
        self._p_BC_m = np.array(calibration.X_BE.p_m)

    def motion(self, t_exposure_ns: int, frame_seq: int, found: Movement) -> Motion:
        """Return the motion at mid-exposure of a frame."""
        R_WC = found.R_WB @ self._R_BC
        R_WH = heading(R_WC)
        if R_WH is None:
            return self.no_motion(t_exposure_ns, frame_seq, Reason.FOOTHOLD_OUT_OF_VIEW)
        lever_W, w_W = found.R_WB @ self._p_BC_m, np.array(found.w_W_radps)
        v_W = np.array(found.v_W_mps) + skew(w_W) @ lever_W
        heading_W = _heading_error(R_WC, R_WH)
        to_velocity, to_rate = np.zeros((3, 9)), np.zeros((3, 9))
        to_velocity[:, 0:3] = _turned_vector(v_W, heading_W)
        to_velocity[:, 3:6], to_velocity[:, 6:9] = np.eye(3), -skew(lever_W)
        to_rate[:, 0:3], to_rate[:, 6:9] = _turned_vector(w_W, heading_W), np.eye(3)
        to_velocity, to_rate = R_WH.T @ to_velocity, R_WH.T @ to_rate
        return Motion(
            t_exposure_ns=t_exposure_ns,
            frame_seq=frame_seq,
            status=Status.VALID,
            reason=Reason.NONE,
            velocity_H_mps=vec3(R_WH.T @ v_W),
            rate_H_radps=vec3(R_WH.T @ w_W),
            distance_m=found.way.distance_m,
            velocity_cov_H=upper_triangle(to_velocity @ found.covariance @ to_velocity.T),
            rate_cov_H=upper_triangle(to_rate @ found.covariance @ to_rate.T),
            distance_var_m2=found.way.variance_m2,
            ground_moves=found.ground_moves,
            calibration_id=self._calibration_id,
        )

    def no_motion(self, t_exposure_ns: int, frame_seq: int, reason: Reason) -> Motion:
        """Return the estimate that says only why there is none."""
        return Motion.invalid(
            t_exposure_ns=t_exposure_ns, frame_seq=frame_seq, reason=reason, calibration_id=self._calibration_id
        )


def _heading_error(R_WC: FloatArray, R_WH: FloatArray) -> FloatArray:
    """Return u (3,) of (1)."""
    axis_W = R_WC[:, 2]
    u: FloatArray = _UP - axis_W[2] / np.hypot(axis_W[0], axis_W[1]) * R_WH[:, 0]
    return u


def _turned_vector(x_W: FloatArray, u_W: FloatArray) -> FloatArray:
    """Return what θ does to x seen in H, (3, 3), in W: θ × x − (θ · u) e_z × x."""
    turned: FloatArray = -skew(x_W) - np.outer(_ABOUT_UP @ x_W, u_W)
    return turned
