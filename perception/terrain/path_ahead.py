"""What the frames before have shown of the path, as it lies ahead of the camera now."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from perception.terrain.edges import Edge
from perception.terrain.path_matching import PathSettings
from perception.terrain.surfaces import Surface


@dataclass(frozen=True)
class PathAhead:
    """Confirmed edges in the order of their distance, higher than bumps; the newest frame's surfaces along
    u = x + y tan(yaw), and nearer than these what only frames before it have shown. On `rough` ground surfaces meet
    beside bumps, and that is no border."""

    edges: tuple[Edge, ...] = ()
    surfaces: tuple[Surface, ...] = ()
    yaw_rad: float = 0.0
    shown_before: tuple[Surface, ...] = ()
    rough: bool = False

    def surface_at(self, u_m: float) -> Surface | None:
        """Return the surface that reaches to `u_m`, or nearly; None where none is seen."""
        return _reaching(self.surfaces, u_m)

    def known_at(self, u_m: float) -> Surface | None:
        """Return the surface at `u_m`, or else the one that was shown there before, on the same side of all edges."""
        seen = self.surface_at(u_m)
        before = None if seen is not None else _reaching(self.shown_before, u_m)
        if before is None:
            return seen
        from_m, to_m = sorted((u_m, 0.5 * (before.from_m + before.to_m)))
        return None if any(from_m < edge.distance_m < to_m for edge in self.edges) else before

    def is_one_surface(self, from_m: float, to_m: float, left_m: float) -> bool:
        """Return whether one surface is seen to reach from one place to another, x of H where y is `left_m`.

        As long as no edge ahead tells how it is turned, its end may be a turned one: to that side it ends nearer.
        """
        across_m = left_m * math.tan(self.yaw_rad)
        surface = self.surface_at(from_m + across_m)
        if surface is None or surface is not self.surface_at(to_m + across_m):
            return False
        told = any(edge.distance_m > from_m + across_m for edge in self.edges)
        turned_m = 0.0 if told else MOST_TURNED * (_HALF_WIDTH_M + abs(left_m))
        return to_m + across_m < surface.to_m - turned_m - _BESIDE_END_M

    def ends_between(self, from_m: float, to_m: float, left_m: float) -> bool:
        """Return whether the surface at the nearer of two places, x of H where y is `left_m`, ends before the other."""
        across_m = left_m * math.tan(self.yaw_rad)
        surface = self.surface_at(from_m + across_m)
        return surface is not None and from_m + across_m < surface.to_m < to_m + across_m

    def bend_near(self, x_m: float, left_m: float, within_m: float) -> float:
        """Return by how much the slope changes within so far of a place; 0 where it does not."""
        u_m = x_m + left_m * math.tan(self.yaw_rad)
        return max((abs(change) for at_m, change in self._bends() if abs(at_m - u_m) < within_m), default=0.0)

    def hidden_bend(self, x_m: float, left_m: float) -> float:
        """Return by how much the slope may change before a place and yet nobody see it, since the surface there is not
        seen far beyond, (1) of `surfaces`; 0 where no surface is seen."""
        u_m = x_m + left_m * math.tan(self.yaw_rad)
        surface = self.surface_at(u_m)
        if surface is None:
            return 0.0
        beyond_m = max(surface.to_m - u_m, _LEAST_BEYOND_M)
        return _HIDDEN_BEND * surface.far_bins_sd_m / (beyond_m * math.sqrt(beyond_m))

    def _bends(self) -> list[tuple[float, float]]:
        """Return where along u the slope changes, and by how much."""
        if self.rough:
            return []
        found = ((self._bend_between(one, other), other.slope - one.slope) for one, other in pairwise(self.surfaces))
        return [(at_m, change) for at_m, change in found if at_m is not None]

    def _bend_between(self, one: Surface, other: Surface) -> float | None:
        """Return where one surface goes over into the next; where what lies between them is covered, it is where both
        lines meet. None where the slope does not change, an edge lies between, or one ends before they meet."""
        change, gap_m = other.slope - one.slope, other.from_m - one.to_m
        if abs(change) <= _BEND:
            return None
        if gap_m < _NEARLY_M:
            return 0.5 * (one.to_m + other.from_m)
        if any(one.to_m < edge.distance_m < other.from_m for edge in self.edges):
            return None
        beyond_m = (one.at(one.to_m) - other.at(one.to_m)) / change
        return one.to_m + beyond_m if 0.0 <= beyond_m <= gap_m else None

    def edge_at(self, x_m: float, left_m: float) -> Edge | None:
        """Return the edge that is at `x_m` where y is `left_m`; None for a bend, or nothing."""
        here = [edge for edge in self.edges if edge.distance_m - left_m * math.tan(edge.yaw_rad) == x_m]
        return here[0] if here else None

    def height_before(self, x_m: float, otherwise_m: float) -> float:
        """Return how far below the camera the surface that ends at `x_m` is, or `otherwise_m` where it is not seen."""
        ending = [s for s in self.surfaces if s.from_m < x_m - _NEARLY_M and abs(s.to_m - x_m) < _SAME_M]
        return -ending[-1].at(x_m) if ending else otherwise_m

    def borders_m(self, left_m: float) -> list[float]:
        """Return x of what separates surfaces at y = `left_m`, in order: edges, and where the slope changes."""
        edges = [edge.distance_m - left_m * math.tan(edge.yaw_rad) for edge in self.edges]
        across_m = left_m * math.tan(self.yaw_rad)
        bends = [at_m - across_m for at_m, _ in self._bends()]
        return sorted(edges + [bend for bend in bends if all(abs(bend - edge) > _SAME_M for edge in edges)])


NO_PATH = PathAhead()
"""Where nothing of it has been shown."""


def moved(surface: Surface, ahead_m: float, up_m: float) -> Surface:
    """Return a surface as it lies once the camera has gone ahead and up."""
    return replace(
        surface,
        from_m=surface.from_m - ahead_m,
        to_m=surface.to_m - ahead_m,
        middle_m=surface.middle_m - ahead_m,
        height_m=surface.height_m - up_m,
    )


def _reaching(surfaces: Sequence[Surface], u_m: float) -> Surface | None:
    near = [s for s in surfaces if s.from_m - _NEARLY_M <= u_m <= s.to_m + _NEARLY_M]
    return min(near, key=lambda s: max(s.from_m - u_m, u_m - s.to_m), default=None)


MOST_TURNED = 0.47
"""tan 25°: so far an edge or a bend is taken to be turned that nothing tells of."""
_NEARLY_M = 0.06
_BEND = 0.035
_HIDDEN_BEND, _LEAST_BEYOND_M = 2.7, 0.25
"""A piece of a length L that slopes by β more leaves β² L³ / (3 b σ²) on the line before it, over bins b, and about a
tenth of it on one line through both. Two surfaces cost `_PENALTY` more: hence β L^1.5 / σ. Where the texture is poor σ
is not what one bin states, but what the few that match tell of the whole length."""
_BESIDE_END_M = 0.05
_HALF_WIDTH_M = PathSettings.half_width_m
"""Of the profile, which shows a surface as far as any part of it reaches."""
_SAME_M = 0.12
