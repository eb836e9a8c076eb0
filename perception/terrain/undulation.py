"""Whether the ground undulates along the path: bumps as wide as the path, which vary along it and not across.

Cells along the way keep which way the ground was last seen to slope there. Where it turns twice, up, down and up again
or the other way, within what lies a little behind and ahead, that is no ramp, nor a speed bump; it is taken to go
on so for a while.
"""

import math
from collections.abc import Sequence
from itertools import groupby

import numpy as np

from perception.terrain.surfaces import Surface


class Undulation:
    """Follows the slopes of the path from frame to frame."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget everything: the way since is not known."""
        self._way_m, self._until_m = 0.0, -math.inf
        self._signs: dict[int, int] = {}

    def add(self, ahead_m: float, surfaces: Sequence[Surface]) -> None:
        """Take a frame's `surfaces`; the camera has gone `ahead_m` since the frame before."""
        self._way_m += ahead_m
        for surface in surfaces:
            from_m, to_m = max(surface.from_m, _FROM_M), min(surface.to_m, _TO_M)
            for cell in range(self._cell(from_m) + 1, self._cell(to_m)):
                self._signs[cell] = _sign(surface)
        self._signs = {cell: sign for cell, sign in self._signs.items() if cell >= self._cell(-_BEHIND_M)}
        if self._turns() >= _TURNS:
            self._until_m = self._way_m + _GOES_ON_M

    @property
    def undulates(self) -> bool:
        """Return whether the ground rises and falls by turns."""
        return self._way_m < self._until_m

    def _turns(self) -> int:
        """Return how often the ground turns, where it slopes one way for at least some cells."""
        sloping = [sign for _, sign in sorted(self._signs.items()) if sign]
        lengths = [len(list(same)) for _, same in groupby(sloping)]
        return sum(length >= _LEAST_CELLS for length in lengths) - 1

    def _cell(self, u_m: float) -> int:
        return math.floor((self._way_m + u_m) / _CELL_M)


def _sign(surface: Surface) -> int:
    """Return whether a surface is known to rise, 1, or to fall, −1."""
    known = abs(surface.slope) > _SLOPE + _SIGMAS * surface.slope_sd
    return int(np.sign(surface.slope)) if known else 0


_FROM_M, _TO_M, _BEHIND_M = 0.2, 1.8, 0.8
"""Along u: what of a frame counts, since slopes farther off are less sure, and how far behind cells are kept."""
_CELL_M, _LEAST_CELLS = 0.1, 2
"""So many that slope one way in a row count."""
_TURNS, _GOES_ON_M = 2, 1.0
_SLOPE, _SIGMAS = math.tan(math.radians(1.0)), 1.0
"""A slope is known to be one that is larger than this by so many of its deviations."""
