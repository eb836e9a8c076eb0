"""How much the ground under one sole may slope otherwise than the plane through the whole region.

A foot stands on one bump, or in one hollow. With e_k the mean rise over the plane of the cells k of a sole, at
(x_k, y_k) from their middle,

    (a, b) = argmin Σ_k (e_k − a x_k − b y_k − c)²                                                               (1)

is by how much it slopes otherwise; the mean of (a, b)(a, b)ᵀ over all soles of the region is the covariance of what the
plane says of the sole that will stand there.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from messages.arrays import FloatArray
from perception.ground.cells import CELL_M, RegionCells


def sole_slope_cov(cells: RegionCells, rise_m: FloatArray, usual: float = 0.0) -> FloatArray:
    """Return the covariance (2, 2), along and across the region, of the slopes of (1); where no sole is seen, that of
    slopes as they are `usual`, one σ.

    `rise_m` (N,) is how far the points that `cells` were made of lie above the plane. A few soles are about the same
    one, seen again: slopes as they are `usual` count as those of `_USUAL_SOLES` more.
    """
    slopes = _slopes(cells, rise_m)
    more = _USUAL_SOLES if usual else 0
    total: FloatArray = slopes.T @ slopes + more * usual**2 * np.eye(2)
    return total / max(1, len(slopes) + more)


def _slopes(cells: RegionCells, rise_m: FloatArray) -> FloatArray:
    """Return (a, b) of (1) of each sole that is seen, (soles, 2)."""
    count = cells.grid(np.ones_like(rise_m))
    mean_m = np.divide(cells.grid(rise_m), count, out=np.zeros_like(count), where=count > 0)
    if min(count.shape) < _CELLS:
        return np.zeros((0, 2))
    seen = _soles((count > 0).astype(np.float64))
    enough = seen.sum(axis=1) >= _LEAST_SEEN * _CELLS**2
    seen, e_m = seen[enough], _soles(mean_m)[enough]
    design = seen[:, :, None] * _DESIGN
    slopes: FloatArray = np.linalg.solve(
        design.transpose(0, 2, 1) @ _DESIGN, design.transpose(0, 2, 1) @ e_m[:, :, None]
    )[:, :2, 0]
    return slopes


def about(ahead_m: float, left_m: float, slope_cov: FloatArray) -> FloatArray:
    """Return the covariance (3, 3) of (a, b, h) of a plane whose slopes have `slope_cov` (2, 2) about a place in H."""
    tip = np.array([[1.0, 0.0, ahead_m], [0.0, 1.0, left_m]])
    cov: FloatArray = tip.T @ slope_cov @ tip
    return cov


def _soles(grid: FloatArray) -> FloatArray:
    """Return the cells (soles, cells) of each sole that lies wholly in the region."""
    soles: FloatArray = sliding_window_view(grid, (_CELLS, _CELLS)).reshape(-1, _CELLS**2)
    return soles


SOLE_M = 0.20
"""Side of a square of about a sole's area and extent."""
_CELLS = round(SOLE_M / CELL_M)
_LEAST_SEEN = 0.7
_USUAL_SOLES = 4
_FROM_MIDDLE_M = (np.arange(_CELLS) - 0.5 * (_CELLS - 1)) * CELL_M
_DESIGN = np.stack((*np.meshgrid(_FROM_MIDDLE_M, _FROM_MIDDLE_M, indexing="ij"), np.ones((_CELLS, _CELLS))), axis=-1)
_DESIGN = _DESIGN.reshape(-1, 3)
