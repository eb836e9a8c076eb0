"""Are distances as calibrated across the picture? Bent ones move as no rigid body does.

Where disparities are too small by b x + c y at (x, y, 1), points on one side are taken for farther than they are, and
those on the other for nearer. While the camera travels, the former pass faster than they should and the latter slower,
whatever their distances are and however the camera turns: b and c follow from two left pictures and the distances of
the first.
Only a share k d of disparities d is seen in no motion, as it is that of a speed 1 + k times as high: it is the scale of
distances, which the IMU tells.

So a window that is bent about the upright axis of the picture, or an eye toed in or rolled, is told from pictures alone
within a second of walking, and before any jump: neither rows nor a ground that seems even have part in this. So is that
distances are right again.
"""

import math
from typing import NamedTuple

import numpy as np

from messages import Residual
from messages.arrays import FloatArray


class Bend(NamedTuple):
    """What one step tells of b and c, in units of the focal length: the information (2, 2) on them, and that times
    them (2,)."""

    information: FloatArray
    weighted: FloatArray


class BentDistances:
    """Averages what the steps of one pair of eyes tell; `contradicts` while distances are bent."""

    most = 1.2e-3  # rad for each of x and y: 0.6° of slope, with the ground at eight times the baseline
    calibrated_sigmas = 3.0  # that the calibration may leave
    sigmas = 4.0  # of chance
    averaged_steps = 12  # of those that tell anything
    least_std = 3.5e-3  # a step that tells less, as of one who stands, is none
    known_std = 3e-4  # of both, from which on nothing bent is called straight

    def __init__(self, residual: Residual) -> None:
        shifts = math.hypot(residual.rows_rad, residual.toe_in_rad, math.sqrt(2.0) * residual.focal_length_std)
        self._most = max(self.most, self.calibrated_sigmas * shifts)
        self.forget()

    def forget(self) -> None:
        """Judge by the steps to come."""
        self._information, self._weighted = np.zeros((2, 2)), np.zeros(2)
        self.contradicts, self.is_straight = False, False

    def add(self, bend: Bend, common_error: float) -> None:
        """Take what a step tells, whose corners may all err by `common_error`, of a ray's tangent.

        `is_straight` from when enough steps say that nothing is bent.
        """
        if bend.information.diagonal().min() * self.least_std**2 < 1.0:
            return
        kept = 1.0 - 1.0 / self.averaged_steps
        self._information = kept * self._information + bend.information
        self._weighted = kept * self._weighted + bend.weighted
        covariance = np.linalg.inv(self._information)
        size, std = np.abs(covariance @ self._weighted), np.sqrt(covariance.diagonal() + common_error**2)
        self.contradicts = bool((size - self.sigmas * std > self._most).any())
        self.is_straight = bool((size < self._most).all() and (std < self.known_std).all())
