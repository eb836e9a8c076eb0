"""Rough ground: a plane through bumps and hollows, with their size as its uncertainty.

With the mean heights z_k of the region's cells at (x_k, y_k), the plane is that of least squares and e_k what it
leaves,

    z_k = a x_k + b y_k − h + e_k,      σ² = Σ e_k² / (n − 3).                                                   (1)

A foot stands on one bump or in one hollow: its height is uncertain by σ, its slope by what `sole` finds. An edge is no
bump, nor is a flight: were the ground a plane with a step along a line s_k (1 beyond it, 0 before), least squares
would take from Σ e_k² the share

    (e · s⊥)² / (s⊥ · s⊥) / (e · e),      s⊥ = s less its own plane of least squares,                           (2)

and stairs vary along one direction alone: across it, e leaves its median in each strip by little.
"""

import numpy as np

from messages.arrays import BoolArray, FloatArray
from perception.ground.cells import CELL_M, RegionCells
from perception.ground.plane import Plane, PlaneFit
from perception.ground.region import FootholdRegion
from perception.ground.sole import about, sole_slope_cov


def rough_plane(
    points_H: FloatArray, misfit_per_m: FloatArray, region: FootholdRegion, *, known: bool
) -> PlaneFit | None:
    """Return the plane of rough ground through points (N, 3) of the `region`; None where that is not what they show.

    `misfit_per_m` (N,) is by how many pixels of disparity a point lies off for each metre of height. Where the path is
    `known` to be rough, nobody asks for edges, which the region would not hold, nor how large bumps are at least, and
    what a few cells show of something else is left out.
    """
    cells = RegionCells(points_H, region)
    if known:
        on_ground = _on_ground(cells, points_H[:, 2], region)
        if not on_ground.all():
            points_H, misfit_per_m = points_H[on_ground], misfit_per_m[on_ground]
            cells = RegionCells(points_H, region)
    z_m, size = points_H[:, 2], len(cells.centres)
    seen, design, mean_m = _heights(cells, z_m, region)
    if np.count_nonzero(seen) < _LEAST_SEEN * size:
        return None
    (a, b, c), *_ = np.linalg.lstsq(design, mean_m)
    off_m = mean_m - design @ (a, b, c)
    rough_m = float(np.sqrt(off_m @ off_m / (len(off_m) - 3)))
    if (
        not (known or rough_m > LEAST_ROUGH_M)
        or rough_m > MOST_ROUGH_M
        or np.hypot(a, b) > _STEEPEST
        or np.abs(off_m).max() > _MOST_SIGMA * rough_m
    ):
        return None
    all_off_m = z_m - points_H[:, :2] @ (a, b) - c
    scattered = cells.scatter_m(all_off_m) > _WITHIN_CELL * rough_m
    if not known and (scattered or _step_share(design, off_m) > _STEP_SHARE):
        return None
    if not known and _least_across_m(design, off_m) < _ACROSS * rough_m:
        return None
    bumps = max(1.0, len(off_m) * (CELL_M / _BUMP_M) ** 2)
    unseen = 1.0 - len(off_m) / size + _SEEN_BADLY
    cov = np.linalg.inv(design.T @ design) * rough_m**2 * unseen * len(off_m) / bumps
    cov[2, 2] += rough_m**2
    to_abh = np.diag([1.0, 1.0, -1.0])  # h = −c
    soles_cov = sole_slope_cov(cells, all_off_m, _SLOPE_OF_ROUGH_PER_M * rough_m)
    cov = to_abh @ cov @ to_abh + about(region.ahead_m, region.left_m, soles_cov)
    misfit_px = float(np.sqrt(np.mean((all_off_m * misfit_per_m) ** 2)))
    return PlaneFit(Plane((float(a), float(b)), float(-c)), cov, misfit_px, 1.0, rough_m)


