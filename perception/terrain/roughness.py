"""How rough the ground of the path is: what its cells' mean heights vary across the path, beyond the matcher's noise.

Steps and ramps vary along the path alone, so each height is taken relative to the median of its bin. Cells lie on the
ground, and v is the mean of what the points of one are off it, less the slope across its surface. What two frames a and
b show of the same cells, between which the camera has moved, has bumps in common, and errors that differ:

    r² = (1.4826 med |v_a + v_b|)² / 4 − (1.4826 med |v_a − v_b|)² / 4                                          (1)

It is the mean over the two frames before. While the camera stands errors repeat themselves. Then, with w what each
point is off the mean of its cell,

    r² = (1.4826 med |v|)² − (k 1.4826 med |w|)²,                                                               (2)

k so that even ground gives none, however little it shows: errors of neighbouring points are alike, so that a cell's
mean errs by half as much as its points, whereas bumps are as wide as a cell. A frame's r² may be negative. What is
known is the median over the last frames, of which most have to tell: a leg swings through in a few.
"""

import math
from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from statistics import median
from typing import NamedTuple

import numpy as np

from messages.arrays import FloatArray
from perception.terrain.path_points import PathPoints
from perception.terrain.profile import Profile, places
from perception.terrain.surfaces import Surface


class Roughness:
    """Follows (1) from frame to frame, or (2).

    `rough_m` is how much the ground varies across the path, one σ; 0 where that is no more than noise. Where most
    frames show too little of the path it stays what it was, for a second.
    """

    def __init__(self) -> None:
        self._variances_m2: deque[float] = deque(maxlen=_FRAMES)
        self._before: deque[_Cells] = deque(maxlen=_COMPARED)
        self._way_m = 0.0
        self._untold = 0
        self.rough_m = 0.0

    def lose_way(self) -> None:
        """Come to a frame without knowing how far the camera has gone since the frame before."""
        self._before.clear()

    def add(
        self, points: PathPoints, profile: Profile, surfaces: Sequence[Surface], yaw_rad: float, ahead_m: float
    ) -> None:
        """Take a frame's `points`, their `profile` along u = x + y tan(yaw) and the surfaces found in it; the camera
        has gone `ahead_m` since the frame before."""
        self._way_m += ahead_m
        cells = _cells(points, profile, surfaces, yaw_rad, self._way_m)
        self._variances_m2.append(self._variance_m2(cells))
        self._before.append(cells)
        told_m2 = [each for each in self._variances_m2 if math.isfinite(each)]
        if 2 * len(told_m2) > len(self._variances_m2):
            self._untold, self.rough_m = 0, math.sqrt(max(0.0, median(told_m2)))
            return
        self._untold += 1
        if self._untold > _LASTS_FRAMES:
            self.rough_m = 0.0

    def _variance_m2(self, cells: "_Cells") -> float:
        """Return r² of the newest frame; NaN where little of the path is seen."""
        moved = [before for before in self._before if abs(cells.way_m - before.way_m) > _MOVED_M]
        common_m2 = [each for each in (_common_m2(cells, before) for before in moved) if math.isfinite(each)]
        return sum(common_m2) / len(common_m2) if common_m2 else _beyond_noise_m2(cells)


class _Cells(NamedTuple):
    """The path from FROM_M to TO_M of a frame whose camera is at `way_m`: v of each cell (rows, columns), NaN where it
    is not seen, in rows from `first_row` of the way on; and w (n,)."""

    way_m: float
    first_row: int
    mean_m: FloatArray
    within_m: FloatArray


