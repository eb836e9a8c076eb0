"""The ground the simulated wearer walks on: a profile z(x) of straight pieces, the same at every y.

Frame W: x across the edges, y along them to the left, z up. A wearer whose course is not turned walks along x. A
profile is one lap of `length_m`, which ends at the height it began with; the world repeats it for ever. Where an upper
surface overhangs (a nosing), its riser leans: the profile there goes back by the overhang.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from messages.arrays import FloatArray
from sim_rig.walk.polish import Polish
from sim_rig.walk.relief import Relief
from sim_rig.walk.shade import Shade

_COPLANAR_RAD = 1e-6
_MAX_PIECE_M = 4.0


@dataclass(frozen=True)
class Segment:
    """A straight piece of ground from (x0, z0) to (x1, z1), walked in that order; `kind` is one of
    "level", "ramp", "kerb", "stairs". A riser has x0 = x1, or under a nosing x0 > x1. `texture_phase` moves the texture
    along the profile.
    """

    x0_m: float
    z0_m: float
    x1_m: float
    z1_m: float
    kind: str
    texture: str
    texture_phase: int = 0

    @property
    def length_m(self) -> float:
        """Return the length along the profile."""
        return math.hypot(self.x1_m - self.x0_m, self.z1_m - self.z0_m)

    @property
    def slope_rad(self) -> float:
        """Return the angle over the horizontal, ±π/2 for a riser."""
        return math.atan2(self.z1_m - self.z0_m, self.x1_m - self.x0_m)

    @property
    def is_riser(self) -> bool:
        """Return whether nobody can stand here."""
        return self.x1_m <= self.x0_m

    @property
    def lip_x_m(self) -> float:
        """Return x of the upper end, which of a riser is the edge of the upper surface."""
        return self.x1_m if self.z1_m > self.z0_m else self.x0_m

    def height_at(self, x_m: float) -> float:
        """Return z of this segment's plane at `x_m`, also beyond its ends."""
        return self.z0_m + math.tan(self.slope_rad) * (x_m - self.x0_m)

    def ahead_by(self, x_m: float) -> Segment:
        """Return the same piece `x_m` further on."""
        return replace(self, x0_m=self.x0_m + x_m, x1_m=self.x1_m + x_m)


@dataclass(frozen=True)
class World:
    """One lap of ground, repeated without end in both directions, with shadows. A `relief`, or a `polish`, is only for
    level ground."""

    lap: tuple[Segment, ...]
    length_m: float = field(init=False)
    relief: Relief | None = None
    shades: tuple[Shade, ...] = ()
    polish: Polish | None = None

    def __post_init__(self) -> None:
        if not math.isclose(self.lap[0].z0_m, self.lap[-1].z1_m, abs_tol=1e-9):
            raise ValueError(f"lap ends {self.lap[-1].z1_m - self.lap[0].z0_m:+.3f} m off the height it began with")
        level = all(s.z0_m == s.z1_m == 0.0 for s in self.lap)
        if not level and (self.relief is not None or self.polish is not None):
            raise ValueError("a relief, or a polish, lies on level ground at height 0 only")
        object.__setattr__(self, "length_m", self.lap[-1].x1_m - self.lap[0].x0_m)

    def between(self, x_from_m: float, x_to_m: float) -> Iterator[Segment]:
        """Yield every segment that touches [x_from_m, x_to_m], in walking order."""
        for lap in range(math.floor(x_from_m / self.length_m) - 1, math.floor(x_to_m / self.length_m) + 2):
            lap_m = lap * self.length_m
            for segment in self.lap:
                low_m, high_m = min(segment.x0_m, segment.x1_m), max(segment.x0_m, segment.x1_m)
                if high_m + lap_m >= x_from_m and low_m + lap_m <= x_to_m:
                    yield segment.ahead_by(lap_m)

    def shades_between(self, x_from_m: float, x_to_m: float) -> list[Shade]:
        """Return the shades of every lap that touches [x_from_m, x_to_m]."""
        laps = range(math.floor(x_from_m / self.length_m), math.floor(x_to_m / self.length_m) + 1)
        return [shade.ahead_by(lap * self.length_m) for lap in laps for shade in self.shades]

    def segment_at(self, x_m: float) -> Segment:
        """Return the piece one can stand on at `x_m`; at an edge the one behind it, under a nosing the upper one."""
        pieces = [s for s in self.between(x_m - _MAX_PIECE_M, x_m) if not s.is_riser and s.x0_m < x_m]
        last, before = pieces[-1], pieces[-2:][0]
        overhangs = before.x1_m >= x_m and before.height_at(x_m) > last.height_at(x_m)
        return before if overhangs else last

    def has_edge(self, x_from_m: float, x_to_m: float) -> bool:
        """Return whether a riser or a crease lies within [x_from_m, x_to_m]."""
        slopes = [s.slope_rad for s in self.between(x_from_m, x_to_m)]
        return max(slopes) - min(slopes) > _COPLANAR_RAD

    def between_risers(self, x_m: float) -> tuple[float, float]:
        """Return from where to where around `x_m` there is no riser, at most `_MAX_PIECE_M` either way."""
        risers = [s.lip_x_m for s in self.between(x_m - _MAX_PIECE_M, x_m + _MAX_PIECE_M) if s.is_riser]
        behind, ahead = [x for x in risers if x <= x_m], [x for x in risers if x > x_m]
        return max(behind, default=x_m - _MAX_PIECE_M), min(ahead, default=x_m + _MAX_PIECE_M)

    def heights(self, x_m: FloatArray) -> FloatArray:
        """Return z at each `x_m` (n,) of one lap or near it; at a riser the height on one of its sides, under a nosing
        that of the upper surface."""
        steps = [s for s in self.between(float(x_m.min()), float(x_m.max())) if not s.is_riser]
        rises = [following.z0_m > step.z1_m for step, following in pairwise(steps)]
        ends = [f.x0_m if up else s.x1_m for up, (s, f) in zip(rises, pairwise(steps), strict=True)]
        index = np.searchsorted(ends, x_m)
        x0, z0, slope = np.array([(s.x0_m, s.z0_m, math.tan(s.slope_rad)) for s in steps])[index].T
        heights: FloatArray = z0 + slope * (x_m - x0)
        return heights


