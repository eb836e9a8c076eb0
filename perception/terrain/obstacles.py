"""Things on the path that are no ground: what rises above the surface that it stands on and is not the face of a step.

Points above the ground are gathered in cells of the path, cells that touch make a thing. A face that fills the path
from side to side is a riser as long as it may be stepped upon; what is higher is a wall.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from messages.arrays import BoolArray, FloatArray, IntArray
from perception.terrain.path_points import NOISE_PX, PathPoints
from perception.terrain.surfaces import PathSurfaces


@dataclass(frozen=True)
class Obstacle:
    """A thing whose nearest part lies `distance_m` along x of H and `left_m` along y.

    It rises `height_m` above the ground there, or at least as far as points were looked for.
    """

    distance_m: float
    left_m: float
    height_m: float


class Scatter:
    """Follows how many times as far as they state points are off, by the disparities of the ground: not where it is
    rough, since bumps, or a thing that is taken for one, would hide things."""

    def __init__(self) -> None:
        self.of_stated = _USUAL_SCATTER

    def add(self, noise_px: float) -> None:
        """Take what the disparities of a frame's ground scatter about its plane; NaN where that was not seen."""
        if noise_px <= _MOST_NOISE_PX:
            self.of_stated += _FOLLOWS * (max(1.0, noise_px / NOISE_PX) - self.of_stated)


def find_obstacles(
    points: PathPoints, path: PathSurfaces, rough_m: float, half_width_m: float, scatter: float = 1.0
) -> tuple[list[Obstacle], BoolArray]:
    """Return the things on a path of `half_width_m` to either side, and which of the `points` (n,) lie on any.

    `rough_m`, one σ, is how much the ground varies; `scatter` how many times as far as they state points are off.
    """
    rise_m = points.z_m - _ground_m(points.along(path.yaw_rad), path)
    high = (rise_m < _HIGHEST_M) & (
        rise_m > np.maximum(LEAST_RISE_M, _OVER_ROUGH * rough_m) + _OVER_NOISE * scatter * points.deviation_m
    )
    thing = _thing_of(points, high, half_width_m)
    found = []
    for label in range(1, int(thing.max(initial=0)) + 1):
        on = (thing == label) & high
        x_m, y_m = points.x_m[on], points.y_m[on]
        height_m = float(np.quantile(rise_m[on], _TOP))
        spans = float(np.ptp(y_m)) > _FROM_SIDE_TO_SIDE * 2.0 * half_width_m
        if np.count_nonzero(on) < _LEAST_POINTS or (spans and height_m < HIGHEST_STEP_M):
            thing[thing == label] = 0
            continue
        distance_m = float(np.quantile(x_m, _NEAREST))
        left_m = float(np.median(y_m[x_m <= distance_m + _NEAREST_PART_M]))
        found.append(Obstacle(distance_m, left_m, height_m))
    on_thing: BoolArray = thing > 0
    return sorted(found, key=lambda obstacle: obstacle.distance_m), on_thing


def _ground_m(u_m: FloatArray, path: PathSurfaces) -> FloatArray:
    """Return z (n,) of the ground at `u_m`: where no surface was found, the higher of the two beside; NaN far from any.

    So a riser, up to the surface that it leads to, does not rise above the ground.
    """
    z_m = np.full(len(u_m), -np.inf)
    for surface in path.surfaces:
        over = (u_m > surface.from_m - _BESIDE_M) & (u_m < surface.to_m + _BESIDE_M)
        here = surface.height_m + surface.slope * (u_m[over] - surface.middle_m)
        z_m[over] = np.maximum(z_m[over], here)
    z_m[np.isneginf(z_m)] = np.nan
    return z_m


def _thing_of(points: PathPoints, high: BoolArray, half_width_m: float) -> IntArray:
    """Return for each point (n,) the number of the thing in whose cells it lies, from 1 on; 0 for none."""
    row = (points.x_m / _CELL_M).astype(np.intp)
    column = ((points.y_m + half_width_m) / _CELL_M).astype(np.intp)
    rows, columns = int(row.max(initial=0)) + 1, int(2.0 * half_width_m / _CELL_M) + 1
    place = row * columns + column
    highs, all_of_them = (np.bincount(place[some], minlength=rows * columns) for some in (high, slice(None)))
    filled = (highs >= _LEAST_OF_CELL) & (3 * highs > all_of_them)  # the foot of a face is no higher than the ground
    _, labels = cv2.connectedComponents(filled.reshape(rows, columns).astype(np.uint8))
    thing: IntArray = labels.ravel()[place].astype(np.int64)
    return thing


LEAST_RISE_M = 0.04
HIGHEST_STEP_M = 0.30
"""What fills the path and is lower may be stepped upon: kerbs reach 0.25 m."""
_HIGHEST_M = 0.60  # nothing higher is looked for: what matches there does so by chance
_OVER_ROUGH = 7.0
_OVER_NOISE = 3.0
_USUAL_SCATTER, _MOST_NOISE_PX, _FOLLOWS = 2.0, 0.6, 0.2
_BESIDE_M = 0.15
_CELL_M = 0.04
_LEAST_OF_CELL = 2
_LEAST_POINTS = 8
_FROM_SIDE_TO_SIDE = 0.8
_TOP, _NEAREST = 0.95, 0.05
_NEAREST_PART_M = 0.04
