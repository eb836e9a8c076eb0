"""The true ground as a camera would tell it that measured it without error, but does not know how it hangs.

With n the plane's true normal and û the vertical as estimated, both seen by the camera, d its distance from it:

    n_Ŵ = R̂_WC R_WCᵀ n_W,   d = h (e_z · n_W),   ĥ = d / (û · n)                                     (1)
"""

import math

import numpy as np

from lab.evaluation.causes.ledger import SlopeError
from messages import GroundPlane, GroundTruth
from messages.arrays import FloatArray
from perception.heading import heading


def error_of_attitude(told_R_WC: FloatArray, true_R_WC: FloatArray, truth: GroundTruth) -> SlopeError | None:
    """Return what the attitudes' difference alone makes of `truth`, by (1); None where one looks straight down.

    The yaws of both worlds may differ.
    """
    told_R_WH, true_R_WH = heading(told_R_WC), heading(true_R_WC)
    if told_R_WH is None or true_R_WH is None:
        return None
    gradient = np.tan((truth.slope_sagittal_rad, truth.slope_frontal_rad))
    normal_H = np.array((-gradient[0], -gradient[1], 1.0)) / math.hypot(*gradient, 1.0)
    told_H = told_R_WH.T @ told_R_WC @ true_R_WC.T @ true_R_WH @ normal_H
    return SlopeError(
        math.atan2(-told_H[0], told_H[2]) - truth.slope_sagittal_rad,
        math.atan2(-told_H[1], told_H[2]) - truth.slope_frontal_rad,
        truth.height_m * float(normal_H[2] / told_H[2]) - truth.height_m,
    )


def error_of(ground: GroundPlane, truth: GroundTruth) -> SlopeError:
    """Return the error of an estimate."""
    return SlopeError(
        ground.slope_sagittal_rad - truth.slope_sagittal_rad,
        ground.slope_frontal_rad - truth.slope_frontal_rad,
        ground.height_m - truth.height_m,
    )
