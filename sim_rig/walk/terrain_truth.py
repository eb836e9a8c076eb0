"""What is true of the ground ahead: its edges, what of them a camera can see, its kind, and when feet come to them.

The path is the wearer's x of H from the point on the ground below the left optical centre. All geometry of sight is in
the vertical plane over the path, in which the profile's pieces are straight lines: a point is hidden where the line
from the true optical centre to it cuts one of them, or a thing, and out of view where it falls beside the picture.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import cv2
import numpy as np

from messages import Lens, Pose
from messages.arrays import BoolArray, FloatArray, IntArray
from perception.depth.rectify import intrinsics
from sim_rig.walk.footholds import Foothold, Footholds
from sim_rig.walk.obstacle_truth import ObstacleTruth, obstacle_of
from sim_rig.walk.own_legs import TOE_AHEAD_M, gone_of, swing_s
from sim_rig.walk.scenario import Scenario
from sim_rig.walk.things import Walker
from sim_rig.walk.truth import FootholdTruth, TruthSource
from sim_rig.walk.world import Segment

FARTHEST_M = 3.0
LEAST_RISE_M = 0.03
"""What is lower is no edge."""
NEAR_M = 0.6
"""How far the leading toe is from an edge when the controller must know of it."""
KIND_FROM_M, KIND_TO_M = 0.3, 1.0
BESIDE_EDGE_M = 0.35
"""So far before and behind an edge the path is that of a step or a flight: half of what tells the kind."""
FLIGHT_M = 0.5
"""Edges one way that are nearer to each other than this make a flight of stairs."""
RAMP_RAD = math.radians(1.5)
ROUGH_RMS_M = 0.01


@dataclass(frozen=True)
class EdgeTruth:
    """An edge across the path, `distance_m` ahead to the border of its upper surface; `rise_m` > 0 up.

    `yaw_rad` turns H's x to the edge's normal, > 0 to the left. `visible` is of a rising edge the share of its riser
    along the path that is seen, of a falling one the metres of path, up to the next edge, that are seen behind the lip.
    The leading toe comes within `NEAR_M` of it at `t_toe_ns`, the first foot lands beyond it at `t_contact_ns`; None
    where that never happens. `x_m` in W is its name.
    """

    distance_m: float
    rise_m: float
    yaw_rad: float
    visible: float
    x_m: float
    t_toe_ns: int | None
    t_contact_ns: int | None


@dataclass(frozen=True)
class SurfaceTruth:
    """The ground under one point: how far below the optical centre, its slopes in H, how near an edge is."""

    below_m: float
    slope_sagittal_rad: float
    slope_frontal_rad: float
    from_edge_m: float


@dataclass(frozen=True)
class TerrainTruth:
    """All that is true at one frame's exposure. `surface` is that under the next `foothold`; both None for who stands.

    `kind` is that of most of the path from `KIND_FROM_M` to `KIND_TO_M`. Times are true ones. `x_W_m` and `way_m` tell
    where the origin of H is across the edges, and how far the path's direction leads across them in a metre.
    """

    t_exposure_ns: int
    t_true_ns: int
    kind: str
    edges: tuple[EdgeTruth, ...]
    foothold: FootholdTruth | None
    surface: SurfaceTruth | None
    x_W_m: float
    way_m: float


class _Eye(NamedTuple):
    """The left camera at one instant: its centre o_W (3,), R_WE (3, 3), and H's x in W (2,)."""

    o_W: FloatArray
    R_WE: FloatArray
    ahead: FloatArray


