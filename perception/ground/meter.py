"""One frame and one attitude to the plane of ground at the foothold, or the reason why there is none."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from messages import DepthCalibration, Image, Reason, Residual, StereoCalibration
from messages.arrays import BoolArray, FloatArray, IntArray
from messages.constants import MATCHING_WIDTH_PX
from perception.depth.depth_camera import DepthCamera
from perception.depth.disparity import DisparityCamera, DisparityPatch, OutOfRangeError
from perception.depth.eye_shifts import EyeShifts
from perception.depth.focal_lengths import UNWATCHED, FocalDifference, plane_errors_px
from perception.depth.repeats import NO_REPEATS, Repeats
from perception.depth.stereo_camera import StereoCamera
from perception.ground.block_errors import blocks
from perception.ground.plane import Plane, PlaneFit, PlaneFitter
from perception.ground.region import FootholdRegion
from perception.ground.relief import bumps_cov, relief_cov
from perception.ground.rough import is_scatter, rough_plane
from perception.ground.things import is_ground


@dataclass(frozen=True)
class GroundMeasurement:
    """What one frame says of the ground. `fit` is in H, and None unless `reason` is NONE.

    `lasting_cov` (3, 3), of (a, b, h) like the fit's own covariance, is what averaging over frames cannot reduce:
    the calibration's residual, and what the region holds besides the plane. `patch` are the disparities about it.
    """

    reason: Reason
    matched_share: float
    fit: PlaneFit | None = None
    lasting_cov: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    patch: DisparityPatch | None = None


class Pixels(NamedTuple):
    """Pixels with a disparity: their rays (N, 3) in H, disparities (N,), points (N, 3) in H, and in which block (N,) of
    the picture each lies."""

    rays_H: FloatArray
    disparity_px: FloatArray
    points_H: FloatArray
    block: IntArray

    def only(self, chosen: BoolArray) -> "Pixels":
        """Return those `chosen` (N,)."""
        return Pixels(self.rays_H[chosen], self.disparity_px[chosen], self.points_H[chosen], self.block[chosen])


class GroundMeter:
    """Measures the ground plane in the foothold region, frame by frame; it keeps no memory of earlier frames."""

    least_ground_share = 0.30
    """Of the region, matched no farther from the plane than a step: what covers an eye matches anywhere."""
    least_inlier_share = 0.30
    most_blind_share = 0.4
    even_share = 0.75
    """What fewer inliers lie on may be chance: a blurred eye matches stripes half a period off, to either side."""
    even_noise_px = 0.3
    faint_inlier_share = 0.9
    faint_factor = 2.5
    """So many times what its blocks show a plane of faint texture may be off, where matches err alike over larger
    parts of the picture: measured on the rig's poured floors."""
    most_pixels = 5000
    beside_unseen_px = 0.3
    """What all of a block errs by together, one σ, where nothing of the region but it is seen: along the border of what
    covers an eye the matcher draws by some tenths of a pixel. It falls with the share of the region that is not seen.
    """
    locking_px = 0.07
    """What interpolation between whole disparities leaves as a common offset (pixel locking), one σ: 14 units of the
    rig whose calibration is exact are off by 1.35 mm and by 0.055° ahead, RMS, which are 0.08 and 0.05 px."""

    def __init__(
        self,
        camera: StereoCalibration | DepthCalibration,
        residual: Residual,
        matching_width_px: int = MATCHING_WIDTH_PX,
    ) -> None:
        self.camera: DisparityCamera = (
            DepthCamera(camera) if isinstance(camera, DepthCalibration) else StereoCamera(camera, matching_width_px)
        )
        self._fitter = PlaneFitter(fB_px_m=self.camera.f_px * self.camera.baseline_m)
        self._residual = residual
        self._has_two_eyes = isinstance(camera, StereoCalibration)

    def measure(
        self,
        images: Sequence[Image],
        R_HC: FloatArray,
        w_HC_C_radps: FloatArray,
        height_rate_mps: float,
        region: FootholdRegion,
        expected: Plane | None,
        margin_m: float | None = None,
        focal_difference: FocalDifference = UNWATCHED,
        *,
        rough: bool = False,
    ) -> GroundMeasurement:
        """Return the plane in H of a frame's raw `images`, (height, width) each, of the calibrated sizes.

        `R_HC` holds at mid-exposure of the middle row; for the other rows of a rolling shutter `w_HC_C_radps` turns
        the camera and `height_rate_mps` lifts it off the ground.
        `expected` is the plane as predicted from earlier frames; the ground is looked for within `margin_m` of it, or
        within a step. `focal_difference` is what the eyes' rows tell of their focal lengths. Where the path has been
        `rough`, a plane on which nearly all lies is that of the top of a bump; where it has not, bumps are none yet:
        they may be what a wet lens or a late eye matches.
        """
        predicted = expected or Plane((0.0, 0.0), region.nominal_height_m)
        if margin_m is None:
            margin_m = region.height_margin_m if expected is None else region.step_m
        corners_H = region.footprint(predicted, margin_m)
        points_C = np.vstack((corners_H, corners_H.mean(axis=0))) @ R_HC
        if points_C[:, 2].min() < _LEAST_DEPTH_M:
            return GroundMeasurement(Reason.FOOTHOLD_OUT_OF_VIEW, 0.0)
        try:
            patch = self.camera.find_disparities(images, points_C)
        except OutOfRangeError:
            return GroundMeasurement(Reason.OUT_OF_RANGE, 0.0)
        if patch is None:
            return GroundMeasurement(Reason.FOOTHOLD_OUT_OF_VIEW, 0.0)
        thin, stride = patch.thinned(self.most_pixels)
        rays_H, disparity_px = thin.rays_H(R_HC, w_HC_C_radps, height_rate_mps / predicted.height_m), thin.disparity_px

        fB_px_m = self._fitter.fB_px_m
        predicted_px = np.maximum(rays_H @ predicted.theta(fB_px_m), _LEAST_DISPARITY_PX)
        on_predicted = region.contains(rays_H * (fB_px_m / predicted_px)[..., None])
        matched_share = float(np.isfinite(disparity_px[on_predicted]).mean()) if on_predicted.any() else 0.0
        points_H = rays_H * (fB_px_m / disparity_px)[..., None]
        rise_m = predicted.rise_m(points_H)
        near = np.abs(rise_m) < margin_m
        ground_share = float(near[on_predicted].mean()) if on_predicted.any() else 0.0
        if ground_share < self.least_ground_share or np.count_nonzero(near & region.contains(points_H)) < _LEAST_PIXELS:
            return GroundMeasurement(self._unseen(Reason.LOW_TEXTURE, images, points_C), matched_share)
        unseen_share = 1.0 - float((rise_m[on_predicted] > -margin_m).mean())

        all_near = Pixels(rays_H[near], disparity_px[near], points_H[near], blocks(disparity_px.shape, stride)[near])
        common_px = self.beside_unseen_px * unseen_share
        pixels, fit = self._fitted(all_near, region, common_px, expected)
        points_H, disparity_px = pixels.points_H, pixels.disparity_px
        if rough or fit is None or not self.is_even(fit) or fit.noise_px > self.even_noise_px:
            through = rough_plane(points_H, disparity_px / np.abs(points_H[:, 2]), region, known=rough)
            if through is not None and not rough:
                return GroundMeasurement(self._unseen(Reason.NOT_PLANAR, images, points_C), matched_share)
            if through is not None:
                lasting = self._residual_cov(through.plane, R_HC, focal_difference)
                return GroundMeasurement(Reason.NONE, matched_share, through, lasting, patch)
        if rough or fit is None or not self._is_plane(fit, points_H, region, expected):
            return GroundMeasurement(self._unseen(Reason.NOT_PLANAR, images, points_C), matched_share)
        if fit.plane.steepness_rad > (STEEPEST_BOUNDED_RAD if region.bounded else self._fitter.steepest_rad):
            return GroundMeasurement(Reason.TOO_STEEP, matched_share)
        misfit_px = self._misfit_px(pixels, fit)
        ground = is_ground(points_H, fit.plane.rise_m(points_H), np.abs(misfit_px) < 3.0 * fit.noise_px, region)
        if not ground.all():
            pixels = pixels.only(ground)
            points_H, disparity_px = pixels.points_H, pixels.disparity_px
            fit = self._refitted(pixels, region, common_px, fit)
            misfit_px = self._misfit_px(pixels, fit)
        if self._is_faint(fit):
            fit = replace(fit, covariance=self.faint_factor**2 * fit.covariance)
        lasting = self._residual_cov(fit.plane, R_HC, focal_difference)
        lasting += relief_cov(fit, points_H, disparity_px, misfit_px, pixels.block, region, self.locking_px)
        if fit.noise_px <= self.even_noise_px:
            lasting += bumps_cov(fit, points_H, disparity_px, misfit_px, region)
        if region.bounded:
            fit = replace(fit, covariance=fit.covariance + beside_borders(region))
        return GroundMeasurement(Reason.NONE, matched_share, fit, lasting, patch)

    def _fitted(
        self, near: Pixels, region: FootholdRegion, common_px: float, expected: Plane | None
    ) -> tuple[Pixels, PlaneFit | None]:
        """Return the plane of the pixels over `region`, and those pixels.

        Where they were measured says which are over it, and how much each counts, for a first plane only. A disparity
        that is too large shows a point too near and too high, one that is too small too far and too low: by measured
        places the region would gain the former at its far end and the latter at its near one, and rise ahead by 0.5°
        where it is short. On the plane errors move no point.
        """
        inside = near.only(region.contains(near.points_H))
        fit = self._fitter.fit(
            inside.rays_H,
            inside.disparity_px,
            region.weights(inside.points_H),
            block=inside.block,
            common_px=common_px,
            expected=expected,
        )
        if fit is None:
            return inside, None
        about = replace(
            region, half_length_m=region.half_length_m + _ERRS_M, half_width_m=region.half_width_m + _ERRS_M
        )
        inside = near.only(region.contains(self._on_plane(near, fit)) & about.contains(near.points_H))
        return inside, self._refitted(inside, region, common_px, fit)

    def _refitted(self, pixels: Pixels, region: FootholdRegion, common_px: float, fit: PlaneFit) -> PlaneFit:
        """Return the plane near that of `fit` which the pixels support, or `fit` where they are too few."""
        weight = region.weights(self._on_plane(pixels, fit))
        return (
            self._fitter.refined(pixels.rays_H, pixels.disparity_px, weight, fit.plane, pixels.block, common_px) or fit
        )

    def _on_plane(self, pixels: Pixels, fit: PlaneFit) -> FloatArray:
        """Return where (N, 3) in H the pixels' rays meet the plane."""
        fB_px_m = self._fitter.fB_px_m
        on_plane_px = np.maximum(pixels.rays_H @ fit.plane.theta(fB_px_m), _LEAST_DISPARITY_PX)
        points_H: FloatArray = pixels.rays_H * (fB_px_m / on_plane_px)[:, None]
        return points_H

    def _misfit_px(self, pixels: Pixels, fit: PlaneFit) -> FloatArray:
        misfit_px: FloatArray = pixels.disparity_px - pixels.rays_H @ fit.plane.theta(self._fitter.fB_px_m)
        return misfit_px

    def _is_plane(self, fit: PlaneFit, points_H: FloatArray, region: FootholdRegion, expected: Plane | None) -> bool:
        """Return whether a plane is what is seen, and not clutter: on faint texture only one that is expected, about
        which nearly all scatters."""
        if not self._is_faint(fit):
            return fit.inlier_share >= self.least_inlier_share
        nearly_all = expected is not None and fit.inlier_share >= self.faint_inlier_share
        return nearly_all and is_scatter(points_H, fit.plane.rise_m(points_H), region)

    def _is_faint(self, fit: PlaneFit) -> bool:
        """Return whether disparities scatter as matches of faint texture do, or of none."""
        return fit.noise_px >= self._fitter.most_noise_px

    def is_even(self, fit: PlaneFit) -> bool:
        """Return whether nearly all that is near the plane lies on it, and not on bumps about it, or on another."""
        return fit.inlier_share >= self.even_share and fit.rough_m == 0.0

    def _unseen(self, reason: Reason, images: Sequence[Image], points_C: FloatArray) -> Reason:
        """Return why there is no plane about `points_C` (N, 3): `reason`, unless it is that nothing can be seen."""
        blind = self.camera.blind_share(images, points_C) > self.most_blind_share
        return Reason.OVER_EXPOSED if blind else reason

    def find_repeats(self, images: Sequence[Image], R_HC: FloatArray, region: FootholdRegion, plane: Plane) -> Repeats:
        """Return the planes as steep as `plane`, in H, that match as well as it where the ground repeats itself."""
        corners_C = region.footprint(plane, 0.0) @ R_HC
        if corners_C[:, 2].min() < _LEAST_DEPTH_M:
            return NO_REPEATS
        return self.camera.find_repeats(images, corners_C, R_HC.T @ plane.theta(self._fitter.fB_px_m))

    def find_shifts(
        self,
        images: Sequence[Image],
        R_HC: FloatArray,
        region: FootholdRegion,
        measured: GroundMeasurement,
        w_C_radps: FloatArray,
        v_C_mps: FloatArray,
    ) -> EyeShifts | None:
        """Return how one eye is shifted against the other about the plane that was measured; None where unknown."""
        if measured.fit is None or measured.patch is None:
            return None
        plane = measured.fit.plane
        corners_C = region.footprint(plane, 0.0) @ R_HC
        if corners_C[:, 2].min() < _LEAST_DEPTH_M:
            return None
        theta_C = R_HC.T @ plane.theta(self._fitter.fB_px_m)
        return self.camera.find_shifts(images, measured.patch, corners_C, theta_C, w_C_radps, v_C_mps)

    @property
    def rows_px(self) -> float:
        """Return by how much, 1 σ, the calibration leaves one eye's picture shifted here and there."""
        return self.camera.f_px * self._residual.rows_rad

    def offset_cov(self, plane: Plane, R_HC: FloatArray, theta_C: FloatArray) -> FloatArray:
        """Return the covariance (3, 3) of (a, b, h) by independent errors of the disparities d = r · θ, in C.

        Each row of `theta_C` (N, 3), px, is one standard deviation of one error.
        """
        moved = self._fitter.jacobian(plane.theta(self._fitter.fB_px_m)) @ R_HC @ theta_C.T
        cov: FloatArray = moved @ moved.T
        return cov

    def _residual_cov(self, plane: Plane, R_HC: FloatArray, focal_difference: FocalDifference) -> FloatArray:
        """Return the covariance of (a, b, h) by what the calibration leaves, the same in all frames.

        A common offset of d moves θ of (1) along C's z: a toe-in ε gives an offset f ε; pixel locking gives another.
        Focal lengths move it as `focal_lengths` has it. A wrong scale of depth, or baseline, stretches h alone.
        """
        offset_px = np.hypot(self.camera.f_px * self._residual.toe_in_rad, self.locking_px)
        errors_px = np.array([[0.0, 0.0, offset_px]])
        scale = self.camera.scale_residual
        if self._has_two_eyes:
            theta_C = R_HC.T @ plane.theta(self._fitter.fB_px_m)
            std = self._residual.focal_length_std
            errors_px = np.vstack((errors_px, plane_errors_px(theta_C, self.camera.f_px, std, focal_difference)))
            scale = self._residual.baseline_std
        cov = self.offset_cov(plane, R_HC, errors_px)
        cov[2, 2] += (plane.height_m * scale) ** 2
        return cov