class WorldBuilder:
    """Lays one piece of ground after another, from (0, 0) on."""

    def __init__(self) -> None:
        self.x_m = 0.0
        self.z_m = 0.0
        self._segments: list[Segment] = []

    def level(self, length_m: float, texture: str, kind: str = "level") -> WorldBuilder:
        """Add level ground."""
        return self._plane(length_m, 0.0, kind, texture)

    def ramp(self, length_m: float, slope_deg: float, texture: str) -> WorldBuilder:
        """Add a ramp of horizontal length `length_m`, uphill where `slope_deg` > 0."""
        return self._plane(length_m, length_m * math.tan(math.radians(slope_deg)), "ramp", texture)

    def step(self, rise_m: float, texture: str, kind: str = "kerb", nosing_m: float = 0.0) -> WorldBuilder:
        """Add a face, upwards where `rise_m` > 0, over which the upper surface juts out by `nosing_m`.

        Going up the face ends, going down it begins, at the edge of the upper surface.
        """
        return self._piece(-nosing_m if nosing_m else 0.0, rise_m, kind, texture)

    def stairs(
        self, count: int, rise_m: float, tread_m: float, riser: str, tread: str, nosing_m: float = 0.0
    ) -> WorldBuilder:
        """Add `count` risers with a tread between each two, `tread_m` from edge to edge; next comes the landing."""
        for _ in range(count - 1):
            self.step(rise_m, riser, "stairs", nosing_m).level(tread_m + nosing_m, tread, "stairs")
        return self.step(rise_m, riser, "stairs", nosing_m)

    def build(self, relief: Relief | None = None, shades: tuple[Shade, ...] = ()) -> World:
        """Return the world whose lap is what was laid so far, with `relief` on it and `shades` over it.

        Raises ValueError if the lap does not close.
        """
        return World(tuple(self._segments), relief, shades)

    def _plane(self, length_m: float, rise_m: float, kind: str, texture: str) -> WorldBuilder:
        pieces = math.ceil(length_m / _MAX_PIECE_M)
        for _ in range(pieces):
            self._piece(length_m / pieces, rise_m / pieces, kind, texture)
        return self

    def _piece(self, length_m: float, rise_m: float, kind: str, texture: str) -> WorldBuilder:
        x0, z0 = self.x_m, self.z_m
        self.x_m, self.z_m = x0 + length_m, z0 + rise_m
        phase = 5 * len(self._segments) if length_m < 1.0 else 0  # steps differ from each other, slabs share canvases
        self._segments.append(Segment(x0, z0, self.x_m, self.z_m, kind, texture, phase))
        return self