class TerrainTruthSource:
    """Tells the truth about the ground ahead of one unit's left camera on one walk."""

    def __init__(
        self, X_BE: Pose, axis_E: FloatArray, lens: Lens, scenario: Scenario, footholds: Footholds, walker: Walker
    ) -> None:
        self._X_BE = X_BE
        self._axis_E = axis_E
        self._lens = lens
        self._scenario = scenario
        self._world = scenario.world
        self._walker = walker
        self._footholds = TruthSource(X_BE, axis_E, scenario.world, walker.gait, footholds)
        self._feet = Feet(footholds, walker.gait.start_ns, scenario.course_rad)

    def at(self, t_ns: int, stamp_ns: int, left: bool | None = None) -> TerrainTruth:
        """Return the truth at the true instant `t_ns`, under the name `stamp_ns` that the frame goes by.

        The foothold is that of the left or the right foot where one is named.
        """
        eye = self._eye(t_ns)
        foothold = self._footholds.next_foothold(t_ns, left)
        return TerrainTruth(
            t_exposure_ns=stamp_ns,
            t_true_ns=t_ns,
            kind=self._kind(eye),
            edges=tuple(self._edges(eye, t_ns)),
            foothold=foothold,
            surface=None if foothold is None else self._surface(eye, foothold.ahead_m, foothold.left_m),
            x_W_m=float(eye.o_W[0]),
            way_m=float(eye.ahead[0]),
        )

    def obstacles_at(self, t_ns: int, half_width_m: float) -> list[ObstacleTruth]:
        """Return the things on a path of `half_width_m` to either side at the true instant `t_ns`, by distance."""
        eye, at_ns = self._eye(t_ns), np.array([t_ns])
        motion = self._walker.gait.at(at_ns)
        found = [
            obstacle
            for thing in self._scenario.things
            for obstacle in obstacle_of(
                thing, thing.placed(self._walker, at_ns, motion), eye.o_W, eye.ahead, half_width_m, self._world
            )
        ]
        return sorted((o for o in found if -FARTHEST_M < o.distance_m < FARTHEST_M), key=lambda o: o.distance_m)

    def surface_at(self, t_ns: int, ahead_m: float, left_m: float) -> SurfaceTruth:
        """Return the ground under a point of H at the true instant `t_ns`."""
        return self._surface(self._eye(t_ns), ahead_m, left_m)

    def _eye(self, t_ns: int) -> _Eye:
        motion = self._walker.gait.at(np.array([t_ns]))
        R_WE = motion.R_WB[0] @ np.array(self._X_BE.R)
        axis_W = R_WE @ self._axis_E
        o_W = motion.p_WB_m[0] + motion.R_WB[0] @ np.array(self._X_BE.p_m)
        return _Eye(o_W, R_WE, axis_W[:2] / np.hypot(*axis_W[:2]))

    def _pieces(self, eye: _Eye, from_m: float, to_m: float) -> list[Segment]:
        """Return the pieces along the path from `from_m` to `to_m`."""
        ends = sorted(float(eye.o_W[0] + d * eye.ahead[0]) for d in (from_m, to_m))
        return list(self._world.between(*ends))

    def _risers(self, eye: _Eye, from_m: float, to_m: float) -> list[tuple[float, float, Segment]]:
        """Return distance along the path, rise in its direction and piece of each edge, in the order of the path."""
        way = float(eye.ahead[0])
        if abs(way) < _ALONG_EDGES:
            return []
        found = [
            (float(p.lip_x_m - eye.o_W[0]) / way, math.copysign(1.0, way) * (p.z1_m - p.z0_m), p)
            for p in self._pieces(eye, from_m, to_m)
            if p.is_riser and abs(p.z1_m - p.z0_m) >= LEAST_RISE_M
        ]
        return sorted((d, rise, p) for d, rise, p in found if from_m <= d <= to_m)

    def _edges(self, eye: _Eye, t_ns: int) -> list[EdgeTruth]:
        risers = self._risers(eye, 0.0, FARTHEST_M)
        forward = eye.ahead * math.copysign(1.0, eye.ahead[0])
        return [
            EdgeTruth(
                distance_m=d,
                rise_m=rise,
                yaw_rad=-math.atan2(forward[1], forward[0]),
                visible=self._riser_seen(eye, piece, t_ns)
                if rise > 0
                else self._beyond_seen(eye, d, following, piece, t_ns),
                x_m=piece.lip_x_m,
                t_toe_ns=self._feet.toe_within_ns(piece.lip_x_m),
                t_contact_ns=self._feet.contact_ns(piece.lip_x_m),
            )
            for (d, rise, piece), following in zip(risers, [*(r[0] for r in risers[1:]), FARTHEST_M], strict=False)
        ]

    def _riser_seen(self, eye: _Eye, riser: Segment, t_ns: int) -> float:
        share = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
        x = riser.x0_m + share * (riser.x1_m - riser.x0_m)
        z = riser.z0_m + share * (riser.z1_m - riser.z0_m)
        return float(self._seen(eye, (x - eye.o_W[0]) / eye.ahead[0], z, t_ns).mean())

    def _beyond_seen(self, eye: _Eye, from_m: float, to_m: float, riser: Segment, t_ns: int) -> float:
        """Return the metres of path in view on the surface below a lip, which reaches from lip to next edge."""
        d = np.arange(from_m + 0.5 * _GRAIN_M, to_m, _GRAIN_M)
        if not len(d):  # a lip at the end of the path
            return 0.0
        x = eye.o_W[0] + d * eye.ahead[0]
        lower_m = min(riser.z0_m, riser.z1_m)
        z = self._world.heights(x)
        on_lower = np.abs(z - lower_m) < abs(riser.z1_m - riser.z0_m)
        return float(_GRAIN_M * np.count_nonzero(self._seen(eye, d[on_lower], z[on_lower], t_ns)))

    def _seen(self, eye: _Eye, d: FloatArray, z: FloatArray, t_ns: int) -> BoolArray:
        """Return whether points of the path's plane (n,) are in the picture and before all else."""
        points_W = np.column_stack((eye.o_W[:2] + d[:, None] * eye.ahead, z))
        seen = self._in_picture(eye, points_W)
        sight = np.column_stack((d, z - eye.o_W[2]))
        for piece in self._pieces(eye, -_LONGEST_PIECE_M, FARTHEST_M + _LONGEST_PIECE_M):
            begin, end = (
                np.array([(x - eye.o_W[0]) / eye.ahead[0], z - eye.o_W[2]])
                for x, z in ((piece.x0_m, piece.z0_m), (piece.x1_m, piece.z1_m))
            )
            seen &= ~_cut(sight, begin, end)
        instants_ns = np.full(len(points_W), t_ns)
        eye_W = np.broadcast_to(eye.o_W, points_W.shape)
        if self._scenario.things:
            motion = self._walker.gait.at(instants_ns)
            for thing in self._scenario.things:
                for placed in thing.placed(self._walker, instants_ns, motion):
                    seen &= ~placed.hides(eye_W, points_W)
        return seen

    def _in_picture(self, eye: _Eye, points_W: FloatArray) -> BoolArray:
        points_E = (points_W - eye.o_W) @ eye.R_WE
        before = points_E[:, 2] > _NEAREST_M
        rays = points_E / np.where(before, points_E[:, 2], 1.0)[:, None]
        within = before & (np.abs(rays[:, :2]) < _WIDEST).all(axis=1)
        if not len(points_W):
            return within
        none = np.zeros(3)
        pixels, _ = cv2.projectPoints(rays, none, none, intrinsics(self._lens), np.array(self._lens.distortion))
        size = (self._lens.width_px - 1, self._lens.height_px - 1)
        in_picture: BoolArray = within & ((pixels[:, 0] >= 0) & (pixels[:, 0] <= size)).all(axis=1)
        return in_picture

    def _kind(self, eye: _Eye) -> str:
        d = np.arange(KIND_FROM_M + 0.5 * _CELL_M, KIND_TO_M, _CELL_M)
        risers = self._risers(eye, KIND_FROM_M - 2.0, KIND_TO_M + 2.0)
        near = [(self._edge_kind(risers, k), at) for k, (at, _, _) in enumerate(risers)]
        flights = [
            (kind, 0.5 * (one + other), 0.5 * (other - one) + BESIDE_EDGE_M)
            for (kind, one), (other_kind, other) in pairwise(near)
            if kind == other_kind and kind.startswith("stairs") and other - one < FLIGHT_M
        ]
        reach = flights + [(kind, at, BESIDE_EDGE_M) for kind, at in near]
        kinds = []
        for at_m in d.tolist():
            beside = [(abs(at_m - middle), kind) for kind, middle, half in reach if abs(at_m - middle) <= half]
            kinds.append(min(beside)[1] if beside else self._surface_kind(eye, at_m))
        return max(dict.fromkeys(kinds), key=kinds.count)

    @staticmethod
    def _edge_kind(risers: list[tuple[float, float, Segment]], k: int) -> str:
        at, rise, _ = risers[k]
        others = risers[max(0, k - 1) : k] + risers[k + 1 : k + 2]
        flight = any(abs(other - at) < FLIGHT_M and other_rise * rise > 0 for other, other_rise, _ in others)
        return f"{'stairs' if flight else 'step'}_{'up' if rise > 0 else 'down'}"

    def _surface_kind(self, eye: _Eye, at_m: float) -> str:
        if self._world.relief is not None and self._world.relief.rms_m >= ROUGH_RMS_M:
            return "rough"
        _, gradient = self._ground(eye, at_m, 0.0)
        slope = math.atan(gradient @ eye.ahead)
        return "level" if abs(slope) < RAMP_RAD else "ramp_up" if slope > 0 else "ramp_down"

    def _surface(self, eye: _Eye, ahead_m: float, left_m: float) -> SurfaceTruth:
        (c, s), (z, gradient) = eye.ahead, self._ground(eye, ahead_m, left_m)
        edges = [abs(d - ahead_m) for d, _, _ in self._risers(eye, ahead_m - 1.0, ahead_m + 1.0)]
        return SurfaceTruth(
            below_m=float(eye.o_W[2] - z),
            slope_sagittal_rad=math.atan(gradient @ (c, s)),
            slope_frontal_rad=math.atan(gradient @ (-s, c)),
            from_edge_m=min(edges, default=math.inf),
        )

    def _ground(self, eye: _Eye, ahead_m: float, left_m: float) -> tuple[float, FloatArray]:
        """Return z of the ground under a point of H, and its gradient (2,) in W."""
        p = eye.o_W[:2] + ahead_m * eye.ahead + left_m * np.array((-eye.ahead[1], eye.ahead[0]))
        ground = self._world.segment_at(float(p[0]))
        z, gradient = ground.height_at(float(p[0])), np.array([math.tan(ground.slope_rad), 0.0])
        if self._world.relief is not None:
            around = np.stack(np.meshgrid(*[np.linspace(-_SOLE_M, _SOLE_M, 9)] * 2), axis=-1).reshape(-1, 2)
            heights = self._world.relief.heights(*(p + around).T)
            a, b, mean = np.linalg.lstsq(np.column_stack((around, np.ones(len(around)))), heights)[0]
            z, gradient = z + float(mean), np.array([a, b])
        return z, gradient


