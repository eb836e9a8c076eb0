"""The rig's ground as points of a foot meet it: how deep a point lies in it, and which way out is shortest."""

import math
from bisect import bisect_right
from itertools import pairwise
from typing import NamedTuple

from messages.errors import UserError
from sim_rig.walk.world import World


class Met(NamedTuple):
    """A point `depth_m` inside the ground, and the normal (x, z) of the face through which it came in."""

    depth_m: float
    normal_x: float
    normal_z: float


class _Piece(NamedTuple):
    """What can be stood on from `x0_m` on; the ground is higher than what lies before it, or behind, by these."""

    x0_m: float
    x1_m: float
    z0_m: float
    gradient: float
    above_before_m: float
    above_behind_m: float


class Profile:
    """Depths in the profile z(x) of a `world`, lap after lap. Faces stand upright below the lips of their edges.

    Raises UserError for ground with a relief, which is no profile.
    """

    def __init__(self, world: World) -> None:
        if world.relief is not None:
            raise UserError("prosthesis: this walk is on ground with bumps across the way; choose one without a relief")
        self._length_m = world.length_m
        self._pieces = _pieces(world)
        self._from_m = [piece.x0_m for piece in self._pieces]

    def height_m(self, x_m: float) -> float:
        """Return z of the ground at `x_m`."""
        x_m %= self._length_m
        piece = self._at(x_m)
        return piece.z0_m + piece.gradient * (x_m - piece.x0_m)

    def slope_rad(self, x_m: float) -> float:
        """Return the slope of the ground at `x_m`, > 0 where it rises along x."""
        return math.atan(self._at(x_m % self._length_m).gradient)

    def walls_m(self, x_m: float) -> tuple[float, float]:
        """Return between which faces that rise from the ground at `x_m` a foot must stand; without one, infinite."""
        lap_m = x_m - x_m % self._length_m
        piece = self._at(x_m - lap_m)
        behind_m = lap_m + piece.x0_m if piece.above_before_m < -_WALL_M else -math.inf
        return behind_m, lap_m + piece.x1_m if piece.above_behind_m < -_WALL_M else math.inf

    def met(self, x_m: float, z_m: float) -> Met | None:
        """Return how the point (x, z) lies in the ground, or None where it is above it."""
        x_m %= self._length_m
        piece = self._at(x_m)
        below_m = piece.z0_m + piece.gradient * (x_m - piece.x0_m) - z_m
        if below_m <= 0.0:
            return None
        level = 1.0 / math.sqrt(1.0 + piece.gradient**2)
        met = Met(below_m * level, -piece.gradient * level, level)
        if below_m < piece.above_before_m and x_m - piece.x0_m < met.depth_m:
            met = Met(x_m - piece.x0_m, -1.0, 0.0)
        if below_m < piece.above_behind_m and piece.x1_m - x_m < met.depth_m:
            met = Met(piece.x1_m - x_m, 1.0, 0.0)
        return met

    def _at(self, x_m: float) -> _Piece:
        return self._pieces[max(bisect_right(self._from_m, x_m) - 1, 0)]


def _pieces(world: World) -> list[_Piece]:
    start_m = world.lap[0].x0_m
    stood = [piece for piece in world.lap if not piece.is_riser]
    begins = [start_m]
    for earlier, later in pairwise(world.lap):
        if not later.is_riser:
            begins.append(earlier.lip_x_m if earlier.is_riser else later.x0_m)
    ends = [*begins[1:], start_m + world.length_m]
    heights = [
        (piece.height_at(begin), piece.height_at(end)) for piece, begin, end in zip(stood, begins, ends, strict=True)
    ]
    found = []
    for k, (piece, begin, end) in enumerate(zip(stood, begins, ends, strict=True)):
        (z0, z1), before, behind = heights[k], heights[k - 1][1], heights[(k + 1) % len(heights)][0]
        found.append(_Piece(begin, end, z0, math.tan(piece.slope_rad), z0 - before, z1 - behind))
    return found


_WALL_M = 0.02
