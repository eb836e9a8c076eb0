"""Rough ground: a smooth random height field over level ground, the same on every lap of its own tile."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from messages.arrays import Float32Array, FloatArray

_CELL_M = 0.01
_CELLS = 512
_STEPS, _STEP_M = 24, 0.0025  # from the highest to the lowest point, to find where a ray meets the ground first


@dataclass(frozen=True)
class Relief:
    """Heights within ±`most_m`, white noise smoothed by a Gaussian of `smooth_m`, drawn by `seed`.

    It repeats after 5.12 m in x and in y.
    """

    most_m: float = 0.03
    smooth_m: float = 0.08
    seed: int = 1

    @classmethod
    def of_rms(cls, rms_m: float, smooth_m: float, seed: int) -> "Relief":
        """Return the relief whose heights have this root mean square."""
        return cls(rms_m / float(_field(smooth_m, seed)[:-1, :-1].std()), smooth_m, seed)

    @property
    def rms_m(self) -> float:
        """Return the root mean square of the heights about their mean."""
        return self.most_m * float(_field(self.smooth_m, self.seed)[:-1, :-1].std())

    def heights(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        """Return z over the level ground at each (x, y) of W, arrays of one shape."""
        column, row = (_in_tile(each / _CELL_M).astype(np.float32) for each in (x_m, y_m))
        shape = np.shape(x_m)
        flat = (column.reshape(shape[0], -1), row.reshape(shape[0], -1))
        field = _field(self.smooth_m, self.seed)
        return self.most_m * cv2.remap(field, *flat, cv2.INTER_LINEAR).reshape(shape).astype(np.float64)

    def met(self, o_m: FloatArray, d: FloatArray) -> FloatArray:
        """Return the height (rows, columns) at which rays from above meet the ground first.

        Rays go from o (rows, 3) along d (rows, columns, 3), both in W; the level ground is at z = 0. A ray that leads
        upwards is taken to meet level ground.
        """
        fall = np.where(d[..., 2] < 0, -d[..., 2], np.inf)
        z_before, gap_before = self.most_m, np.zeros(fall.shape)
        met = np.zeros(fall.shape)
        found = np.zeros(fall.shape, np.bool_)
        steps = max(_STEPS, round(2 * self.most_m / _STEP_M))
        for k, z in enumerate(np.linspace(self.most_m, -self.most_m, steps)):
            reach = (o_m[:, 2, None] - z) / fall
            gap = z - self.heights(o_m[:, 0, None] + reach * d[..., 0], o_m[:, 1, None] + reach * d[..., 1])
            crossed = ~found & (gap <= 0)
            if k == 0:
                met[crossed] = z
            else:
                share = gap_before[crossed] / (gap_before[crossed] - gap[crossed])
                met[crossed] = z_before + share * (z - z_before)
            found |= crossed
            z_before, gap_before = z, gap
        return met


def _in_tile(cells: FloatArray) -> FloatArray:
    """Return np.mod(cells, _CELLS), to the last bit because that is a power of two, several times as fast."""
    inside: FloatArray = cells - _CELLS * np.floor(cells / _CELLS)
    return inside


@lru_cache(maxsize=8)
def _field(smooth_m: float, seed: int) -> Float32Array:
    """Return heights (_CELLS + 1, _CELLS + 1), rows along y, from −1 to 1; the last row and column are the first."""
    white = np.random.default_rng([seed, 81]).standard_normal((_CELLS, _CELLS))
    smooth = gaussian_filter(white, smooth_m / _CELL_M, mode="wrap")
    return np.pad(smooth / np.abs(smooth).max(), ((0, 1), (0, 1)), mode="wrap").astype(np.float32)
