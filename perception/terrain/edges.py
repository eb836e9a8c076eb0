"""Where one surface ends and another begins higher or lower: edges, each with its distance, rise and yaw.

A rising edge shows its face: where it stands is read off the face's own points. Behind a falling edge the lip hides
what lies below the line of sight: from the optical centre, a lip at u_l, h below it, hides a surface h' below up to

    u_s = u_l h' / h                                                                                            (1)

so what is first seen beyond it is what follows the lip only if no tread fits in between. Until then it is known that
the ground lies below that line: one tread t behind the lip, lower by h t / u_l at least. Ground may be in view and not
match, so no more is told than the share of one of as many equal steps as fit in before the next surface. Of steep
flights slivers of treads are seen first, too narrow for surfaces: points between the lip and the next surface, below
the one and above the other, that begin where (1) has them. What falls on from there may be the line over nosings.

Of smooth ground the last rows before a lip match in one frame and not in the next, and it is then seen to end up to
5 cm too near. The ray to what is seen first behind the lip passes over it, and so tells how far the ground may reach:
by (1) to u_s h / h'. A lip that may be anywhere in a gap g has the standard deviation g / √12.

Of what is seen too little may be left to tell its slope β, by which the rise at the edge is extrapolated over what is
hidden. Treads and kerbs lie about as the ground before them does, at β_0; with the variances of both and of how they
differ,

    β' = (β / σ_β² + β_0 / σ_0²) / (1 / σ_β² + 1 / σ_0²).                                                        (2)
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from messages.arrays import FloatArray
from perception.terrain.path_points import PathPoints
from perception.terrain.profile import BIN_M
from perception.terrain.surfaces import Surface


@dataclass(frozen=True)
class Edge:
    """An edge `distance_m` along x of H, to the border of the upper surface: the ground rises by `rise_m`.

    `yaw_rad` turns x of H to the edge's normal (> 0: to the left, so that its left end is nearer). Where
    `bound_only`, the ground falls by `rise_m` or more; where the rise is `inferred`, from another of the same flight,
    further frames make it no surer.
    """

    distance_m: float
    distance_sd_m: float
    rise_m: float
    rise_sd_m: float
    yaw_rad: float
    yaw_sd_rad: float
    bound_only: bool = False
    inferred: bool = False


def find_edges(surfaces: list[Surface], points: PathPoints, yaw_rad: float) -> list[Edge]:
    """Return the edges between `surfaces` that follow one another on the profile along `yaw_rad`."""
    edges: list[Edge | None] = []
    lips_m: list[float] = []  # of the flight so far
    parallel = side_by_side(surfaces)
    for before, after in itertools.pairwise(parallel):
        rise_m = _rise_m(before, after)
        lips_m = [*lips_m, before.to_m] if rise_m <= -LEAST_RISE_M else []
        if rise_m >= LEAST_RISE_M:
            edges.append(_rising(before, after, points, yaw_rad))
        elif lips_m:
            edges.append(_falling(before, after, points, yaw_rad, _least_tread_m(lips_m)))
    found = [edge for edge in edges if edge is not None]
    higher = _next_riser(parallel[-1], found[-2:], points, yaw_rad) if len(found) >= _LEAST_TREADS else None
    return found if higher is None else [*found, higher]


def _least_tread_m(lips_m: Sequence[float]) -> float:
    """Return how long the next tread of a flight is at least, of which these lips, the last its own, are seen."""
    treads_m = np.diff(lips_m)
    if len(treads_m) < _LEAST_TREADS or treads_m.max() > _ALIKE_TREADS * treads_m.min():
        return LEAST_TREAD_M  # one may have been missed
    return max(LEAST_TREAD_M, float(treads_m.min()) / _ALIKE_TREADS)


def common_sd_m(along_m: float, other_m: float, fB_px_m: float) -> float:
    """Return by how much, 1 σ, an error that its disparities share moves what lies `along_m` one way of the optical
    centre, ahead or down, and `other_m` the other, along the first: no number of frames takes that off.

    With f B / Z = d an error δ of d stretches its whole ray, x, h and Z alike, by Z δ / f B.
    """
    return abs(along_m) * float(np.hypot(along_m, other_m)) * OFFSET_PX / fB_px_m


def side_by_side(surfaces: Sequence[Surface]) -> list[Surface]:
    """Return the surfaces with the slopes (2); where two meet without an edge, each keeps its own."""
    told = list(surfaces[:1])
    for after in surfaces[1:]:
        told.append(_as_parallel(after, told[-1]) if abs(_rise_m(told[-1], after)) >= LEAST_RISE_M else after)
    return told


def _rise_m(before: Surface, after: Surface) -> float:
    """Return how much higher the ground is behind where two surfaces meet."""
    meet_m = 0.5 * (before.to_m + after.from_m)
    return after.at(meet_m) - before.at(meet_m)


def _as_parallel(after: Surface, before: Surface) -> Surface:
    """Return a surface with the slope (2) that its own points and the surface before it tell together."""
    own, other = after.slope_sd**-2, 1.0 / (before.slope_sd**2 + SLOPE_APART**2)
    slope = (own * after.slope + other * before.slope) / (own + other)
    return replace(after, slope=slope, slope_sd=float((own + other) ** -0.5))


def _rising(before: Surface, after: Surface, points: PathPoints, yaw_rad: float) -> Edge | None:
    """Return the edge whose face lies between two surfaces."""
    u_m = points.along(yaw_rad)
    foot_m, top_m = before.at(before.to_m), after.at(after.from_m)
    middle = (points.z_m > foot_m + 0.25 * (top_m - foot_m)) & (points.z_m < foot_m + 0.75 * (top_m - foot_m))
    face = middle & (u_m > before.to_m - _FACE_REACH_M) & (u_m < after.from_m + _FACE_REACH_M)
    gap_m = max(after.from_m - before.to_m, BIN_M)
    about = _Across(0.5 * (before.to_m + after.from_m), yaw_rad, 0.5 * gap_m, _YAW_SD_RAD)
    line = _line_across(points.x_m[face], points.y_m[face], about)
    if line is None:
        return None
    return _between(before, after, line, line.distance_m)


def _next_riser(tread: Surface, flight: Sequence[Edge], points: PathPoints, yaw_rad: float) -> Edge | None:
    """Return the edge at the end of the last surface, a `tread` of a flight whose newest two risers are given, where
    its face is seen and what lies on top of it is above the picture: as high as the riser before, about."""
    one, other = flight
    tread_m = other.distance_m - one.distance_m
    if min(one.rise_m, other.rise_m) < LEAST_RISE_M or abs(one.rise_m - other.rise_m) > RISERS_APART_M:
        return None
    if not other.distance_m - _FACE_REACH_M < tread.from_m < other.distance_m + 0.5 * tread_m < tread.to_m:
        return None
    u_m, expected_m = points.along(yaw_rad), other.distance_m + tread_m
    share = (points.z_m - tread.at(0.0) - tread.slope * u_m) / other.rise_m
    face = (share > 0.25) & (share < 0.75) & (np.abs(u_m - expected_m) < _FACE_REACH_M)
    line = _line_across(points.x_m[face], points.y_m[face], _Across(expected_m, yaw_rad, _FACE_REACH_M, _YAW_SD_RAD))
    if line is None or np.ptp(points.y_m[face]) < _LEAST_FACE_M:
        return None
    return Edge(
        distance_m=line.distance_m,
        distance_sd_m=line.distance_sd_m,
        rise_m=other.rise_m,
        rise_sd_m=float(np.hypot(other.rise_sd_m, RISERS_APART_M)),
        yaw_rad=line.yaw_rad,
        yaw_sd_rad=line.yaw_sd_rad,
        inferred=True,
    )


def _falling(before: Surface, after: Surface, points: PathPoints, yaw_rad: float, least_tread_m: float) -> Edge | None:
    """Return the edge at the end of a surface beyond which the ground is lower, no tread shorter than the least."""
    u_m = points.along(yaw_rad)
    upper = (np.abs(u_m - before.to_m) < _LIP_REACH_M) & (
        np.abs(points.z_m - before.height_m - before.slope * (u_m - before.middle_m)) < _LIP_HEIGHT_M
    )
    about = _Across(before.to_m, yaw_rad, _LIP_REACH_M, _YAW_SD_RAD)
    line = _farthest_across((points.x_m + 0.5 * points.along_m)[upper], points.y_m[upper], about)
    if line is None:
        return None
    between_rows_m = 0.5 * float(np.median(points.along_m[upper]))
    line = replace(line, distance_sd_m=float(np.hypot(line.distance_sd_m, between_rows_m)))
    lip_m, height_m = line.distance_m, -before.at(line.distance_m)
    sliver = _sliver(before, after, points, u_m, lip_m * (1.0 + _DOUBTFUL))
    from_m, z_m = sliver or (after.from_m, after.at(after.from_m))
    unmatched_m = max(from_m * height_m / -z_m - lip_m, 0.0)  # (1)
    line = replace(line, distance_sd_m=float(np.hypot(line.distance_sd_m, unmatched_m / np.sqrt(12.0))))
    edge = _between(before, after, line, lip_m)
    if from_m > lip_m * -z_m / height_m + _FROM_SHADOW_M:  # (1)
        return None
    hidden_m = from_m - lip_m
    over_nosings = after.slope < before.slope - _NOSINGS_SLOPE
    if sliver is None and hidden_m < least_tread_m and not over_nosings:
        return edge
    at_least_m = min(
        height_m * min(hidden_m - _DOUBTFUL * lip_m, LEAST_TREAD_M) / lip_m,  # (1)
        -edge.rise_m / (1 + int((after.from_m - lip_m) / LEAST_TREAD_M)),
    )
    if at_least_m < LEAST_RISE_M:
        return None
    return replace(edge, rise_m=-at_least_m, rise_sd_m=before.sd_at(lip_m), bound_only=True)


def _sliver(
    before: Surface, after: Surface, points: PathPoints, u_m: FloatArray, from_m: float
) -> tuple[float, float] | None:
    """Return where what is seen between two surfaces begins, below the one and above the other, and how high it is.

    `u_m` (n,) are the places of the `points` along the path, of which those beyond `from_m` count. None where less is
    seen than half a bin of the profile.
    """
    above_m = points.z_m - after.at(0.0) - after.slope * u_m
    below_m = before.at(0.0) + before.slope * u_m - points.z_m
    on = (u_m > from_m) & (u_m < after.from_m) & (np.minimum(above_m, below_m) > LEAST_RISE_M)
    if float(points.area_m2[on].sum()) < _SLIVER_M2:
        return None
    begins_m = float(np.quantile(u_m[on], _NEAREST))
    return begins_m, float(np.median(points.z_m[on & (u_m < begins_m + BIN_M)]))


def _between(before: Surface, after: Surface, line: "_Across", at_m: float) -> Edge:
    return Edge(
        distance_m=line.distance_m,
        distance_sd_m=line.distance_sd_m,
        rise_m=after.at(at_m) - before.at(at_m),
        rise_sd_m=float(np.hypot(before.sd_at(at_m), after.sd_at(at_m))),
        yaw_rad=line.yaw_rad,
        yaw_sd_rad=line.yaw_sd_rad,
    )


@dataclass(frozen=True)
class _Across:
    """A straight line across the path: x = `distance_m` − tan(`yaw_rad`) y."""

    distance_m: float
    yaw_rad: float
    distance_sd_m: float
    yaw_sd_rad: float


def _line_across(x_m: FloatArray, y_m: FloatArray, about: _Across) -> _Across | None:
    """Return the robust line x(y) through points (n,), of lines `about` which it is, or None where too few show it: a
    few points side by side tell little of how it is turned."""
    if len(x_m) < _LEAST_POINTS:
        return None
    design = np.column_stack((np.ones_like(y_m), y_m))
    weight = np.ones_like(x_m)
    expected = np.array([about.distance_m, -np.tan(about.yaw_rad)])
    alike = min(len(x_m), _POINTS_ALIKE)
    information = alike * np.diag([about.distance_sd_m**-2, np.tan(about.yaw_sd_rad) ** -2])
    solution, normal, scale_m = np.array([np.median(x_m), expected[1]]), np.eye(2), _LINE_FLOOR_M
    for _ in range(_ITERATIONS):
        normal = design.T @ (weight[:, None] * design) + scale_m**2 * information
        solution = np.linalg.solve(normal, design.T @ (weight * x_m) + scale_m**2 * information @ expected)
        off_m = np.abs(x_m - design @ solution)
        scale_m = max(_LINE_FLOOR_M, 1.4826 * float(np.median(off_m)))
        weight = np.clip(1.0 - (off_m / (4.685 * scale_m)) ** 2, 0.0, None) ** 2
    cov = np.linalg.inv(normal) * scale_m**2 * alike
    return _Across(
        distance_m=float(solution[0]),
        yaw_rad=-float(np.arctan(solution[1])),
        distance_sd_m=float(np.sqrt(cov[0, 0] + _LINE_FLOOR_M**2)),
        yaw_sd_rad=float(np.sqrt(cov[1, 1])),
    )


def _farthest_across(x_m: FloatArray, y_m: FloatArray, about: _Across) -> _Across | None:
    """Return the line, of lines `about` which it is, through the farthest points of each strip of the path."""
    if len(x_m) < _LEAST_POINTS:
        return None
    strip = np.floor((y_m - y_m.min()) / _STRIP_M).astype(np.intp)
    order = np.lexsort((x_m, strip))
    last = np.flatnonzero(np.diff(strip[order], append=strip.max() + 1))
    few = np.bincount(strip)[strip[order][last]] < _LEAST_OF_STRIP
    ends = order[last[~few]]
    return _line_across(x_m[ends], y_m[ends], about)


OFFSET_PX = 0.15
"""Toe-in, pixel locking, and what a matcher draws over the border of two surfaces: edges seen by another renderer's
pairs of 63 and 120 mm are off by 0.15 to 0.25 px from 1.1 to 2.5 m."""
LEAST_RISE_M = 0.04
LEAST_TREAD_M = 0.22
FLIGHT_M = 0.5
"""Edges one way that are nearer to each other than this are a flight of stairs."""
RISERS_APART_M = 0.015
"""Of one flight: what building codes allow."""
SLOPE_APART = 0.02
_LEAST_TREADS = 2
"""Of a flight, alike, that tell how long its next one is."""
_ALIKE_TREADS = 1.2
_NOSINGS_SLOPE = 0.1
"""Stairs of 12 by 36 cm fall by a third; where two treads are taken for one surface, by half of that and more."""
_DOUBTFUL = 0.05  # of the distance: so much behind a lip may be seen and not match
_FACE_REACH_M = 0.06
_LEAST_FACE_M = 0.25
"""Of its width: half of the path's. What stands on a tread is narrower."""
_LIP_REACH_M = 0.08
_LIP_HEIGHT_M = 0.02
_FROM_SHADOW_M = 0.08
_SLIVER_M2 = 0.005
_NEAREST = 0.1
_STRIP_M = 0.02
_LEAST_OF_STRIP = 2
_LEAST_POINTS = 8
_LINE_FLOOR_M = 0.004
_YAW_SD_RAD = 0.3
"""By how much edges are turned otherwise than the last ones were."""
_POINTS_ALIKE = 8
_ITERATIONS = 4
