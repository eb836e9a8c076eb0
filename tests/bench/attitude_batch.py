"""The attitude from all samples and all steps of the camera at once: nonlinear least squares over a few seconds.

Slow and readable: it integrates the samples again for every guess at what is unknown and compares the camera's path
with what the camera saw. It knows no causes, no robustness, no priors but those of the sensors' errors.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from messages import Residual
from messages.arrays import FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2
from perception.attitude.camera_step import CameraStep
from tests.bench.seen_motion import SampleAt

_UP = np.array([0.0, 0.0, 1.0])
_GYRO_BIAS_RADPS = np.radians(2.0)


@dataclass(frozen=True)
class Path:
    """Attitude R_WB (n, 3, 3) and position (n, 3) of B at each sample."""

    t_s: FloatArray
    R_WB: FloatArray
    p_WB_m: FloatArray


def path(samples: Sequence[SampleAt], unknown: FloatArray) -> Path:
    """Return the path of B for `unknown` (12,): its rotation vector and velocity at first, and both sensors' biases."""
    rotvec, v_W, gyro_bias, sf_bias = unknown.reshape(4, 3)
    t_s = 1e-9 * np.array([sample.t_ns - samples[0].t_ns for sample in samples])
    w_B = np.array([sample.w_B_radps for sample in samples]) - gyro_bias
    sf_B = np.array([sample.sf_B_mps2 for sample in samples]) - sf_bias
    dt_s = np.diff(t_s)
    turns = Rotation.from_rotvec(0.5 * (w_B[1:] + w_B[:-1]) * dt_s[:, None])
    attitude = [Rotation.from_rotvec(rotvec)]
    for turn in turns:
        attitude.append(attitude[-1] * turn)
    R_WB = np.array([each.as_matrix() for each in attitude])
    a_W = np.einsum("nij,nj->ni", R_WB, sf_B) - STANDARD_GRAVITY_MPS2 * _UP
    v_W = v_W + np.vstack((np.zeros(3), np.cumsum(0.5 * (a_W[1:] + a_W[:-1]) * dt_s[:, None], axis=0)))
    p_W = np.vstack((np.zeros(3), np.cumsum(0.5 * (v_W[1:] + v_W[:-1]) * dt_s[:, None], axis=0)))
    return Path(t_s, R_WB, p_W)


def solve(samples: Sequence[SampleAt], steps: Sequence[CameraStep], guess_WB: FloatArray, residual: Residual) -> Path:
    """Return the path that explains the steps best; each begins and ends at a sample. `guess_WB` is a first R_WB."""
    index = {sample.t_ns: k for k, sample in enumerate(samples)}
    ends = [(index[step.t_before_ns], index[step.t_after_ns]) for step in steps]
    weights = [np.linalg.inv(np.linalg.cholesky(step.covariance)) for step in steps]

    def misfit(unknown: FloatArray) -> FloatArray:
        found = path(samples, unknown)
        told = [unknown[6:9] / _GYRO_BIAS_RADPS, unknown[9:12] / residual.specific_force_mps2]
        for step, weight, (k0, k1) in zip(steps, weights, ends, strict=True):
            R0, R1, lever = found.R_WB[k0], found.R_WB[k1], np.array(step.p_BC_m)
            travel = R0.T @ (found.p_WB_m[k1] + R1 @ lever - found.p_WB_m[k0] - R0 @ lever)
            turn = Rotation.from_matrix(R0.T @ R1).as_rotvec()
            told.append(weight @ np.concatenate((turn - step.turn_B, travel - step.travel_B)))
        return np.concatenate(told)

    start = np.concatenate((Rotation.from_matrix(guess_WB).as_rotvec(), np.zeros(9)))
    return path(samples, least_squares(misfit, start, method="trf").x)