class Feet:
    """When toes and feet come to a place across the edges, of a wearer who walks the way of W's x.

    Feet swing as `own_legs` draws them.
    """

    def __init__(self, footholds: Footholds, start_ns: int, course_rad: float) -> None:
        landings: list[Foothold] = []
        while len(landings) < _MOST_LANDINGS:
            landing = footholds.next_after(landings[-1].t_land_ns if landings else start_ns)
            if landing is None:
                break
            landings.append(landing)
        self._land_ns: IntArray = np.array([each.t_land_ns for each in landings], np.int64)
        self._x_m = np.array([each.p_WF_m[0] for each in landings])
        self._toe_m = TOE_AHEAD_M * math.cos(course_rad)
        self._near_m = NEAR_M * math.cos(course_rad)

    def contact_ns(self, x_m: float) -> int | None:
        """Return when the first foot lands with its middle beyond `x_m` of W."""
        beyond = np.flatnonzero(self._x_m > x_m)
        return int(self._land_ns[beyond[0]]) if len(beyond) else None

    def toe_within_ns(self, x_m: float) -> int | None:
        """Return when the leading toe is `NEAR_M` of path from `x_m` of W; the first landing's instant at the latest
        where it is from the start."""
        wanted_m = x_m - self._near_m - self._toe_m
        reached = np.flatnonzero(self._x_m >= wanted_m)
        if not len(reached):
            return None
        n = int(reached[0])
        if n < 2:
            return int(self._land_ns[n])
        from_m, to_m = self._x_m[n - 2], self._x_m[n]
        swung = np.linspace(0.0, 1.0, 201)
        share = float(np.interp((wanted_m - from_m) / (to_m - from_m), gone_of(swung), swung))
        stride_s = 1e-9 * float(self._land_ns[n] - self._land_ns[n - 2])
        return int(self._land_ns[n]) - round(1e9 * (1.0 - share) * swing_s(stride_s))


def _cut(sight: FloatArray, begin: FloatArray, end: FloatArray) -> BoolArray:
    """Return whether the lines from the origin to each of `sight` (n, 2) cut the piece from `begin` to `end` (2,)
    before they end. With p = t·q on the line and p = a + s·b on the piece, t = a×b / q×b and s = a×q / q×b."""
    along = end - begin
    across = sight[:, 0] * along[1] - sight[:, 1] * along[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (begin[0] * along[1] - begin[1] * along[0]) / across
        s = (begin[0] * sight[:, 1] - begin[1] * sight[:, 0]) / across
    cut: BoolArray = (t > 0) & (t < 1.0 - _TOUCHING) & (s >= 0) & (s <= 1)
    return cut


_ALONG_EDGES = 0.2  # of H's x across the edges, below which the path leads along them
_SAMPLES = 60
_GRAIN_M = 0.004
_CELL_M = 0.02
_NEAREST_M = 0.05
_WIDEST = 1.1  # of a ray's x and y beside z: just beyond the picture's corners, before lens distortion folds back
_LONGEST_PIECE_M = 4.5
_TOUCHING = 1e-6
_SOLE_M = 0.10
_MOST_LANDINGS = 200
