"""A plane through the foothold region, fitted in disparity space, where the matching noise is even.

A plane z = a x + b y − h in H (a, b its gradient, h the height of the optical centre above its intercept; the
thesis's Eq. 7 with a, b negated) is seen by the ray r with the disparity

    d(r) = (f B / h) (a r_x + b r_y − r_z) = r · θ,      θ = (f B / h) (a, b, −1),                            (1)

linear in θ whatever the rotation of each ray, so the row times of a rolling shutter only turn the rays.
"""

from dataclasses import dataclass

import numpy as np

from messages.arrays import FloatArray, IntArray
from perception.ground.block_errors import covariance_of_sum, sums_of


@dataclass(frozen=True)
class Plane:
    """z = gradient · (x, y) − height_m in a gravity-aligned frame whose origin is the left optical centre."""

    gradient: tuple[float, float]
    height_m: float

    @property
    def abh(self) -> FloatArray:
        """Return (a, b, h)."""
        return np.array([*self.gradient, self.height_m])

    @property
    def steepness_rad(self) -> float:
        """Return the angle between the plane and the horizontal."""
        return float(np.arctan(np.hypot(*self.gradient)))

    def rise_m(self, points: FloatArray) -> FloatArray:
        """Return how far points (..., 3) lie above the plane, vertically."""
        rise: FloatArray = points[..., 2] - points[..., :2] @ np.array(self.gradient) + self.height_m
        return rise

    def theta(self, fB_px_m: float) -> FloatArray:
        """Return θ of (1)."""
        return fB_px_m / self.height_m * np.array([*self.gradient, -1.0])


@dataclass(frozen=True)
class PlaneFit:
    """A fitted plane with the covariance (3, 3) of its (a, b, h).

    `noise_px` is the robust standard deviation of the inliers' disparities, `inlier_share` the weighted share of
    the matched pixels within three of them. `rough_m` is the size of bumps that the plane goes through, one σ.
    """

    plane: Plane
    covariance: FloatArray
    noise_px: float
    inlier_share: float
    rough_m: float = 0.0


