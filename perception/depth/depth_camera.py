"""A camera that delivers depth as a source of disparities, so that the ground is fitted where its noise is even."""

from collections.abc import Sequence

import cv2
import numpy as np

from messages import DepthCalibration, Image
from messages.arrays import FloatArray
from perception.depth.disparity import DisparityPatch, View
from perception.depth.eye_shifts import EyeShifts
from perception.depth.rectify import Window, intrinsics, undistorted_rays
from perception.depth.repeats import NO_REPEATS, Repeats


class DepthCamera:
    """A DisparityCamera whose frames are one depth image; the disparities are those of the pair inside it.

    No pixel is moved or mixed with a neighbour, so nothing is invented between two depths at an edge.
    """

    def __init__(self, depth: DepthCalibration) -> None:
        lens = depth.lens
        self.image_sizes_px = ((lens.width_px, lens.height_px),)
        self.f_px = lens.fx_px
        self.baseline_m = depth.baseline_m
        self.R_EC: FloatArray = np.eye(3)
        self.scale_residual = depth.scale_residual
        self._lens = lens
        self._steps_px = lens.fx_px * depth.baseline_m / depth.step_m
        self._rays_C = undistorted_rays(lens, np.arange(float(lens.width_px)), np.arange(float(lens.height_px)))
        rows = np.arange(lens.height_px) - (lens.height_px - 1) / 2
        self._row_time_s: FloatArray = np.broadcast_to(rows[:, None] * depth.row_time_s, self._rays_C.shape[:2])

    def find_disparities(self, images: Sequence[Image], points_C: FloatArray) -> DisparityPatch | None:
        """Return the patch that shows `points_C` (see DisparityCamera)."""
        lens = self._lens
        K, distortion = intrinsics(lens), np.array(lens.distortion)
        projected, _ = cv2.projectPoints(points_C, np.zeros(3), np.zeros(3), K, distortion)
        u_px, v_px = projected.reshape(-1, 2).astype(np.float64).T
        window = Window.around(u_px, v_px, lens.width_px, lens.height_px)
        if window is None:
            return None
        return self._patch(images, window)

    @property
    def tangents_down(self) -> tuple[float, float]:
        """Return y / z of the first and the last row (see DisparityCamera)."""
        middle = self._rays_C[:, self._lens.width_px // 2, 1]
        return float(middle[0]), float(middle[-1])

    def find_in_view(self, images: Sequence[Image], view: View) -> DisparityPatch | None:
        """Return the patch that shows `view` (see DisparityCamera)."""
        lens = self._lens
        corners_C = np.array([(x, y, 1.0) for x in view.across for y in view.down])
        projected, _ = cv2.projectPoints(
            corners_C, np.zeros(3), np.zeros(3), intrinsics(lens), np.array(lens.distortion)
        )
        u_px, v_px = projected.reshape(-1, 2).astype(np.float64).T
        window = Window.cut(u_px, v_px, lens.width_px, lens.height_px)
        return None if window is None else self._patch(images, window)

    def laid_on_plane(
        self,
        images: Sequence[Image],  # noqa: ARG002 - see DisparityCamera
        patch: DisparityPatch,
        theta_C: FloatArray,  # noqa: ARG002
    ) -> DisparityPatch:
        """Return the patch as it is: depth is what this camera delivers, and no match."""
        return patch

    def _patch(self, images: Sequence[Image], window: Window) -> DisparityPatch:
        seen = (window.rows, window.columns)
        steps = images[0][seen]
        unknown = np.full(steps.shape, np.nan)
        return DisparityPatch(
            rays_C=self._rays_C[seen],
            disparity_px=np.divide(self._steps_px, steps, out=unknown, where=steps > 0, dtype=np.float64),
            row_time_s=self._row_time_s[seen],
        )

    def blind_share(
        self,
        images: Sequence[Image],  # noqa: ARG002 - see DisparityCamera
        points_C: FloatArray,  # noqa: ARG002
    ) -> float:
        """Return 0: a depth image does not tell how bright it was."""
        return 0.0

    def find_repeats(
        self,
        images: Sequence[Image],  # noqa: ARG002 - see DisparityCamera
        points_C: FloatArray,  # noqa: ARG002
        theta_C: FloatArray,  # noqa: ARG002
    ) -> Repeats:
        """Return that a plane has no rivals: depth is what this camera delivers, and no match."""
        return NO_REPEATS

    def find_shifts(
        self,
        images: Sequence[Image],  # noqa: ARG002 - see DisparityCamera
        patch: DisparityPatch,  # noqa: ARG002
        points_C: FloatArray,  # noqa: ARG002
        theta_C: FloatArray,  # noqa: ARG002
        w_C_radps: FloatArray,  # noqa: ARG002
        v_C_mps: FloatArray,  # noqa: ARG002
    ) -> EyeShifts | None:
        """Return None: there is one picture."""
        return None