def beside_borders(region: FootholdRegion) -> FloatArray:
    """Return the covariance (3, 3) of (a, b, h) by what the matcher draws over a border into a short region: it tips
    the plane about the region's middle, along and, as it is drawn unevenly, across."""
    along = _DRAWN_OVER_M / (_RADIUS_OF_GYRATION * region.half_length_m) * np.array([1.0, 0.0, region.ahead_m])
    across = _DRAWN_UNEVENLY_M / (_RADIUS_OF_GYRATION * region.half_width_m) * np.array([0.0, 1.0, region.left_m])
    cov: FloatArray = np.outer(along, along) + np.outer(across, across)
    return cov


STEEPEST_BOUNDED_RAD = float(np.radians(15.0))
"""Between two edges nothing is steeper that one steps on: what is, the matcher makes of an edge."""
_DRAWN_OVER_M = 0.0015
_DRAWN_UNEVENLY_M = 0.0005
"""Of what is drawn over, by which left and right differ: it is drawn beside borders alone, by patches."""
_RADIUS_OF_GYRATION = 0.577  # of a uniform stretch, in half-lengths
_ERRS_M = 0.04
"""So far along the ray a point may be measured from where it is: farther, and it is something before the ground."""
_LEAST_DEPTH_M = 0.1
_LEAST_PIXELS = 100
_LEAST_DISPARITY_PX = 1e-6