def _heights(cells: RegionCells, z_m: FloatArray, region: FootholdRegion) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Return which cells are seen, and of these (n,) the rows (x_k, y_k, 1) of (1), and z_k."""
    size = len(cells.centres)
    count = np.bincount(cells.place, minlength=size)
    seen = count >= _LEAST_OF_CELL
    design = np.column_stack((region.places(cells.centres[seen]), np.ones(np.count_nonzero(seen))))
    return seen, design, np.bincount(cells.place, z_m, minlength=size)[seen] / count[seen]


def _on_ground(cells: RegionCells, z_m: FloatArray, region: FootholdRegion) -> BoolArray:
    """Return which points (N,) are in cells that are no chance match, nor a thing, among bumps: at most
    `_MOST_OUTLIERS` of the cells are one, and lie farther off the plane through the others than bumps do."""
    seen, design, mean_m = _heights(cells, z_m, region)
    kept = np.ones(len(mean_m), dtype=np.bool_)
    for _ in range(_ROUNDS if len(mean_m) > _LEAST_CELLS else 0):
        off_m = np.abs(mean_m - design @ np.linalg.lstsq(design[kept], mean_m[kept])[0])
        near = off_m < max(_MOST_SIGMA * 1.4826 * float(np.median(off_m)), LEAST_ROUGH_M)
        if np.count_nonzero(~near) > _MOST_OUTLIERS * len(near) or (near == kept).all():
            break
        kept = near
    ground = np.ones(len(seen), dtype=np.bool_)
    ground[seen] = kept
    on_ground: BoolArray = ground[cells.place]
    return on_ground


def is_scatter(points_H: FloatArray, rise_m: FloatArray, region: FootholdRegion) -> bool:
    """Return whether points (N, 3) that lie `rise_m` (N,) above a plane do so one by one, as noise does, and not
    together with those beside them, as on bumps, steps and things."""
    beyond_m = 1.4826 * float(np.median(np.abs(rise_m)))
    return RegionCells(points_H, region).scatter_m(rise_m) > _WITHIN_CELL * beyond_m


def _step_share(design: FloatArray, off_m: FloatArray) -> float:
    """Return the largest share (2) of what is left of the cells' heights that one straight edge explains."""
    along = (design[:, :2] - design[:, :2].mean(axis=0)) @ _DIRECTIONS
    beyond = (along[:, :, None] > _EDGES_M).reshape(len(design), -1).astype(np.float64)
    Q, _ = np.linalg.qr(design)
    beyond -= Q @ (Q.T @ beyond)
    square = np.einsum("nk,nk->k", beyond, beyond)
    gain = (off_m @ beyond) ** 2 / np.maximum(square, 1.0)
    return float(gain.max() / (off_m @ off_m))


def _least_across_m(design: FloatArray, off_m: FloatArray) -> float:
    """Return by how much, one robust σ, heights are off the median of their strip, for strips of that direction in
    which it is least."""
    along = (design[:, :2] - design[:, :2].mean(axis=0)) @ _STRIPS
    strips = np.floor(along / CELL_M).astype(np.intp)
    strips -= strips.min()
    least_m = np.inf
    for strip in strips.T:
        order = np.lexsort((off_m, strip))
        count = np.bincount(strip)
        middle = np.cumsum(count) - count + count // 2
        median_m = off_m[order][np.minimum(middle, len(order) - 1)]
        least_m = min(least_m, float(np.median(np.abs(off_m - median_m[strip]))))
    return 1.4826 * least_m


LEAST_ROUGH_M, MOST_ROUGH_M = 0.008, 0.08
_STEEPEST = 0.29  # tan 16°: of most stairs the nosings lie on a steeper plane
_MOST_SIGMA = 4.0
_MOST_OUTLIERS, _LEAST_CELLS, _ROUNDS = 0.1, 20, 3
_WITHIN_CELL = 0.5
_STEP_SHARE = 0.5
_LEAST_OF_CELL = 2
_LEAST_SEEN = 0.5
_ACROSS = 0.33  # of simulated flights and steps 5 % leave more, of bumps 12 % less
_BUMP_M = 0.2
_SLOPE_OF_ROUGH_PER_M = 8.0  # of a sole, over σ of (1): 5 to 10 on simulated bumps, the more the shorter the region
_SEEN_BADLY = 0.02
_DIRECTIONS: FloatArray = np.stack([f(np.radians(15.0 * np.arange(12))) for f in (np.cos, np.sin)])
_STRIPS: FloatArray = np.stack([f(np.radians(7.5 * np.arange(24))) for f in (np.cos, np.sin)])
_EDGES_M = np.linspace(-0.25, 0.25, 11)
