"""A profile cut into surfaces: the partition into straight pieces that explains it best.

With bins k at u_k of height z_k and weight w_k, a piece [i, j) costs what its line leaves, and each piece a penalty:

    C(i, j) = min over α, β of Σ w_k (z_k − α − β u_k)² + β² / σ_β² + λ                                          (1)
    F(j) = min( min over i of F(i) + C(i, j),  F(j − 1) + g [bin j − 1 is even] )                                (2)

F(n) is the least cost of all (optimal partitioning); a single bin may be left out for g. All sums of (1) are
differences of cumulative ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from messages.arrays import FloatArray, IntArray
from perception.terrain.profile import BIN_M, BINS, FIRST_M, Profile


@dataclass(frozen=True)
class Surface:
    """A straight piece of the path from `from_m` to `to_m` along u: z = `height_m` + `slope` (u − `middle_m`).

    `height_sd_m` and `slope_sd` are uncorrelated. `far_bins_sd_m` is how far each bin of its last half metre is off,
    one σ, as if all were shown and equally sure.
    """

    from_m: float
    to_m: float
    middle_m: float
    height_m: float
    slope: float
    height_sd_m: float
    slope_sd: float
    far_bins_sd_m: float = 0.006

    def at(self, u_m: float) -> float:
        """Return z at `u_m`, also beyond the ends."""
        return self.height_m + self.slope * (u_m - self.middle_m)

    def sd_at(self, u_m: float) -> float:
        """Return one σ of z there."""
        return float(np.hypot(self.height_sd_m, self.slope_sd * (u_m - self.middle_m)))


@dataclass(frozen=True)
class PathSurfaces:
    """The surfaces of one frame's path, in their order along u = x + y tan(`yaw_rad`) of H."""

    surfaces: Sequence[Surface]
    yaw_rad: float

    def nearest(self, u_m: float) -> Surface | None:
        """Return the surface at `u_m`, or else the nearest one; None where there is none."""
        return min(self.surfaces, key=lambda s: max(s.from_m - u_m, u_m - s.to_m), default=None)

    def points_H(self, surface: Surface, u_m: FloatArray, y_m: FloatArray) -> FloatArray:
        """Return points (n, 3) in H on a surface, or beyond its ends, at u (n,) and y (n,)."""
        z_m = surface.height_m + surface.slope * (u_m - surface.middle_m)
        return np.column_stack((u_m - y_m * np.tan(self.yaw_rad), y_m, z_m))


def find_surfaces(profile: Profile) -> list[Surface]:
    """Return the surfaces of a profile in their order along the path."""
    even = profile.even
    weight = np.where(even, 1.0 / profile.deviation_m**2, 0.0)
    height_m = np.where(even, profile.height_m, 0.0)
    fit = _Fits(weight, height_m)
    cost = fit.cost + _PENALTY
    left_out = np.concatenate(([0.0], np.cumsum(_LEFT_OUT * even)))
    least, came_from = np.zeros(BINS + 1), np.full(BINS + 1, -1)
    for j in range(1, BINS + 1):
        least[j] = least[j - 1] + left_out[j] - left_out[j - 1]
        if j >= _LEAST_BINS:
            costs = least[: j - _LEAST_BINS + 1] + cost[: j - _LEAST_BINS + 1, j]
            i = int(np.argmin(costs))
            if costs[i] < least[j]:
                least[j], came_from[j] = costs[i], i
    surfaces = []
    j = BINS
    while j > 0:
        i = int(came_from[j])
        if i < 0:
            j -= 1
            continue
        bins = i + np.flatnonzero(even[i:j])
        if len(bins) >= _LEAST_EVEN:
            surfaces.append(fit.surface(i, j, bins))
        j = i
    return surfaces[::-1]


class _Fits:
    """Lines (1) through every stretch of bins at once."""

    def __init__(self, weight: FloatArray, height_m: FloatArray) -> None:
        u, z = FIRST_M + (np.arange(BINS) + 0.5) * BIN_M, height_m
        sums = np.zeros((6, BINS + 1))
        np.cumsum(weight * np.stack((np.ones(BINS), u, z, u * u, u * z, z * z)), axis=1, out=sums[:, 1:])
        w, wu, wz, wuu, wuz, wzz = sums[:, None, :] - sums[:, :, None]
        self._w = np.maximum(w, _TINY)
        self._u_mean, self._z_mean = wu / self._w, wz / self._w
        self._uu = np.maximum(wuu - wu * self._u_mean, 0.0) + _SLOPE_SIGMA**-2
        self._slope = (wuz - wu * self._z_mean) / self._uu
        self.cost = np.maximum(wzz - wz * self._z_mean - self._slope**2 * self._uu, 0.0)
        self.cost[np.abs(self._slope) > STEEPEST] = np.inf  # nobody walks on a line over the nosings of stairs

    def surface(self, i: int, j: int, bins: IntArray) -> Surface:
        """Return the line through [i, j), of which `bins` are even."""
        middle_m, slope, height_m = (float(each[i, j]) for each in (self._u_mean, self._slope, self._z_mean))
        # neighbouring bins err alike: the matcher's offset changes over several of them
        alike = min(len(bins), _BINS_ALIKE)
        end = int(bins[-1]) + 1
        far = max(i, end - _FAR_BINS)
        return Surface(
            from_m=FIRST_M + float(bins[0]) * BIN_M,
            to_m=FIRST_M + end * BIN_M,
            middle_m=middle_m,
            height_m=height_m,
            slope=slope,
            height_sd_m=float(np.sqrt(alike / self._w[i, j])),
            slope_sd=float(np.sqrt(alike / self._uu[i, j])),
            far_bins_sd_m=float(np.sqrt((end - far) / self._w[far, end])),
        )


STEEPEST = 0.30
"""tan 17°: what is steeper is no ground. Over the nosings of stairs it is 18° and more."""
_PENALTY = 40.0
_LEFT_OUT = 12.0
_LEAST_BINS = 4
_LEAST_EVEN = 3
_BINS_ALIKE = 4
_FAR_BINS = 25
_SLOPE_SIGMA = 0.05
_TINY = 1e-9
