"""The wearer's gait as the pipeline meets it: attitudes and the ankle's states in, the next foothold out."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from messages import (
    AnkleState,
    GroundPlane,
    NextFoothold,
    Side,
    Status,
    StereoCalibration,
    Terrain,
    TerrainEdge,
    TerrainKind,
    UnitCalibration,
    full_matrix,
    upper_triangle,
)
from messages.arrays import FloatArray
from perception.attitude.history import AttitudeAt
from perception.gait.landing import Landing, next_landing, off_edges
from perception.gait.stance import GroundHeight, StanceGround
from perception.gait.watch import GaitWatch
from perception.ground.sole import about
from perception.heading import heading
from perception.terrain.path_ahead import MOST_TURNED, PathAhead


@dataclass(frozen=True)
class NextSteps:
    """Where the prosthetic foot and the other one land next; None where no walk is seen."""

    prosthetic: Landing | None = None
    other: Landing | None = None


class Gait:
    """Predicts landings. `R_BC` (3, 3) takes vectors of the rectified left camera to B; `side` is the prosthesis's."""

    def __init__(self, calibration: UnitCalibration, R_BC: FloatArray, side: Side) -> None:
        self._R_BC = R_BC
        camera = calibration.camera
        # two eyes are worn before the wearer's middle; of a depth camera, its one eye
        self._middle_left_m = 0.5 * camera.X_RL.p_m[0] if isinstance(camera, StereoCalibration) else 0.0
        self._watch = GaitWatch(np.array(calibration.X_BE.p_m))
        self._stance = StanceGround()
        self._bends: deque[tuple[int, float]] = deque(maxlen=_MOST_BENDS)
        self.side = side

    def add_ankle(self, state: AnkleState) -> None:
        """Take what the ankle says of its own foot."""
        self._watch.add_ankle(state)

    def add_frame(self, placed: AttitudeAt, at: Callable[[int], AttitudeAt | None], path: PathAhead) -> NextSteps:
        """Come to a frame, exposed when the attitude was `placed`; `at` tells that of other instants.

        Return the next landings in H of that frame, on the surfaces of the `path`.
        """
        self._watch.add_frame(placed.t_ns, at, self.side)
        R_WH = heading(placed.R_WB @ self._R_BC)
        if R_WH is None:
            return NextSteps()
        heading_rad = math.atan2(R_WH[1, 0], R_WH[0, 0])
        found = (
            next_landing(self._watch, placed.t_ns, heading_rad, left, self._middle_left_m) for left in (True, False)
        )
        left, right = (None if landing is None else off_edges(landing, path) for landing in found)
        return NextSteps(left, right) if self.side is Side.LEFT else NextSteps(right, left)

    def with_foothold(self, terrain: Terrain, steps: NextSteps, ground: GroundPlane, path: PathAhead) -> Terrain:
        """Return `terrain` with the foothold of the same frame, where it is valid."""
        ground, bend = self._under(steps.prosthetic, ground, path, terrain.kind, terrain.edges)
        level_m = self._watch.trail.height_at_m(ground.t_exposure_ns)
        height = _height_on(ground, steps.prosthetic, level_m)
        self._stance.add(self.side, steps.prosthetic, height)
        other = Side.RIGHT if self.side is Side.LEFT else Side.LEFT
        self._stance.add(other, steps.other, _height_of(path, steps.other, level_m))
        if terrain.status is not Status.VALID:
            return terrain
        foothold = _foothold(self.side, steps.prosthetic, ground, bend, self._stance.rise_to(height))
        return msgspec.structs.replace(terrain, foothold=foothold)

    def foothold(self, steps: NextSteps, ground: GroundPlane, path: PathAhead, kind: TerrainKind) -> NextFoothold:
        """Return the foothold as far as it is known before the terrain of its frame; `kind` is of the frame before."""
        ground, bend = self._under(steps.prosthetic, ground, path, kind)
        return _foothold(self.side, steps.prosthetic, ground, bend, (math.nan, math.nan))

    def _under(
        self,
        landing: Landing | None,
        ground: GroundPlane,
        path: PathAhead,
        kind: TerrainKind,
        edges: Sequence[TerrainEdge] = (),
    ) -> tuple[GroundPlane, float]:
        """Return `ground`, invalid where it is not that under the foot, and the bend beside it."""
        bend = self._bend_under(landing, ground.t_exposure_ns, path)
        if landing is not None and not _is_under(ground, landing, path, kind, edges):
            ground = msgspec.structs.replace(ground, status=Status.INVALID)
        elif landing is not None and landing.ahead_m > ground.ahead_m + _BESIDE_M:
            ground = _beyond(ground, path.hidden_bend(landing.ahead_m, landing.left_m))
        return ground, bend

    def _bend_under(self, landing: Landing | None, t_ns: int, path: PathAhead) -> float:
        """Return the largest change of the slope that was seen beside the foothold of late: how near it is, no frame
        tells well, and the last of a slope passes out of the picture before the foot is there."""
        if landing is not None:
            self._bends.append((t_ns, path.bend_near(landing.ahead_m, landing.left_m, _BEND_REACH_M)))
        while self._bends and t_ns - self._bends[0][0] > _BEND_LASTS_NS:
            self._bends.popleft()
        return max((bend for _, bend in self._bends), default=0.0)


