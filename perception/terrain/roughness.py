"""How rough the ground of the path is: what its cells' mean heights vary across the path, beyond the matcher's noise.

Steps and ramps vary along the path alone, so each height is taken relative to the median of its bin. With the mean v of
what the points of a cell are off it, less the slope across its surface, and w what each point is off that mean,

    r² = (1.4826 med |v|)² − (k 1.4826 med |w|)²,                                                               (1)

k so that even ground gives none, however little it shows: errors of neighbouring points are alike, so that a cell's
mean errs by half as much as its points, whereas bumps are as wide as a cell. A frame's r² may be negative. What is
known is the median over the last frames, of which most have to tell: a leg swings through in a few.
"""

import math
from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from statistics import median

import numpy as np

from messages.arrays import FloatArray, IntArray
from perception.terrain.path_points import PathPoints
from perception.terrain.profile import Profile, places
from perception.terrain.surfaces import Surface


class Roughness:
    """Follows (1) from frame to frame.

    `rough_m` is how much the ground varies across the path, one σ; 0 where that is no more than noise. Where most
    frames show too little of the path it stays what it was, for a second.
    """

    def __init__(self) -> None:
        self._variances_m2: deque[float] = deque(maxlen=_FRAMES)
        self._untold = 0
        self.rough_m = 0.0

    def add(self, points: PathPoints, profile: Profile, surfaces: Sequence[Surface], yaw_rad: float) -> None:
        """Take a frame's `points`, their `profile` along u = x + y tan(yaw) and the surfaces found in it."""
        self._variances_m2.append(variance_across_m2(points, profile, surfaces, yaw_rad))
        told_m2 = [each for each in self._variances_m2 if math.isfinite(each)]
        if 2 * len(told_m2) > len(self._variances_m2):
            self._untold, self.rough_m = 0, math.sqrt(max(0.0, median(told_m2)))
            return
        self._untold += 1
        if self._untold > _LASTS_FRAMES:
            self.rough_m = 0.0


def variance_across_m2(points: PathPoints, profile: Profile, surfaces: Sequence[Surface], yaw_rad: float) -> float:
    """Return r² of (1), of the path from FROM_M to TO_M, which `surfaces` divide; NaN where little of it is seen."""
    place = places(points, yaw_rad)
    on_path = (points.x_m > FROM_M) & (points.x_m < TO_M) & (place >= 0) & (place < len(profile.height_m))
    seen = points.where(on_path)
    place = place[on_path]
    seen, place = seen.where(profile.shown[place]), place[profile.shown[place]]
    meet_m = [0.5 * (one.to_m + other.from_m) for one, other in pairwise(surfaces)]
    piece = np.searchsorted(meet_m, seen.along(yaw_rad))
    off_m = seen.z_m - profile.height_m[place]
    found = [_off_across(place[on], seen.y_m[on], off_m[on]) for on in (piece == k for k in range(len(meet_m) + 1))]
    if sum(len(cells_m) for cells_m, _ in found) < _LEAST_CELLS:
        return math.nan
    across_m, within_m = (1.4826 * float(np.median(np.abs(np.concatenate(each)))) for each in zip(*found, strict=True))
    return across_m**2 - (_NOISE_OF_CELL * within_m) ** 2


def _off_across(place: IntArray, y_m: FloatArray, off_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean of `off_m` (n,) of each cell of one surface that is seen, less its slope across, and what each
    point of these cells is off the mean.

    What is farther off than `_NEAR_M` is no bump of this ground but a chance match, or something else.
    """
    near = np.abs(off_m) < _NEAR_M
    place, y_m, off_m = place[near], y_m[near], off_m[near]
    across = np.floor(y_m / _CELL_ACROSS_M).astype(np.intp)
    across -= across.min(initial=0)
    cell = (place // _CELL_BINS) * (across.max(initial=0) + 1) + across
    count = np.bincount(cell)
    seen = count >= _LEAST_OF_CELL
    all_mean_m, all_at_m = (np.bincount(cell, each) / np.maximum(count, 1) for each in (off_m, y_m))
    mean_m, at_m = all_mean_m[seen], all_at_m[seen]
    slope = 0.0
    for _ in range(3):
        near = np.abs(mean_m - slope * at_m) < _NEAR_M
        slope = float(mean_m[near] @ at_m[near]) / max(float(at_m[near] @ at_m[near]), _TINY)
    within_m = (off_m - all_mean_m[cell]) * np.sqrt(count / np.maximum(count - 1, 1))[cell]
    return mean_m - slope * at_m, within_m[seen[cell]]


FROM_M, TO_M = 0.3, 1.3
_CELL_BINS, _CELL_ACROSS_M = 2, 0.05
_LEAST_OF_CELL = 3
_LEAST_CELLS = 100
_NOISE_OF_CELL = 0.65
_NEAR_M = 0.08
_TINY = 1e-9
_FRAMES = 9
_LASTS_FRAMES = 20
