"""What stands on the ground and is none: legs, shoes, posts, whatever rises above the plane and is no step.

A step up or down fills the region on one side of a straight line, its edge, whichever way that runs, and over most of
the region's width. What leaves ground beside itself on every such side is a thing that stands on it: nobody steps on
it, so that it says nothing of how high the ground is. Of what stands too near to be matched there are chance matches,
at all depths below the ground: what is low, fills no side and has no height of its own is not ground either.
"""

import numpy as np

from messages.arrays import BoolArray, FloatArray
from perception.ground.cells import CELL_M, RegionCells
from perception.ground.region import FootholdRegion


def is_ground(points_H: FloatArray, rise_m: FloatArray, inlier: BoolArray, region: FootholdRegion) -> BoolArray:
    """Return (N,) which of the points (N, 3) of the `region` may be ground, on the plane or on another surface.

    `rise_m` (N,) is how far they lie above the plane, `inlier` (N,) which of them are taken for its own. Those beside
    a thing are left out with it: windows of the matcher see both. Where most would be things, all may be ground: what
    is the thing and what the ground is open then.
    """
    far_m = max(LEAST_RISE_M, _OVER_ROUGH * 1.4826 * float(np.median(np.abs(rise_m))))
    off = [~inlier & (rise_m > far_m), ~inlier & (rise_m < -far_m)]
    if not (off[0].any() or off[1].any()):
        return np.ones(len(rise_m), np.bool_)
    cells = RegionCells(points_H, region)
    things = [each for each in off if each.any() and not _is_surface(cells, each, rise_m, 2.0 * region.half_width_m)]
    ground: BoolArray = ~cells.beside(things) if things else np.ones(len(rise_m), np.bool_)
    weight = region.weights(points_H)
    return ground if weight[ground].sum() > _LEAST_GROUND * weight.sum() else np.ones(len(rise_m), np.bool_)


def _is_surface(cells: RegionCells, off: BoolArray, rise_m: FloatArray, width_m: float) -> bool:
    """Return whether the points that are `off` (N,) the plane are another surface, beyond an edge.

    Beyond some line nearly all cells hold such points, few such lie before it,
    and their heights are those of a plane. The line must cross most of `width_m`: at less, it only cuts a corner.
    """
    centres, offs, others = cells.centres, cells.count(off), cells.count(~off)
    filled, ground = offs > others, (others > 0) & (offs <= others)
    if np.count_nonzero(filled) < _LEAST_CELLS:
        return False
    height_m = np.bincount(cells.place[off], rise_m[off], minlength=len(centres))[filled] / offs[filled]
    if _scatter_m(centres[filled], height_m) > _SCATTERED_M:
        return False
    order = np.argsort(-centres @ _DIRECTIONS, axis=0)
    fills, grounds = np.cumsum(filled[order], axis=0), np.cumsum(ground[order], axis=0)
    one_sided = (fills >= _MOST_OF_IT * fills[-1]) & (grounds <= _GROUND_BEYOND * (fills + grounds))
    spans_m = np.ptp(centres[filled] @ _ACROSS, axis=0) + CELL_M
    return bool((one_sided.any(axis=0) & (spans_m > _MOST_OF_IT * width_m)).any())


def _scatter_m(at_m: FloatArray, height_m: FloatArray) -> float:
    """Return by how much heights (n,) at places (n, 2) are off the plane through them, one robust σ."""
    design = np.column_stack((at_m, np.ones(len(at_m))))
    off_m = height_m - design @ np.linalg.lstsq(design, height_m)[0]
    return float(1.4826 * np.median(np.abs(off_m)))


LEAST_RISE_M = 0.025
_OVER_ROUGH = 4.0
_SCATTERED_M = 0.02
_MOST_OF_IT = 0.6
_GROUND_BEYOND = 0.2
_LEAST_CELLS = 4
_LEAST_GROUND = 0.55
_ANGLES_RAD = np.radians(4.0 + 10.0 * np.arange(36))  # no line along rows of cells, which it would meet all at once
_DIRECTIONS: FloatArray = np.stack((np.cos(_ANGLES_RAD), np.sin(_ANGLES_RAD)))
_ACROSS: FloatArray = np.stack((-np.sin(_ANGLES_RAD), np.cos(_ANGLES_RAD)))