def _is_under(
    ground: GroundPlane, landing: Landing, path: PathAhead, kind: TerrainKind, edges: Sequence[TerrainEdge]
) -> bool:
    """Return whether the plane that was measured is seen to be that of the place where a foot lands: none of the
    `edges` of the same frame, nor an end of the surface, lies in between. On rough ground no plane reaches far."""
    from_m, to_m = sorted((ground.ahead_m, landing.ahead_m))
    at_m = (edge.distance_m - landing.left_m * math.tan(edge.yaw_rad) for edge in edges)
    if any(from_m < each < to_m for each in at_m):
        return False
    if to_m - from_m < _BESIDE_M:
        return not path.ends_between(from_m, to_m, landing.left_m)
    return kind is not TerrainKind.ROUGH and path.is_one_surface(ground.ahead_m, landing.ahead_m, landing.left_m)


def _beyond(ground: GroundPlane, bend: float) -> GroundPlane:
    """Return a measured plane as it tells of ground beyond its region, before which the slope may change by `bend`,
    along or across: nothing tells how a bend that nobody sees is turned."""
    slope_cov = (0.5 * bend) ** 2 * np.eye(2)
    covariance = full_matrix(ground.covariance) + about(ground.ahead_m, ground.left_m, slope_cov)
    return msgspec.structs.replace(ground, covariance=upper_triangle(covariance))


def _height_on(ground: GroundPlane, landing: Landing | None, level_m: float) -> GroundHeight | None:
    """Return the height of the measured plane where a foot lands."""
    if landing is None or ground.status is not Status.VALID:
        return None
    place = np.array([-landing.ahead_m, -landing.left_m, 1.0])
    slopes = np.array([math.tan(ground.slope_sagittal_rad), math.tan(ground.slope_frontal_rad), ground.height_m])
    variance_m2 = float(place @ full_matrix(ground.covariance) @ place)
    return GroundHeight(level_m - float(place @ slopes), math.sqrt(max(variance_m2, 0.0)))


def _height_of(path: PathAhead, landing: Landing | None, level_m: float) -> GroundHeight | None:
    """Return the height of the surface that the frames before have shown where a foot lands."""
    if landing is None:
        return None
    u_m = landing.ahead_m + landing.left_m * math.tan(path.yaw_rad)
    surface = path.surface_at(u_m)
    if surface is None:
        return None
    return GroundHeight(level_m + surface.at(u_m), math.hypot(surface.sd_at(u_m), _PROFILE_SD_M))


def _foothold(
    side: Side, landing: Landing | None, ground: GroundPlane, bend: float, rise: tuple[float, float]
) -> NextFoothold:
    """Return the foothold of a `landing` on the `ground` of the same frame; `rise`, m, comes with its deviation.

    Beside a `bend`, a change of the slope, the slope is as uncertain as that, and as it may be turned so is the one
    across.

    Without a landing nothing of it is known, without valid ground nothing of that.
    """
    if landing is None:
        return NextFoothold.unknown(side)
    place = msgspec.structs.replace(
        NextFoothold.unknown(side),
        ahead_m=landing.ahead_m,
        ahead_sd_m=landing.ahead_sd_m,
        left_m=landing.left_m,
        left_sd_m=landing.left_sd_m,
        time_to_contact_s=landing.time_s,
        time_to_contact_sd_s=landing.time_sd_s,
    )
    if ground.status is not Status.VALID:
        return place
    slope_sagittal_sd_rad, slope_frontal_sd_rad, height_sd_m = np.sqrt(np.diag(full_matrix(ground.covariance))).tolist()
    return msgspec.structs.replace(
        place,
        slope_sagittal_rad=ground.slope_sagittal_rad,
        slope_sagittal_sd_rad=math.hypot(slope_sagittal_sd_rad, 0.5 * bend),
        slope_frontal_rad=ground.slope_frontal_rad,
        slope_frontal_sd_rad=math.hypot(slope_frontal_sd_rad, 0.5 * MOST_TURNED * bend),
        height_m=ground.height_m,
        height_sd_m=height_sd_m,
        rise_m=rise[0],
        rise_sd_m=rise[1],
    )


_BESIDE_M = 0.15
_BEND_REACH_M = 0.3
_BEND_LASTS_NS, _MOST_BENDS = 1_200_000_000, 128
_PROFILE_SD_M = 0.005
"""What the profile's heights are off together, 1 σ, beside what each states."""
