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
    def shown(self) -> BoolArray:
        """Return which bins are in view, most of their area."""
        shown: BoolArray = self.covered > _LEAST_COVERED
        return shown

    @property
    def even(self) -> BoolArray:
        """Return which bins show one surface, neither a face nor what a lip hides."""
        even: BoolArray = self.shown & (self.spread_m < _MOST_SPREAD_M)
        return even


def profile_of(points: PathPoints, yaw_rad: float, width_m: float) -> Profile:
    """Return the profile of `points` along u = x + y tan(yaw), on a path of `width_m`."""
    place = places(points, yaw_rad)
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


def places(points: PathPoints, yaw_rad: float) -> IntArray:
    """Return in which bin along u each point lies, (n,); outside 0 to BINS in none."""
    places: IntArray = np.floor((points.along(yaw_rad) - FIRST_M) / BIN_M).astype(np.int64)
    return places


_LEAST_COVERED = 0.5
_MOST_SPREAD_M = 0.05
_FLOOR_M = 0.002
_OF_SPREAD = 0.3