@dataclass(frozen=True)
class PlaneFitter:
    """Robust fit: consensus over sampled planes, then Tukey's biweight.

    `fB_px_m` is focal length times baseline.
    """

    fB_px_m: float
    samples: int = 96
    consensus_pixels: int = 600
    tolerance_px: float = 0.35
    least_noise_px: float = 0.04
    most_noise_px: float = 0.6
    steepest_rad: float = float(np.radians(40.0))
    iterations: int = 6

    def fit(
        self,
        rays: FloatArray,
        disparity_px: FloatArray,
        weight: FloatArray,
        *,
        block: IntArray | None = None,
        common_px: float = 0.0,
        expected: Plane | None = None,
    ) -> PlaneFit | None:
        """Return the plane best supported by rays (N, 3) in H seen at `disparity_px` (N,), or None if none is.

        `weight` (N,) ≥ 0 says how much each pixel counts, `block` (N,) in which block of the picture it lies, within
        which errors are alike; without it all errors are independent. All of a block err by `common_px`, one σ, besides
        what their misfit shows. `expected` joins the candidates. Planes steeper
        than `steepest_rad` (risers, walls) are no candidates. Deterministic: the samples come from a fixed sequence.
        """
        theta = self._consensus(rays, disparity_px, weight, expected)
        block = np.arange(len(weight)) if block is None else block
        return None if theta is None else self._refine(rays, disparity_px, weight, theta, block, common_px)

    def refined(
        self,
        rays: FloatArray,
        disparity_px: FloatArray,
        weight: FloatArray,
        plane: Plane,
        block: IntArray,
        common_px: float,
    ) -> PlaneFit | None:
        """Return the plane near `plane` that these pixels support, all as for `fit`; None where too few do."""
        return self._refine(rays, disparity_px, weight, plane.theta(self.fB_px_m), block, common_px)

    def _consensus(
        self, rays: FloatArray, disparity_px: FloatArray, weight: FloatArray, expected: Plane | None
    ) -> FloatArray | None:
        count = len(disparity_px)
        chance = np.random.default_rng(count)
        triples = chance.choice(count, size=(self.samples, 3), p=weight / weight.sum())
        triples = triples[np.abs(np.linalg.det(rays[triples])) > 1e-9]
        if len(triples) == 0:
            return None
        candidates = np.linalg.solve(rays[triples], disparity_px[triples][..., None])[..., 0]
        if expected is not None:
            candidates = np.vstack((candidates, expected.theta(self.fB_px_m)))
        below = candidates[:, 2] < 0.0
        steepness = np.hypot(candidates[:, 0], candidates[:, 1]) < np.tan(self.steepest_rad) * -candidates[:, 2]
        candidates = candidates[below & steepness]
        if len(candidates) == 0:
            return None
        some = chance.choice(count, size=min(count, self.consensus_pixels), replace=False)
        misfit = np.abs(candidates @ rays[some].T - disparity_px[some])
        # MSAC: the cost of a pixel grows with the square of its misfit up to the tolerance and no further
        cost = np.minimum(misfit / self.tolerance_px, 1.0) ** 2 @ weight[some]
        best: FloatArray = candidates[np.argmin(cost)]
        return best

    def _refine(
        self,
        rays: FloatArray,
        disparity_px: FloatArray,
        weight: FloatArray,
        theta: FloatArray,
        block: IntArray,
        common_px: float,
    ) -> PlaneFit | None:
        scale_px = self.tolerance_px
        inverse = np.empty((3, 3))
        for _ in range(self.iterations):
            misfit = np.abs(disparity_px - rays @ theta)
            near = misfit < 3.0 * scale_px
            if np.count_nonzero(near) < _LEAST_PIXELS:
                return None
            scale_px = 1.4826 * _weighted_median(misfit[near], weight[near])
            # without a maximum the scale of mere clutter would grow until all of it were inliers
            scale_px = float(np.clip(scale_px, self.least_noise_px, self.most_noise_px))
            tukey = weight * np.clip(1.0 - (misfit / (_TUKEY * scale_px)) ** 2, 0.0, None) ** 2
            weighted = rays * tukey[:, None]
            try:
                inverse = np.linalg.inv(rays.T @ weighted)
            except np.linalg.LinAlgError:
                return None
            before, theta = theta, inverse @ (weighted.T @ disparity_px)
            if np.abs(theta - before).max() < _SETTLED_PX:
                break
        if theta[2] >= 0.0:
            return None
        misfit = disparity_px - rays @ theta
        # an M-estimator's covariance [Huber, Robust Statistics, 1981, 7.6]: its weights overrate what the far ones tell
        square = np.minimum((misfit / (_TUKEY * scale_px)) ** 2, 1.0)
        told = float(weight @ ((1.0 - square) * (1.0 - 5.0 * square))) / float(tukey.sum())
        middle = covariance_of_sum(weighted * misfit[:, None], block) / max(told, _LEAST_TOLD) ** 2
        together = sums_of(weighted, block)
        theta_cov = inverse @ (middle + common_px**2 * together @ together.T) @ inverse
        inliers = np.abs(misfit) < 3.0 * scale_px
        to_plane = self.jacobian(theta)
        return PlaneFit(
            plane=Plane(
                gradient=(float(-theta[0] / theta[2]), float(-theta[1] / theta[2])),
                height_m=float(-self.fB_px_m / theta[2]),
            ),
            covariance=to_plane @ theta_cov @ to_plane.T,
            noise_px=scale_px,
            inlier_share=float(weight[inliers].sum() / weight.sum()),
        )

    def jacobian(self, theta: FloatArray) -> FloatArray:
        """Return ∂(a, b, h)/∂θ of (1), (3, 3)."""
        t = theta[2]
        return np.array(
            [
                [-1.0 / t, 0.0, theta[0] / t**2],
                [0.0, -1.0 / t, theta[1] / t**2],
                [0.0, 0.0, self.fB_px_m / t**2],
            ]
        )


_LEAST_PIXELS = 30
_TUKEY = 4.685
"""Scales beyond which the biweight counts nothing: 95 % efficient where errors are normal."""
_LEAST_TOLD = 0.2
"""Share of its weights that a fit may be worth; among clutter it can vanish."""
_SETTLED_PX = 1e-3
"""A change of θ that moves no pixel by more than about this is the last one: far below what a plane is known to."""


def _weighted_median(values: FloatArray, weight: FloatArray) -> float:
    order = np.argsort(values)
    cumulative = np.cumsum(weight[order])
    return float(values[order[np.searchsorted(cumulative, 0.5 * cumulative[-1])]])
