"""What wrong focal lengths of the two eyes make of a plane, and how far what is seen up or down bounds them.

Where the eyes' focal lengths are (1 + ε_L) and (1 + ε_R) times what the calibration says, a point that is truly seen by
the ray (x, y, 1) with the disparity d, px, is taken to be seen

    by ((1 + ε_L) x, (1 + ε_L) y, 1)   with   (1 + ε_R) d + (ε_L − ε_R) f x                                   (1)

so that the plane d = r · θ becomes one of θ + ε_L (f e_x − θ_x e_x − θ_y e_y) + ε_R (θ − f e_x): with the ground some
30 px of disparity away and f ten times that, the difference of the two leads, and tilts the ground to one side. By (1)
the right eye also sees what lies at y lower by (ε_R − ε_L) y, whatever the ground.
"""

import math
from typing import NamedTuple

import numpy as np

from messages.arrays import FloatArray


class FocalDifference(NamedTuple):
    """ε_L − ε_R as seen in the eyes' rows, and one standard deviation of it."""

    share: float
    std: float


UNWATCHED = FocalDifference(0.0, math.inf)


def plane_errors_px(theta_C: FloatArray, f_px: float, std: float, seen: FocalDifference) -> FloatArray:
    """Return two independent errors (2, 3) of θ in C, px, each one standard deviation, by what all eyes of the kind
    and by what two of them differ in; `std` is that of ε_L and of ε_R."""
    along_x = np.array([f_px, 0.0, 0.0])
    in_picture = theta_C * np.array([1.0, 1.0, 0.0])
    left, right = along_x - in_picture, theta_C - along_x
    difference_std = math.sqrt(difference_var(2.0 * std**2, seen))
    return np.stack((math.sqrt(0.5) * std * (left + right), 0.5 * difference_std * (left - right)))


def difference_var(calibrated_var: float, seen: FocalDifference) -> float:
    """Return E[(ε_L − ε_R)²] given what was seen and what the calibration leaves.

    A calibration that what was seen contradicts is given the variance that makes it likeliest.
    """
    seen_var = seen.std**2
    if math.isinf(seen_var):
        return calibrated_var
    calibrated_var = max(calibrated_var, seen.share**2 - seen_var)
    weight = calibrated_var / (calibrated_var + seen_var)
    return weight * seen_var + (weight * seen.share) ** 2
