"""An elevation grid as legged robots carry one, for comparison: heights of cells about the camera, fused by frame.

After Fankhauser, Bloesch and Hutter, IEEE Robotics and Automation Letters 3(4), 2018. Each cell of W's level plane has
a height h and a variance, which grows with the time that the camera moves on. A frame's mean height z of a cell, of
variance r², corrects it as a Kalman filter of one state does:

    k = σ² / (σ² + r²),   h ← h + k (z − h),   σ² ← (1 − k) σ²                                                 (1)

What contradicts a cell, by (z − h)² > χ² (σ² + r²), takes its place.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from lab.baselines.path_seen import FROM_M, HALF_WIDTH_M, TO_M, PathSeen, PathView
from lab.baselines.terrain_peers import BIN_M, FOOT_HALF_M, FOOT_M, jumps, kind_of, level_foothold
from lab.evaluation.terrain_said import Terrain
from messages import Calibration, Input
from messages.arrays import FloatArray, IntArray

_SIZE = 256
"""Cells of BIN_M each way. A cell that the camera has left behind by that far is another one from then on."""
_CHI2 = 9.0
_GROWS_M2_PER_S = 0.005**2
_LEAST_POINTS = 2
_LEAST_CELLS = 3
_LEAST_SD_M = 0.003


class Profile(NamedTuple):
    """The grid along x of H: distances (n,), heights below the camera z (n,), and their deviations (n,)."""

    along_m: FloatArray
    z_m: FloatArray
    deviation_m: FloatArray


class ElevationGrid:
    """The grid about the camera, which has come to `p_W_m` (3,) since the first frame."""

    def __init__(self) -> None:
        self.p_W_m: FloatArray = np.zeros(3)
        self._before: PathSeen | None = None
        self._cell = np.full((_SIZE, _SIZE, 2), np.iinfo(np.int64).min)
        self._height_m = np.zeros((_SIZE, _SIZE))
        self._variance_m2 = np.zeros((_SIZE, _SIZE))

    def add(self, seen: PathSeen) -> None:
        """Move with the camera to a frame, and fuse what it shows."""
        if self._before is not None:
            gone_s = 1e-9 * (seen.t_exposure_ns - self._before.t_exposure_ns)
            self.p_W_m = self.p_W_m + 0.5 * gone_s * (self._before.v_W_mps + seen.v_W_mps)
            self._variance_m2 += _GROWS_M2_PER_S * gone_s
        self._before = seen
        points_W = seen.points_H_m @ seen.R_WH.T + self.p_W_m
        known = np.isfinite(points_W).all(axis=1)
        cell = np.floor(points_W[known, :2] / BIN_M).astype(np.int64)
        cells, place, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
        place = place.ravel()
        z_m = np.bincount(place, points_W[known, 2]) / count
        sd_m = np.bincount(place, seen.deviation_m[known]) / count
        told = count >= _LEAST_POINTS
        self._fuse(cells[told], z_m[told], np.maximum(sd_m[told], _LEAST_SD_M) ** 2)

    def _fuse(self, cells: IntArray, z_m: FloatArray, r2_m2: FloatArray) -> None:
        """Correct `cells` (n, 2) by their mean heights (n,) with variances (n,): (1)."""
        at = tuple((cells % _SIZE).T)
        same = (self._cell[at] == cells).all(axis=1)
        h_m, var_m2 = self._height_m[at], np.where(same, self._variance_m2[at], 0.0)
        fits = same & ((z_m - h_m) ** 2 <= _CHI2 * (var_m2 + r2_m2))
        k = np.where(fits, var_m2 / (var_m2 + r2_m2), 1.0)
        self._cell[at] = cells
        self._height_m[at] = h_m + k * (z_m - h_m)
        self._variance_m2[at] = np.where(fits, (1.0 - k) * var_m2, r2_m2)

    def profile(self, R_WH: FloatArray) -> Profile:
        """Return the median over the width of the path, from H's origin, where at least three cells are known."""
        along, across = np.arange(FROM_M, TO_M, BIN_M), np.arange(-HALF_WIDTH_M, HALF_WIDTH_M, BIN_M)
        x, y = np.meshgrid(along + 0.5 * BIN_M, across + 0.5 * BIN_M, indexing="ij")
        places_W = np.stack((x, y, np.zeros_like(x)), axis=-1) @ R_WH.T + self.p_W_m
        cells = np.floor(places_W[..., :2] / BIN_M).astype(np.int64)
        at = (cells[..., 0] % _SIZE, cells[..., 1] % _SIZE)
        known = (self._cell[at] == cells).all(axis=-1)
        enough = known.sum(axis=1) >= _LEAST_CELLS
        z_m = np.where(known, self._height_m[at] - self.p_W_m[2], np.nan)[enough]
        variance_m2 = np.where(known, self._variance_m2[at], np.nan)[enough]
        return Profile(x[enough, 0], np.nanmedian(z_m, axis=1), np.sqrt(np.nanmedian(variance_m2, axis=1)))


class GridTerrain:
    """Edges, kind and height of the ground by an elevation grid: where its medians across the path jump, as those of
    `terrain_peers.ColumnMedians`."""

    def __init__(self, calibration: Calibration) -> None:
        self._view, self._grid = PathView(calibration), ElevationGrid()

    def step(self, message: Input) -> Iterator[Terrain]:
        """Take one input and yield what the grid holds at a frame whose attitude is known."""
        seen = self._view.step(message)
        if seen is None:
            return
        self._grid.add(seen)
        along_m, z_m, deviation_m = self._grid.profile(seen.R_WH)
        edges = jumps(along_m, z_m)
        foot = np.abs(along_m - FOOT_M) <= FOOT_HALF_M
        foothold = None
        if foot.any():
            foothold = level_foothold(-float(np.median(z_m[foot])), float(np.median(deviation_m[foot])))
        yield Terrain(seen.t_exposure_ns, kind_of(along_m, z_m, edges), edges, foothold)
