"""The foothold region cut into cells, so that ground counts by its area and not by its pixels."""

import numpy as np

from messages.arrays import BoolArray, FloatArray, IntArray
from perception.ground.region import FootholdRegion

CELL_M = 0.04


class RegionCells:
    """The region's cells: `place` (N,) of each point, `centres` (cells, 2) along and across it, from its middle."""

    def __init__(self, points_H: FloatArray, region: FootholdRegion) -> None:
        half_m = np.array([region.half_length_m, region.half_width_m])
        self._shape = np.ceil(2.0 * half_m / CELL_M).astype(np.intp)
        from_corner = np.stack((region.along_m(points_H), points_H[:, 1] - region.left_m), axis=-1) + half_m
        row, column = np.clip((from_corner / CELL_M).astype(np.intp), 0, self._shape - 1).T
        self.place: IntArray = row * self._shape[1] + column
        middles = [(np.arange(n) + 0.5) * CELL_M - half for n, half in zip(self._shape, half_m, strict=True)]
        self.centres: FloatArray = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, 2)

    def grid(self, values: FloatArray) -> FloatArray:
        """Return the sum of `values` (N,) of the points in each cell (along, across)."""
        sums = np.bincount(self.place, values, minlength=len(self.centres)).reshape(self._shape)
        return sums.astype(np.float64)

    def count(self, some: BoolArray) -> IntArray:
        """Return how many of these points (N,) each cell holds."""
        return np.bincount(self.place[some], minlength=len(self.centres))

    def scatter_m(self, rise_m: FloatArray) -> float:
        """Return how far the points are from the mean of their cell, one robust σ; `rise_m` (N,) are their heights."""
        size = len(self.centres)
        mean_m = np.bincount(self.place, rise_m, minlength=size) / np.maximum(
            np.bincount(self.place, minlength=size), 1
        )
        return 1.4826 * float(np.median(np.abs(rise_m - mean_m[self.place])))

    def beside(self, things: list[BoolArray]) -> BoolArray:
        """Return which points (N,) are on `things`, or in a cell that is mostly things, or next to one."""
        on_thing = np.logical_or.reduce(things)
        filled = (self.count(on_thing) > self.count(~on_thing)).reshape(self._shape)
        wide = np.pad(filled, 1)
        rows, columns = self._shape
        near = np.logical_or.reduce([wide[i : i + rows, k : k + columns] for i in range(3) for k in range(3)])
        beside: BoolArray = on_thing | near.ravel()[self.place]
        return beside
