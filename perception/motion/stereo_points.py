"""Corners of a stereo pair as points in space: where they are, and whether both eyes see them on one line."""

import math
from dataclasses import dataclass

import cv2
import msgspec
import numpy as np

from messages import StereoCalibration, reduced_lens
from messages.arrays import BoolArray, Float32Array, FloatArray, FloatImage, GreyImage
from perception.depth.matcher import DisparityRange, SemiGlobalMatcher
from perception.depth.rectify import Rectifier, Window
from perception.motion.corners import REACH_PX, Eye, corners, detail, is_ambiguous
from perception.motion.eye_alignment import RowSkew, median, row_skew
from perception.motion.sheared import Shear


@dataclass(frozen=True)
class View:
    """One frame: its reduced left picture, corners (N, 2) in it, their points in C (N, 3) and when each was exposed,
    relative to mid-exposure (N,)."""

    t_exposure_ns: int
    left: GreyImage
    corners_px: Float32Array
    points_C: FloatArray
    row_time_s: FloatArray


class StereoPoints:
    """Finds corners in pictures reduced to about `width_px`, and their points in C.

    Where in the right eye a corner may be, dense matching at half that size tells, with rows taken together. A floor of
    tiles that are all alike repeats itself along the rows: then one disparity is as good as another, all corners may
    agree on a wrong one, and there are no points. Nor are there beside something nearer: behind the lip of a stair the
    window that follows a corner sees the lip as well, which moves faster, and all such corners err the same way.
    """

    # Pixels are those of the reduced picture, but for the skew itself.
    width_px = 320
    rows_together = 3  # of the coarse picture, which dense matching averages
    most_beside = 0.4  # of the picture: where a frame, as of a rollator, stands all over the ground, all of it counts
    most_skew_px = 1.0  # between the eyes' rows: a larger one is a false match
    most_common_px, most_rows_spread_px = 0.65, 0.4  # median and spread of that: more, and what matches is chance
    most_ambiguous = 0.8  # of the corners: only tiles have more that look the same elsewhere along the row
    asked_first, asked_each = 12, 3  # corners of a frame of which that is asked
    asked_together = 48  # of which the share is taken

    def __init__(self, stereo: StereoCalibration) -> None:
        self._divisor = max(1, round(stereo.left.width_px / self.width_px))
        small = msgspec.structs.replace(
            stereo,
            left=reduced_lens(stereo.left, self._divisor),
            right=reduced_lens(stereo.right, self._divisor),
        )
        self._coarse = Rectifier(small, 2)
        self._matcher = SemiGlobalMatcher(self._coarse, self.rows_together)
        far_px, near_px = (self._coarse.f_px * self._coarse.baseline_m / z_m for z_m in _DEPTHS_M)
        self._search = DisparityRange.covering(far_px, near_px)
        self.R_LC, self.baseline_m = self._coarse.R_LC, self._coarse.baseline_m
        self.left = Eye(small.left, self.R_LC.T)
        self._right = Eye(small.right, self.R_LC.T @ np.array(stereo.X_RL.R).T)
        self._row_time_s = stereo.row_time_s
        self._middle_row = (stereo.left.height_px - 1) / 2
        self._ambiguous, self._asked = 0.0, 0
        self.longest_row_time_s = stereo.row_time_s * stereo.left.height_px / 2

    def detail(self, image: GreyImage) -> GreyImage:
        """Return what is followed of a raw picture."""
        return detail(image, self._divisor)

    def row_times_s(self, points_px: Float32Array) -> FloatArray:
        """Return when (N,) the rows of reduced pixels (N, 2) were exposed, relative to mid-exposure."""
        raw_row = self._divisor * (points_px[:, 1].astype(np.float64) + 0.5) - 0.5
        return (raw_row - self._middle_row) * self._row_time_s

    def view(self, t_exposure_ns: int, left: GreyImage, right: GreyImage) -> tuple[View, RowSkew | None]:
        """Return the points in a pair of reduced pictures, and how the eyes' rows differ."""
        corners_px = corners(left)
        rays_C = self.left.rays_C(corners_px) if len(corners_px) else np.empty((0, 3))
        guess = self._coarse_disparity(left, right, rays_C)
        known = np.isfinite(guess)
        corners_px, rays_C, guess = corners_px[known], rays_C[known], guess[known]
        if len(guess) == 0:
            return _without_points(t_exposure_ns, left), None
        matched_px, good = self._matched(left, right, corners_px, rays_C, guess)
        if self._repeats(left, right, corners_px[good], matched_px[good]):
            return _without_points(t_exposure_ns, left), None
        disparity, skew = self._apart(rays_C, matched_px)
        common = row_skew(skew[good], rays_C[good, 0] - disparity[good], rays_C[good, 1], self.left.f_px)
        good &= np.abs(skew) < self.most_skew_px / self.left.f_px
        good &= np.abs(disparity - guess) < 1.0 / self._coarse.f_px
        corners_px = corners_px[good]
        points_C = rays_C[good] * (self._coarse.baseline_m / disparity[good])[:, None]
        return View(t_exposure_ns, left, corners_px, points_C, self.row_times_s(corners_px)), common

    def off_px(
        self, left: GreyImage, right: GreyImage, corners_px: Float32Array, depth_m: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Return by how much (N,) the disparities that a reduced pair shows at `corners_px` (N, 2) differ from those of
        depths (N,), in reduced pixels, and at which corners it shows one: at none where the eyes' rows differ, as then
        matches are chance."""
        rays_C, expected = self.left.rays_C(corners_px), self.baseline_m / depth_m
        matched_px, good = self._matched(left, right, corners_px, rays_C, expected)
        disparity, skew = self._apart(rays_C, matched_px)
        good &= np.abs(skew) < self.most_skew_px / self.left.f_px
        if not good.any() or not self._rows_agree(skew[good]):
            good[:] = False
        return self.left.f_px * (disparity - expected), good

    def _matched(
        self, left: GreyImage, right: GreyImage, corners_px: Float32Array, rays_C: FloatArray, guess: FloatArray
    ) -> tuple[Float32Array, BoolArray]:
        """Return where (N, 2) the right eye sees corners (N, 2) of about the disparities `guess` (N,), in units of the
        focal length, and which were found there."""
        away_C = rays_C.copy()
        away_C[:, 0] -= guess
        return Shear(corners_px, self._right.pixels(away_C)).matched(left, right)

    def _apart(self, rays_C: FloatArray, matched_px: Float32Array) -> tuple[FloatArray, FloatArray]:
        """Return disparity and skew (N,), in units of the focal length, of rays (N, 3) and the right eye's pixels."""
        seen_C = self._right.rays_C(matched_px)
        return rays_C[:, 0] - seen_C[:, 0], seen_C[:, 1] - rays_C[:, 1]

    def _repeats(self, left: GreyImage, right: GreyImage, corners_px: Float32Array, matched_px: Float32Array) -> bool:
        """Return whether nearly all corners look the same elsewhere along the row, here and in the frames before."""
        count = self.asked_each if self._asked else self.asked_first
        if len(corners_px) >= count:
            asked = [k * len(corners_px) // count for k in range(count)]
            found = sum(is_ambiguous(left, right, corners_px[k], matched_px[k]) for k in asked)
            self._asked = min(self._asked + count, self.asked_together)
            self._ambiguous += count / self._asked * (found / count - self._ambiguous)
        return self._ambiguous > self.most_ambiguous

    def _rows_agree(self, skew: FloatArray) -> bool:
        """Return whether `skew` (N,), in units of the focal length, is about nothing at half of the corners or more."""
        middle = median(skew)
        px = self.left.f_px
        return px * abs(middle) < self.most_common_px and px * median(np.abs(skew - middle)) < self.most_rows_spread_px

    def _coarse_disparity(self, left: GreyImage, right: GreyImage, rays_C: FloatArray) -> FloatArray:
        """Return the disparity (N,) of rays (N, 3), in units of the focal length, to a pixel; NaN where unknown, or
        beside something nearer."""
        coarse = self._coarse
        whole = Window(0, coarse.height_px, 0, coarse.width_px)
        disparity_px = self._matcher.match(left, right, whole, self._search)
        beside = self._beside_nearer(disparity_px)
        if beside.mean() < self.most_beside:
            disparity_px[beside] = np.nan
        rows, columns = disparity_px.shape
        u = np.rint(coarse.f_px * rays_C[:, 0] + coarse.cx_px).astype(np.intp)
        v = np.floor((coarse.f_px * rays_C[:, 1] + coarse.cy_px + 0.5) * (rows / coarse.height_px)).astype(np.intp)
        inside = (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
        found_px = np.full(len(rays_C), np.nan)
        found_px[inside] = disparity_px[v[inside], u[inside]]
        found_px[found_px < _LEAST_DISPARITY_PX] = np.nan
        return found_px / coarse.f_px

    def _beside_nearer(self, disparity_px: FloatImage) -> BoolArray:
        """Return which pixels of the coarse picture (rows, columns) are behind an edge in depth, within `REACH_PX`.

        An edge is where disparity differs between neighbours by more than half of what it does between those twice as
        far apart: on a slope, however steep, it is half.
        """
        known = np.isfinite(disparity_px)
        near, far = np.where(known, disparity_px, _NO_DISPARITY), np.where(known, disparity_px, -_NO_DISPARITY)
        nearest = cv2.dilate(near, _NEIGHBOURS)
        beyond_slope = nearest - cv2.erode(far, _NEIGHBOURS)
        beyond_slope -= 0.5 * (cv2.dilate(near, _TWICE_AS_FAR) - cv2.erode(far, _TWICE_AS_FAR))
        edge = np.where(beyond_slope > _LEAST_EDGE_PX, nearest, _NO_DISPARITY)
        columns, rows = (2 * math.ceil(0.5 * REACH_PX / each) + 1 for each in (1, self.rows_together))
        beside = cv2.dilate(edge, np.ones((rows, columns), np.uint8))
        return np.asarray(disparity_px < beside - _LEAST_EDGE_PX, dtype=np.bool_)


def _without_points(t_exposure_ns: int, left: GreyImage) -> View:
    return View(t_exposure_ns, left, np.empty((0, 2), np.float32), np.empty((0, 3)), np.empty(0))


_DEPTHS_M = (3.0, 0.65)
"""Farthest and nearest that is looked for, and a little beyond: ground and stairs from a hip that looks down."""
_NO_DISPARITY = np.float32(-1e3)
"""Where none is known: nearer than nothing, and farther."""
_NEIGHBOURS, _TWICE_AS_FAR = np.ones((3, 3), np.uint8), np.ones((5, 5), np.uint8)
_LEAST_EDGE_PX = 0.5
"""Of the coarse picture, which is a jump twice as large: dense matching makes stairs nearly as high of a slope."""
_LEAST_DISPARITY_PX = 1.5
"""Of the coarse picture: with less, depth is hardly known at all."""
