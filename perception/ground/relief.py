"""What the foothold region holds besides one plane, as uncertainty of that plane under the foot."""

import math

import numpy as np

from messages.arrays import BoolArray, FloatArray, IntArray
from perception.ground.block_errors import covariance_of_sum
from perception.ground.cells import RegionCells
from perception.ground.plane import PlaneFit
from perception.ground.region import FootholdRegion
from perception.ground.sole import about, sole_slope_cov


def relief_cov(
    fit: PlaneFit,
    points_H: FloatArray,
    disparity_px: FloatArray,
    misfit_px: FloatArray,
    block: IntArray,
    region: FootholdRegion,
    locking_px: float,
) -> FloatArray:
    """Return the covariance (3, 3) of (a, b, h) that relief adds.

    `points_H` (N, 3) are the points given to the fit, `disparity_px` (N,) their disparities, `misfit_px` (N,) those
    minus the plane's, `block` (N,) the picture's blocks in which they lie. `locking_px` is what pixel locking leaves.
    """
    weight = region.weights(points_H)
    inlier = np.abs(misfit_px) < 3.0 * fit.noise_px
    rise_m = fit.plane.rise_m(points_H)
    locking_m = fit.plane.height_m * locking_px / float(disparity_px.mean())
    cov = _crease(region.along_m(points_H[inlier]), rise_m[inlier], weight[inlier], block[inlier], region, locking_m)
    cov[2, 2] += _step_variance_m2(rise_m, inlier, weight)
    return cov


def bumps_cov(
    fit: PlaneFit, points_H: FloatArray, disparity_px: FloatArray, misfit_px: FloatArray, region: FootholdRegion
) -> FloatArray:
    """Return the covariance (3, 3) of (a, b, h) by bumps too small to be told from a plane's noise one by one.

    Bumps slope to all sides, the matcher's errors rather towards the camera: what either slope of a sole has more than
    these errors would give it counts for both. Points as for `relief_cov`.
    """
    noise_m = fit.noise_px * fit.plane.height_m / float(disparity_px.mean())
    on_plane = points_H[np.abs(misfit_px) < 3.0 * fit.noise_px]
    slopes = np.diag(sole_slope_cov(RegionCells(on_plane, region), fit.plane.rise_m(on_plane)))
    beyond = float((slopes - (_SLOPE_PER_NOISE * noise_m) ** 2).max())
    return about(region.ahead_m, region.left_m, max(0.0, beyond) * np.eye(2))


def _step_variance_m2(rise_m: FloatArray, inlier: BoolArray, weight: FloatArray) -> float:
    """Return s (1 − s) r²: with the share 1 − s, a second surface that rises by r (RMS) may be the one underfoot."""
    if inlier.all():
        return 0.0
    share = weight[inlier].sum() / weight.sum()
    return float(share * (1.0 - share) * np.average(rise_m[~inlier] ** 2, weights=weight[~inlier]))


def _crease(
    along_m: FloatArray,
    rise_m: FloatArray,
    weight: FloatArray,
    block: IntArray,
    region: FootholdRegion,
    locking_m: float,
) -> FloatArray:
    """Return the covariance of a bend along the region, such as the foot of a ramp.

    With rise = c₀ + c₁ ξ + c₂ ξ², ξ from −1 to 1 along the half-length l, the slope wanders by 2 c₂ ξ / l about its
    middle. The mean square of that over ξ is added. The region's middle stays where it is, so h turns with the slope
    about it. What the matcher alone makes of c₂² is taken off: the variance by its errors, and that by pixel locking,
    which bends a plane by as much as it lifts it, `locking_m`, the same in all frames of a texture.
    """
    half_length_m = region.half_length_m
    xi = along_m / half_length_m
    terms = np.stack((np.ones(len(xi)), xi, xi**2), axis=-1)
    weighted = terms * weight[:, None]
    inverse = np.linalg.inv(terms.T @ weighted)
    c_m = inverse @ (weighted.T @ rise_m)
    by_errors = inverse @ covariance_of_sum(weighted * (rise_m - terms @ c_m)[:, None], block) @ inverse
    square_m2 = max(0.0, float(c_m[2] ** 2 - by_errors[2, 2]) - locking_m**2)
    across = math.tan(region.yaw_rad)
    pivot = np.array([1.0, across, region.ahead_m + across * region.left_m])
    cov: FloatArray = 4.0 / 3.0 * square_m2 / half_length_m**2 * np.outer(pivot, pivot)
    return cov


_SLOPE_PER_NOISE = np.array([5.8, 4.8])
"""Of a sole, along and across: a little more than even ground has where texture is faint, and than a real floor has."""
