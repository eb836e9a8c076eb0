"""What a walk tells of a pair of eyes: the scale of its distances, shared out between baseline and toe-in.

A baseline that is too long by the share β makes all distances too long by β. A right eye whose points are turned too
far by ε about C's y, to the right, makes those at z too short by ε z/b, for disparities seem too large by f ε. The
motion of the camera is seen at the corners' distance alone, so a walk tells one number of both, s, which also holds
what is left of the focal lengths, φ:

    s = h x + φ + n,   x = (β, ε),   h = (1, −z/b)                                                           (1)
    x = K s,   K = P hᵀ / (h P hᵀ + σ_φ² + σ_n²),   P ← (1 − K h) P                                          (2)

with P what the calibration says of each. So the one that was known less well takes most of s, and what the walk cannot
tell apart stays uncertain in both: their deviations after (2) are not less than their own shares of P allow.
"""

import math
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from messages import Calibration, matrix3, vec3
from perception import so3
from perception.depth.rectify import Rectifier

CORNERS_Z_M = 1.1
"""How far along the optical axis the corners lie that tell the motion of a camera at the hip, pitched 45° down: on a
rendered walk steps are 0.48 % shorter or longer where the toe-in is off by 0.03° and the baseline 0.12 m."""
_MOST_SIGMAS = 3.0
"""A scale farther from 1 than so many deviations of calibration and walk together is no error that the file states."""


class PairErrors(NamedTuple):
    """By what share the baseline is too long, and by what angle ε the toe-in is off (1), with the deviations that are
    left of each by itself; and the deviation of the scale of distances at the corners once both are put right."""

    baseline: float
    baseline_std: float
    toe_in_rad: float
    toe_in_std_rad: float
    scale_std: float


def pair_errors(known: Calibration, scale: float, scale_std: float) -> PairErrors | None:
    """Return (2) for distances found too long by the share `scale`, `scale_std` of which the walk leaves.

    None where the calibration does not explain it: which of the two has changed, and how, nobody knows.
    """
    residual = known.residual
    P = np.diag((residual.baseline_std**2, residual.toe_in_rad**2))
    h = np.array((1.0, -CORNERS_Z_M / math.hypot(*known.stereo.X_RL.p_m)))
    noise_var = residual.focal_length_std**2 + scale_std**2
    calibrated_var = float(h @ P @ h)
    if scale**2 > _MOST_SIGMAS**2 * (calibrated_var + noise_var):
        return None
    K = P @ h / (calibrated_var + noise_var)
    left = P - np.outer(K, h @ P)
    (baseline, toe_in_rad), (baseline_std, toe_in_std_rad) = (K * scale).tolist(), np.sqrt(np.diag(left)).tolist()
    scale_std_left = math.sqrt(calibrated_var * noise_var / (calibrated_var + noise_var))
    return PairErrors(baseline, baseline_std, toe_in_rad, toe_in_std_rad, scale_std_left)


def put_right(known: Calibration, errors: PairErrors) -> Calibration:
    """Return `known` without the errors, and with what is left of them in its residual."""
    made = toed_in(lengthened(known, 1.0 / (1.0 + errors.baseline)), -errors.toe_in_rad)
    residual = msgspec.structs.replace(known.residual, baseline=errors.baseline_std, toe_in_rad=errors.toe_in_std_rad)
    return msgspec.structs.replace(made, residual=residual)


def lengthened(known: Calibration, factor: float) -> Calibration:
    """Return `known` with a baseline `factor` times as long."""
    X_RL = known.stereo.X_RL
    return _with_pose(known, X_RL.R, factor * np.array(X_RL.p_m))


def toed_in(known: Calibration, by_rad: float) -> Calibration:
    """Return `known` with a right eye whose points turn by ε about C's y: p_R' = exp(ε ŷ) p_R in axes parallel to C."""
    X_RL = known.stereo.X_RL
    R_RL = np.array(X_RL.R)
    R_RC = R_RL @ Rectifier(known.stereo, 4).R_LC
    turn = R_RC @ so3.exp(np.array((0.0, by_rad, 0.0))) @ R_RC.T
    return _with_pose(known, turn @ R_RL, turn @ np.array(X_RL.p_m))


def _with_pose(known: Calibration, R: ArrayLike, p_m: ArrayLike) -> Calibration:
    X_RL = msgspec.structs.replace(known.stereo.X_RL, R=matrix3(R), p_m=vec3(p_m))
    return msgspec.structs.replace(known, stereo=msgspec.structs.replace(known.stereo, X_RL=X_RL))
