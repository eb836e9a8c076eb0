"""The ground along the path as a profile: height by distance, in bins, each as sure as what is seen of it."""

from dataclasses import dataclass

import numpy as np

from messages.arrays import BoolArray, FloatArray, IntArray
from perception.terrain.path_points import PathPoints

BIN_M = 0.02
FIRST_M = 0.10
BINS = 135


@dataclass(frozen=True)
class Profile:
    """Bins of BIN_M from FIRST_M on along u; (BINS,) each.

    `height_m` is the median of z; `spread_m` twice from its first to its third quartile; `covered` the share of the
    bin's area that is seen: little where a lip hides it and the matcher bridges the gap. `deviation_m` is one σ of
    the median.
    """

    height_m: FloatArray
    spread_m: FloatArray
    covered: FloatArray
    deviation_m: FloatArray

    @property
    def even(self) -> BoolArray:
        """Return which bins show one surface, neither a face nor what a lip hides."""
        even: BoolArray = (self.covered > _LEAST_COVERED) & (self.spread_m < _MOST_SPREAD_M)
        return even


def profile_of(points: PathPoints, yaw_rad: float, width_m: float) -> Profile:
    """Return the profile of `points` along u = x + y tan(yaw), on a path of `width_m`."""
    place = _places(points, yaw_rad)
    inside = (place >= 0) & (place < BINS)
    place, z_m = place[inside], points.z_m[inside]
    order = np.lexsort((z_m, place))
    place, z_m = place[order], z_m[order]
    count = np.bincount(place, minlength=BINS)
    first = np.cumsum(count) - count

    def quantile(share: float) -> FloatArray:
        values = np.full(BINS, np.nan)
        some = count > 0
        values[some] = z_m[first[some] + np.floor(share * (count[some] - 1)).astype(np.intp)]
        return values

    many = np.maximum(count, 1)
    matching_m = np.bincount(place, points.deviation_m[inside][order], minlength=BINS) / many
    covered = np.bincount(place, points.area_m2[inside][order], minlength=BINS) / (BIN_M * width_m)
    spread_m = 2.0 * (quantile(0.75) - quantile(0.25))
    return Profile(
        height_m=quantile(0.5),
        spread_m=spread_m,
        covered=covered,
        deviation_m=np.sqrt(_FLOOR_M**2 + matching_m**2 + (_OF_SPREAD * spread_m) ** 2),
    )


def roughness_m(points: PathPoints, profile: Profile, yaw_rad: float) -> float:
    """Return how much the ground varies across the path, one robust σ, slopes across taken off; NaN where unseen.

    What `points` within ROUGH_FROM_M to ROUGH_TO_M are off the median of their bin. Steps and ramps vary along the path
    alone.
    """
    place = _places(points, yaw_rad)
    some = (points.x_m > ROUGH_FROM_M) & (points.x_m < ROUGH_TO_M) & (place >= 0) & (place < BINS)
    place, y_m = place[some], points.y_m[some]
    off_m = points.z_m[some] - profile.height_m[place]
    seen = profile.covered[place] > _LEAST_COVERED
    if np.count_nonzero(seen) < _LEAST_POINTS:
        return float("nan")
    off_m, y_m = off_m[seen], y_m[seen]
    slope = 0.0
    for _ in range(3):
        near = np.abs(off_m - slope * y_m) < _NEAR_M
        slope = float(off_m[near] @ y_m[near]) / max(float(y_m[near] @ y_m[near]), _TINY)
    return float(1.4826 * np.median(np.abs(off_m - slope * y_m)))


def _places(points: PathPoints, yaw_rad: float) -> IntArray:
    """Return in which bin along u each point lies, (n,); outside 0 to BINS in none."""
    places: IntArray = np.floor((points.along(yaw_rad) - FIRST_M) / BIN_M).astype(np.int64)
    return places


ROUGH_FROM_M, ROUGH_TO_M = 0.3, 1.3
_LEAST_POINTS = 200
_NEAR_M = 0.08
_TINY = 1e-9
_LEAST_COVERED = 0.5
_MOST_SPREAD_M = 0.05
_FLOOR_M = 0.002
_OF_SPREAD = 0.3
