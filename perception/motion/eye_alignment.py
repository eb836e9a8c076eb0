"""Whether the eyes stand to each other as calibrated, by how much lower the right one sees corners than the left one.

Both eyes see on one row what lies on it, however far. A right eye that is turned by the small angles ν about its x, τ
about its y and ρ about its z, and whose focal length, over the left one's, is 1 + γ times what the calibration says,
sees what belongs on its ray (x, y, 1) lower by

    s = ν + ρ x + γ y + τ x y,                                                                                (1)

ν y² apart, which is small where ν is. With ρ the disparity grows from row to row, and the ground seems to rise or to
fall; with τ all is as much nearer; with γ the ground leans to one side.
"""

import math
from typing import NamedTuple

import numpy as np

from messages.arrays import FloatArray
from perception.depth.focal_lengths import UNWATCHED, FocalDifference


class RowSkew(NamedTuple):
    """(1) of one frame: the median of s; ρ, γ and τ (3,), and their covariance (3, 3) by chance."""

    median: float
    by_place: FloatArray
    covariance: FloatArray


def row_skew(lower: FloatArray, x: FloatArray, y: FloatArray, f_px: float) -> RowSkew | None:
    """Return (1) by robust least squares (Cauchy's weights) of how much `lower` (N,) than calibrated the right eye sees
    corners on its rays (x, y, 1), all (N,); None of too few of them, or where they do not agree on any."""
    if len(lower) < _LEAST_CORNERS:
        return None
    terms = np.stack((np.ones_like(x), x, y, x * y), axis=-1)
    middle = median(lower)
    off = lower - middle
    for _ in range(_ROUNDS):
        spread = max(median(np.abs(off)), _TINY)
        weighted = terms / (1.0 + (off / (_FAR_SPREADS * spread)) ** 2)[:, None]
        normal = weighted.T @ terms + _PRIOR
        of_terms = np.linalg.solve(normal, weighted.T @ lower)
        off = lower - terms @ of_terms
    spread = median(np.abs(off))
    if f_px * spread >= _MOST_SPREAD_PX:
        return None
    covariance = (_STD_OF_SPREAD * spread) ** 2 * np.linalg.inv(normal)
    return RowSkew(middle, of_terms[1:], covariance[1:, 1:])


class EyeAlignment:
    """Averages what frames show of (1); for one pair of eyes.

    The eyes are misaligned from the first frame that says so until `confirmations` in a row deny it: matching
    tolerates `most_px`.
    """

    most_px = 2.0  # raw pixels, up or down
    confirmations = 3  # frames: one good frame among bad ones is chance
    most_by_place = (0.0015, 0.0015, 0.003)  # of ρ, γ and τ: heights wrong by a centimetre, slopes by a degree
    calibrated_sigmas = 3.0  # that the calibration may leave of ρ and τ
    sigmas = 4.0  # of chance
    averaged_frames = 60  # some seconds of walking: what one frame says is mostly noise
    newly_seen = 0.006  # of a ray's tangent: a pixel of the reduced picture, after which a match errs otherwise
    lasting_std = 3e-4  # what no average is better than: corners are matched a little off, always alike

    def __init__(self, f_px: float, rows_rad: float) -> None:
        """`f_px` is the focal length, raw pixels; `rows_rad`, 1 σ, by how much the calibration leaves one eye's picture
        moved against the other's."""
        self._f_px = f_px
        left = self.calibrated_sigmas * rows_rad
        self._most = np.maximum(self.most_by_place, (left, 0.0, left))
        self._information, self._weighted = np.zeros((3, 3)), np.zeros(3)
        self._common_error = 0.0
        self._aligned_frames = self.confirmations

    @property
    def contradicts(self) -> bool:
        """Return whether the eyes do not stand as calibrated."""
        return self._aligned_frames < self.confirmations

    @property
    def focal_difference(self) -> FocalDifference:
        """Return what the eyes' rows tell of the difference between their focal lengths."""
        if not self._information.any():
            return UNWATCHED
        by_place, std = self._average()
        return FocalDifference(-float(by_place[1]), math.hypot(self.lasting_std, float(std[1])))

    def add(self, skew: RowSkew | None, moved: float, common_error: float) -> None:
        """Take what the newest frame shows, if it shows anything.

        Its corners have moved by `moved`, of a ray's tangent, since the frame before: seen again at the same pixels
        they err as they did, and count by how far they have moved. All may err by `common_error` in frame after frame.
        """
        if skew is None:
            return
        self._common_error = common_error
        self._begin_anew_where_changed(skew)
        new = min(1.0, moved / self.newly_seen) if self._information.any() else 1.0
        kept, information = 1.0 - new / self.averaged_frames, new * np.linalg.inv(skew.covariance)
        self._information = kept * self._information + information
        self._weighted = kept * self._weighted + information @ skew.by_place
        by_place, std = self._average()
        beyond = np.abs(by_place) - self._most
        if (beyond > self.sigmas * std).any() or self._f_px * abs(skew.median) > self.most_px:
            self._aligned_frames = 0
        elif (beyond <= self.sigmas * self._chance).all():  # what corners may share accuses nobody, and acquits nobody
            self._aligned_frames += 1

    def _average(self) -> tuple[FloatArray, FloatArray]:
        """Return ρ, γ and τ (3,), and the deviations of each by chance and by what corners share."""
        by_place: FloatArray = np.linalg.solve(self._information, self._weighted).astype(np.float64)
        return by_place, np.hypot(self._chance, self._common_error)

    @property
    def _chance(self) -> FloatArray:
        chance: FloatArray = np.sqrt(np.linalg.inv(self._information).diagonal())
        return chance

    def _begin_anew_where_changed(self, skew: RowSkew) -> None:
        """Forget the frames before where the newest shows something else: an eye was knocked, or put right."""
        if not self._information.any():
            return
        by_place, std = self._average()
        chance = np.sqrt(std**2 + skew.covariance.diagonal())
        if (np.abs(skew.by_place - by_place) > self.sigmas * chance + self._most).any():
            self._information, self._weighted = np.zeros((3, 3)), np.zeros(3)


def median(values: FloatArray) -> float:
    """Return the median of `values` (N,): numpy's takes five times as long over so few."""
    half = len(values) // 2
    parted = np.partition(values, half)
    upper = float(parted[half])
    return upper if len(values) % 2 else 0.5 * (float(parted[:half].max()) + upper)


_LEAST_CORNERS = 20
"""For four terms of which false matches may not make one."""
_MOST_SPREAD_PX = 0.2
"""Median about (1): more, and the matches do not agree on any."""
_ROUNDS = 5
_FAR_SPREADS, _STD_OF_SPREAD = 3.0, 2.2
"""Median deviations: where a weight is halved, and in one standard deviation of what one frame shows beside another,
half as much again as of normal errors: neighbours err alike."""
_PRIOR = np.diag((0.0, 1e-4, 1e-4, 1e-4))
"""So little is known of a term that the corners' places say nothing about."""
_TINY = 1e-12