def _cells(points: PathPoints, profile: Profile, surfaces: Sequence[Surface], yaw_rad: float, way_m: float) -> _Cells:
    """Return the cells that `points` show, of surfaces one by one."""
    first_row = math.floor((way_m + FROM_M) / _CELL_ALONG_M)
    rows = math.floor((way_m + TO_M) / _CELL_ALONG_M) + 1 - first_row
    place = places(points, yaw_rad)
    along_m = points.along(yaw_rad)
    on_path = (along_m > FROM_M) & (along_m < TO_M) & (place >= 0) & (place < len(profile.height_m))
    on_path[on_path] = profile.shown[place[on_path]]
    seen, place, along_m = points.where(on_path), place[on_path], along_m[on_path]
    meet_m = [0.5 * (one.to_m + other.from_m) for one, other in pairwise(surfaces)]
    piece = np.searchsorted(meet_m, along_m)
    off_m = seen.z_m - profile.height_m[place]
    row = np.floor((way_m + along_m) / _CELL_ALONG_M).astype(np.intp) - first_row
    column = np.floor(seen.y_m / _CELL_ACROSS_M).astype(np.intp) + _COLUMNS // 2
    near = (np.abs(off_m) < _NEAR_M) & (column >= 0) & (column < _COLUMNS)
    mean_m, within = np.full(rows * _COLUMNS, np.nan), [np.empty(0)]
    for number in range(len(meet_m) + 1):
        on = near & (piece == number)
        cell = row[on] * _COLUMNS + column[on]
        count = np.bincount(cell, minlength=rows * _COLUMNS)
        told = count >= _LEAST_OF_CELL
        all_mean_m, all_at_m = (
            np.bincount(cell, each, rows * _COLUMNS) / np.maximum(count, 1) for each in (off_m[on], seen.y_m[on])
        )
        if told.any():
            mean_m[told] = _less_slope(all_mean_m[told], all_at_m[told])
        off_mean_m = (off_m[on] - all_mean_m[cell]) * np.sqrt(count / np.maximum(count - 1, 1))[cell]
        within.append(off_mean_m[told[cell]])
    return _Cells(way_m, first_row, mean_m.reshape(rows, _COLUMNS), np.concatenate(within))


def _less_slope(mean_m: FloatArray, at_m: FloatArray) -> FloatArray:
    """Return `mean_m` (n,) less their slope along `at_m` (n,).

    What is farther off than others are is no bump of this ground but a riser, a chance match, or something else.
    """
    off_m = mean_m
    for _ in range(_TRIES):
        near = np.abs(off_m) <= _OFF_SIGMAS * _deviation(off_m)
        slope = float(mean_m[near] @ at_m[near]) / max(float(at_m[near] @ at_m[near]), _TINY)
        off_m = mean_m - slope * at_m
    return off_m


def _common_m2(one: _Cells, other: _Cells) -> float:
    """Return r² of (1); NaN where they show few of the same cells."""
    from_row = max(one.first_row, other.first_row)
    to_row = min(one.first_row + len(one.mean_m), other.first_row + len(other.mean_m))
    if to_row <= from_row:
        return math.nan
    v_a, v_b = (each.mean_m[from_row - each.first_row : to_row - each.first_row] for each in (one, other))
    both = np.isfinite(v_a) & np.isfinite(v_b)
    if np.count_nonzero(both) < _LEAST_CELLS:
        return math.nan
    return 0.25 * (_deviation(v_a[both] + v_b[both]) ** 2 - _deviation(v_a[both] - v_b[both]) ** 2)


def _beyond_noise_m2(cells: _Cells) -> float:
    """Return r² of (2); NaN where few cells are seen."""
    mean_m = cells.mean_m[np.isfinite(cells.mean_m)]
    if len(mean_m) < _LEAST_CELLS:
        return math.nan
    return _deviation(mean_m) ** 2 - (_NOISE_OF_CELL * _deviation(cells.within_m)) ** 2


def _deviation(values: FloatArray) -> float:
    return 1.4826 * float(np.median(np.abs(values)))


FROM_M, TO_M = 0.3, 1.3
_CELL_ALONG_M, _CELL_ACROSS_M = 0.04, 0.05
_COLUMNS = 16  # so many across, half of them to either side
_LEAST_OF_CELL = 3
_LEAST_CELLS = 100
_NOISE_OF_CELL = 0.65
_COMPARED, _MOVED_M = 2, 0.025
"""With so many frames before each is compared, those from which the camera has moved so far."""
_NEAR_M = 0.08
_TRIES, _OFF_SIGMAS = 5, 2.5
_TINY = 1e-9
_FRAMES = 9
_LASTS_FRAMES = 20
