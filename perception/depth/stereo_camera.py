"""A calibrated pair of cameras as a source of disparities: only what is asked for is rectified and matched."""

from collections.abc import Sequence
from typing import cast

import cv2
import numpy as np

from messages import Image, StereoCalibration
from messages.arrays import FloatArray, GreyImage
from messages.constants import MATCHING_WIDTH_PX
from perception.depth.disparity import DisparityPatch, OutOfRangeError, View
from perception.depth.eye_shifts import EyeShifts, find_shifts
from perception.depth.matcher import DisparityRange, SemiGlobalMatcher
from perception.depth.on_plane import laid_on_plane
from perception.depth.rectify import Rectifier, Window, intrinsics
from perception.depth.repeats import Repeats, find_repeats


class StereoCamera:
    """A DisparityCamera whose frames are a left and a right image, matched at about `matching_width_px`."""

    scale_residual = 0.0

    def __init__(self, stereo: StereoCalibration, matching_width_px: int = MATCHING_WIDTH_PX) -> None:
        self.rectifier = Rectifier(stereo, max(1, round(stereo.left.width_px / matching_width_px)))
        self._lens = stereo.left
        self._matcher = SemiGlobalMatcher(self.rectifier)
        self._wide_matcher = SemiGlobalMatcher(self.rectifier, speckle_px=_SPECKLE_PX)
        self.image_sizes_px = (self.rectifier.raw_size_px,) * 2
        self.f_px = self.rectifier.f_px
        self.baseline_m = self.rectifier.baseline_m
        self.R_EC: FloatArray = self.rectifier.R_LC

    def find_disparities(self, images: Sequence[Image], points_C: FloatArray) -> DisparityPatch | None:
        """Return the patch of the rectified left image that shows `points_C` (see DisparityCamera)."""
        view = view_of(points_C, self.rectifier)
        if view is None:
            return None
        return self._matched(self._matcher, images, *view)

    @property
    def tangents_down(self) -> tuple[float, float]:
        """Return y / z of the first and the last row (see DisparityCamera)."""
        rectifier = self.rectifier
        return -rectifier.cy_px / rectifier.f_px, (rectifier.height_px - 1 - rectifier.cy_px) / rectifier.f_px

    def find_in_view(self, images: Sequence[Image], view: View) -> DisparityPatch | None:
        """Return the patch that shows `view` (see DisparityCamera)."""
        rectifier = self.rectifier
        u = rectifier.f_px * np.array(view.across) + rectifier.cx_px
        v = rectifier.f_px * np.array(view.down) + rectifier.cy_px
        window = Window.cut(u, v, rectifier.width_px, rectifier.height_px)
        if window is None:
            return None
        nearest_px, farthest_px = rectifier.f_px * rectifier.baseline_m / np.array(view.depth_m)
        search = DisparityRange.covering(farthest_px, min(nearest_px, farthest_px + _MOST_DISPARITIES - _MARGIN_PX))
        return self._matched(self._wide_matcher, images, window, search)

    def laid_on_plane(self, images: Sequence[Image], patch: DisparityPatch, theta_C: FloatArray) -> DisparityPatch:
        """Return the patch in which what may be the plane is (see DisparityCamera)."""
        return laid_on_plane(self.rectifier, images, patch, theta_C)

    def _matched(
        self, matcher: SemiGlobalMatcher, images: Sequence[Image], window: Window, search: DisparityRange
    ) -> DisparityPatch:
        left, right = cast("tuple[GreyImage, GreyImage]", images)
        return DisparityPatch(
            rays_C=self.rectifier.rays_C(window),
            disparity_px=matcher.match(left, right, window, search).astype(np.float64),
            row_time_s=self.rectifier.row_time_s[window.rows, window.columns],
        )

    def blind_share(self, images: Sequence[Image], points_C: FloatArray) -> float:
        """Return the white or black part about `points_C` of that eye in which it is larger (see DisparityCamera)."""
        points_E = points_C @ self.R_EC.T
        rays = points_E / np.maximum(points_E[:, 2:], _LEAST_DEPTH_M)
        lens = self._lens
        pixels = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), intrinsics(lens), np.array(lens.distortion))[0]
        u, v = pixels.reshape(-1, 2).astype(np.float64).T
        window = Window.cut(u, v, lens.width_px, lens.height_px)
        if window is None:
            return 0.0
        parts = [image[window.rows, window.columns] for image in images]
        return max(float(np.mean((part <= _BLACK) | (part >= _WHITE))) for part in parts)

    def find_repeats(self, images: Sequence[Image], points_C: FloatArray, theta_C: FloatArray) -> Repeats:
        """Return the rivals of the plane d = r · `theta_C` where `points_C` are shown (see DisparityCamera)."""
        return find_repeats(self.rectifier, images, points_C, theta_C)

    def find_shifts(
        self,
        images: Sequence[Image],
        patch: DisparityPatch,
        points_C: FloatArray,
        theta_C: FloatArray,
        w_C_radps: FloatArray,
        v_C_mps: FloatArray,
    ) -> EyeShifts | None:
        """Return how the right eye is shifted against the left one (see DisparityCamera)."""
        (x, y, _), (rows, columns) = patch.rays_C[0, 0].tolist(), patch.disparity_px.shape
        top = round(self.rectifier.f_px * y + self.rectifier.cy_px)
        left = round(self.rectifier.f_px * x + self.rectifier.cx_px)
        window = Window(top, top + rows, left, left + columns)
        return find_shifts(self.rectifier, images, window, patch.disparity_px, points_C, theta_C, w_C_radps, v_C_mps)


def view_of(points_C: FloatArray, rectifier: Rectifier) -> tuple[Window, DisparityRange] | None:
    """Return the window and disparities that show `points_C` (N, 3), or None if the last of them is not in view.

    Raises OutOfRangeError where more than 160 disparities would be needed.
    """
    depth_m = points_C[:, 2]
    u = rectifier.f_px * points_C[:, 0] / depth_m + rectifier.cx_px
    v = rectifier.f_px * points_C[:, 1] / depth_m + rectifier.cy_px
    window = Window.around(u, v, rectifier.width_px, rectifier.height_px)
    if window is None:
        return None
    fB_px_m = rectifier.f_px * rectifier.baseline_m
    search = DisparityRange.covering(fB_px_m / depth_m.max(), fB_px_m / depth_m.min())
    if search.count > _MOST_DISPARITIES:
        raise OutOfRangeError
    return window, search


_MOST_DISPARITIES = 160
_MARGIN_PX = 3
_BLACK, _WHITE = 2, 254
_LEAST_DEPTH_M = 0.05
_SPECKLE_PX = 200  # where the search is wide, as over a flight of stairs, larger patches match by chance
