"""One stereo frame and one attitude to the plane of ground at the foothold, or the reason why there is none."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from messages import GreyImage, Reason, Residual, StereoCalibration
from perception.foothold import FootholdSettings, OutOfRangeError, view_of
from perception.plane import PlaneFit, PlaneFitter
from perception.rectify import Rectifier
from perception.stereo import SemiGlobalMatcher

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class GroundMeasurement:
    """What one frame says of the ground. `plane` is in H, and None unless `reason` is NONE."""

    reason: Reason
    plane: PlaneFit | None
    matched_share: float


class GroundMeter:
    """Measures the ground plane in the foothold region, frame by frame; it keeps no memory of earlier frames."""

    matching_width_px = 640
    least_matched_share = 0.30
    least_inlier_share = 0.40
    most_pixels = 5000

    def __init__(self, stereo: StereoCalibration, residual: Residual) -> None:
        self.rectifier = Rectifier(stereo, max(1, round(stereo.left.width_px / self.matching_width_px)))
        self._matcher = SemiGlobalMatcher(self.rectifier)
        self._fitter = PlaneFitter(fB_px_m=self.rectifier.f_px * self.rectifier.baseline_m)
        self._residual = residual

    def measure(
        self,
        left: GreyImage,
        right: GreyImage,
        R_HC: FloatArray,
        w_HC_C_radps: FloatArray,
        region: FootholdSettings,
        expected: PlaneFit | None,
    ) -> GroundMeasurement:
        """Return the plane in H of the raw pair `left`, `right`, (height, width) uint8 of the calibrated size.

        `R_HC` holds at mid-exposure of the middle row; `w_HC_C_radps` turns the other rows of a rolling shutter.
        `expected` is the plane as predicted from earlier frames.
        """
        height_m, margin_m, gradient = region.nominal_height_m, region.height_margin_m, (0.0, 0.0)
        if expected is not None:
            height_m, margin_m, gradient = expected.height_m, region.step_m, expected.gradient
        try:
            view = view_of(region.footprint(height_m - margin_m, height_m + margin_m, gradient), R_HC, self.rectifier)
        except OutOfRangeError:
            return GroundMeasurement(Reason.OUT_OF_RANGE, None, 0.0)
        if view is None:
            return GroundMeasurement(Reason.FOOTHOLD_OUT_OF_VIEW, None, 0.0)
        window, search = view

        disparity_px = self._matcher.match(left, right, window, search)
        stride = max(1, round(np.sqrt(disparity_px.size / self.most_pixels)))
        disparity_px = disparity_px[::stride, ::stride]
        row_time_s = self.rectifier.row_time_s[window.rows, window.columns][::stride, ::stride, None]
        rays_C = self.rectifier.rays_C(window)[::stride, ::stride]
        # R_HC(t + τ) r ≈ R_HC (r + τ ω × r)
        rays_H = (rays_C + row_time_s * np.cross(w_HC_C_radps, rays_C)) @ R_HC.T

        points_H = rays_H * (self._fitter.fB_px_m / disparity_px)[..., None]
        inside = region.contains(points_H)
        # (1) with the expected plane: the disparity each ray would see, hence where it would meet the ground
        foreseen_px = rays_H @ (self._fitter.fB_px_m / height_m * np.array([*gradient, -1.0]))
        foreseen = region.contains(rays_H * (self._fitter.fB_px_m / np.maximum(foreseen_px, 1e-6))[..., None])
        matched_share = float(np.isfinite(disparity_px[foreseen]).mean()) if foreseen.any() else 0.0
        if matched_share < self.least_matched_share or np.count_nonzero(inside) < _LEAST_PIXELS:
            return GroundMeasurement(Reason.LOW_TEXTURE, None, matched_share)

        plane = self._fitter.fit(
            rays_H[inside],
            disparity_px[inside].astype(np.float64),
            region.emphasis(points_H[inside]),
            stride=stride,
            expected=expected,
        )
        if plane is None or plane.inlier_share < self.least_inlier_share:
            return GroundMeasurement(Reason.NOT_PLANAR, None, matched_share)
        if plane.steepness_rad > self._fitter.steepest_rad:
            return GroundMeasurement(Reason.TOO_STEEP, None, matched_share)
        return GroundMeasurement(Reason.NONE, self._with_residual(plane, R_HC), matched_share)

    def _with_residual(self, plane: PlaneFit, R_HC: FloatArray) -> PlaneFit:
        """Widen the covariance by a toe-in ε: a disparity offset f ε, which moves θ of (1) along the optical axis."""
        offset_px = self.rectifier.f_px * self._residual.toe_in_rad
        moved = self._fitter.jacobian(self._fitter.theta(plane)) @ (offset_px * R_HC[:, 2])
        return replace(plane, covariance=plane.covariance + np.outer(moved, moved))


_LEAST_PIXELS = 100
