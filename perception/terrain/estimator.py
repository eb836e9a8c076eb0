"""A frame and the attitude at its mid-exposure to the published surfaces and edges of the path ahead."""

import math
from functools import partial
from typing import NamedTuple

import numpy as np

from messages import (
    Frame,
    GroundPlane,
    NextFoothold,
    Reason,
    Side,
    Status,
    Terrain,
    TerrainEdge,
    TerrainObstacle,
    UnitCalibration,
    Vec3,
)
from messages.arrays import FloatArray
from perception import so3
from perception.depth.disparity import DisparityCamera
from perception.heading import heading
from perception.terrain.edges import Edge, common_sd_m, find_edges
from perception.terrain.flight import drops_alike
from perception.terrain.kinds import FROM_M, ROUGH_M, higher_than_bumps, kind_of
from perception.terrain.memory import EdgeMemory
from perception.terrain.near_ground import NearGround
from perception.terrain.obstacle_memory import ObstacleMemory
from perception.terrain.obstacles import Obstacle, Scatter, find_obstacles
from perception.terrain.path_ahead import PathAhead, moved
from perception.terrain.path_matching import Beside, PathMatching, PathSettings, in_turn, match_path
from perception.terrain.path_points import find_points
from perception.terrain.profile import profile_of
from perception.terrain.roughness import Roughness
from perception.terrain.surfaces import PathSurfaces, Surface, find_surfaces
from perception.terrain.undulation import Undulation


class TerrainEstimator:
    """Finds surfaces and edges frame by frame and remembers the edges while the wearer walks over them.

    `R_BC` (3, 3) takes vectors of `camera` to B; `nominal_height_m` is how high it is taken to be before ground is
    seen; `side` is that of the prosthesis.
    """

    def __init__(
        self,
        calibration: UnitCalibration,
        camera: DisparityCamera,
        R_BC: FloatArray,
        nominal_height_m: float,
        side: Side,
        path: PathSettings | None = None,
    ) -> None:
        self._calibration_id = calibration.id
        self._camera = camera
        self._R_BC = R_BC
        self._p_BC_m = np.array(calibration.X_BE.p_m)
        self._path = path or PathSettings()
        self._height_m = nominal_height_m
        self.side = side
        self.beside: Beside = in_turn
        self.begin_anew()

    def begin_anew(self) -> None:
        """Forget all that was seen of the path."""
        self._memory = EdgeMemory()
        self._obstacles = ObstacleMemory(self._path.half_width_m)
        self._roughness = Roughness()
        self._undulation = Undulation()
        self._near = NearGround()
        self._scatter = Scatter()
        self.surfaces = PathSurfaces((), 0.0)
        """Those that the newest estimate was made of."""
        self._seen: _Seen | None = None

    def path_ahead(self, t_ns: int, R_WB: FloatArray, w_WB_B_radps: Vec3, v_W_mps: Vec3) -> PathAhead:
        """Return what the frames before have shown of the path, as it lies in H at `t_ns`."""
        R_WH, seen = heading(R_WB @ self._R_BC), self._seen
        if R_WH is None or seen is None or not seen.lasts(t_ns):
            return PathAhead()
        v_C_W = np.array(v_W_mps) + R_WB @ so3.skew(np.array(w_WB_B_radps)) @ self._p_BC_m
        edges = self._memory.expected(t_ns, v_C_W[:2], math.atan2(R_WH[1, 0], R_WH[0, 0]))
        gone_m = seen.ahead_and_up_m(t_ns, v_C_W, R_WH)
        surfaces, before = (
            tuple(moved(surface, *gone_m) for surface in each) for each in (seen.surfaces, seen.shown_before)
        )
        rough_m = self._roughness.rough_m
        steps = higher_than_bumps(edges, _HIGHEST_BUMPS * rough_m)
        return PathAhead(tuple(steps), surfaces, seen.yaw_rad, before, rough=rough_m > ROUGH_M)

    def begin_matching(self, frame: Frame, R_WB: FloatArray) -> PathMatching | None:
        """Begin to match the path that `frame` shows, for `estimate`, where `R_WB` is its attitude as far as it is
        known before anything has been made of the frame; None where it shows none."""
        R_WC = R_WB @ self._R_BC
        R_WH = heading(R_WC)
        if R_WH is None or not self._fits(frame):
            return None
        return self._matching(frame, R_WH.T @ R_WC)

    def _matching(self, frame: Frame, R_HC: FloatArray) -> PathMatching:
        work = partial(match_path, self._camera, frame.images, R_HC, self._height_m, self._path)
        return PathMatching(R_HC, self.beside(work))

    def estimate(
        self,
        frame: Frame,
        R_WB: FloatArray,
        w_WB_B_radps: Vec3,
        v_W_mps: Vec3,
        *,
        height_rate_mps: float = 0.0,
        distance_scale: float = 0.0,
        ground: GroundPlane | None = None,
        matching: PathMatching | None = None,
    ) -> Terrain:
        """Return the terrain in H of `frame`, given attitude, rate and velocity of the IMU at mid-exposure.

        `height_rate_mps` is how fast the camera moves away from the ground; `distance_scale` by what share the camera's
        distances are too long. What looks as much like the `ground` of the same frame, where that is valid, is that;
        as its disparities scatter, so do those of things. `matching` is what was begun with this frame.
        """
        if not self._fits(frame):
            return self.no_terrain(frame.header.t_exposure_ns, frame.header.seq, Reason.WRONG_SIZE)
        R_WC = R_WB @ self._R_BC
        R_WH = heading(R_WC)
        if R_WH is None:
            return self.no_terrain(frame.header.t_exposure_ns, frame.header.seq, Reason.FOOTHOLD_OUT_OF_VIEW)
        R_HC = R_WH.T @ R_WC
        if matching is None or not matching.serves(R_HC):
            matching = self._matching(frame, R_HC)
        w_B = np.array(w_WB_B_radps)
        points = find_points(
            self._camera,
            frame.images,
            matching.result(),
            R_HC,
            self._R_BC.T @ w_B,
            height_rate_mps,
            self._height_m,
            self._path,
            None if ground is None else _nearness_H(ground, 1.0 + distance_scale),
        )
        heading_rad = math.atan2(R_WH[1, 0], R_WH[0, 0])
        yaw_rad = self._memory.expected_yaw_rad(heading_rad)
        profile = profile_of(points, yaw_rad, 2.0 * self._path.half_width_m)
        surfaces = find_surfaces(profile)
        self.surfaces = PathSurfaces(surfaces, yaw_rad)
        if ground is not None and self._roughness.rough_m <= ROUGH_M:
            self._scatter.add(ground.disparity_noise_px)
        things, on_thing = find_obstacles(
            points, self.surfaces, self._roughness.rough_m, self._path.half_width_m, self._scatter.of_stated
        )
        v_C_W = np.array(v_W_mps) + R_WB @ so3.skew(w_B) @ self._p_BC_m
        gone_m = self._gone_m(frame.header.t_exposure_ns, v_C_W, R_WH)
        self._roughness.add(points.where(~on_thing), profile, surfaces, yaw_rad, gone_m[0])
        found = find_edges(surfaces, points, yaw_rad)
        edges = self._memory.update(frame.header.t_exposure_ns, v_C_W[:2], heading_rad, found, surfaces)
        obstacles = self._obstacles.update(frame.header.t_exposure_ns, v_C_W[:2], heading_rad, things)
        self._undulation.add(gone_m[0], surfaces)
        shown = self._near.update(frame.header.t_exposure_ns, *gone_m, surfaces)
        before = shown[: len(shown) - len(surfaces)]
        self._seen = _Seen(frame.header.t_exposure_ns, v_C_W, surfaces, before, yaw_rad)
        self._follow_height(surfaces)
        if not surfaces:
            return self.no_terrain(frame.header.t_exposure_ns, frame.header.seq, Reason.LOW_TEXTURE)
        fB_px_m = self._camera.f_px * self._camera.baseline_m
        kind, probability = kind_of(shown, edges, self._roughness.rough_m, undulates=self._undulation.undulates)
        return Terrain(
            t_exposure_ns=frame.header.t_exposure_ns,
            frame_seq=frame.header.seq,
            status=Status.VALID,
            reason=Reason.NONE,
            kind=kind,
            probability=probability,
            edges=tuple(self._told(edge, 1.0 + distance_scale) for edge in drops_alike(edges, self._height_m, fB_px_m)),
            obstacles=tuple(_obstacle(each, 1.0 + distance_scale) for each in obstacles),
            foothold=NextFoothold.unknown(self.side),
            calibration_id=self._calibration_id,
        )

    def _fits(self, frame: Frame) -> bool:
        return tuple(image.shape[::-1] for image in frame.images) == tuple(self._camera.image_sizes_px)

    def no_terrain(self, t_exposure_ns: int, frame_seq: int, reason: Reason) -> Terrain:
        """Return the estimate that says only why there is none."""
        return Terrain.invalid(
            t_exposure_ns=t_exposure_ns,
            frame_seq=frame_seq,
            reason=reason,
            side=self.side,
            calibration_id=self._calibration_id,
        )

    def _gone_m(self, t_ns: int, v_C_W_mps: FloatArray, R_WH: FloatArray) -> tuple[float, float]:
        """Return how far the camera has gone ahead and up since the frame before. Across a gap that is not known: what
        lay near the feet is forgotten, and it is 0."""
        if self._seen is None or not self._seen.lasts(t_ns):
            self._near.clear()
            self._undulation.clear()
            self._roughness.lose_way()
            return 0.0, 0.0
        return self._seen.ahead_and_up_m(t_ns, v_C_W_mps, R_WH)

    def _told(self, edge: Edge, too_long: float) -> TerrainEdge:
        """Return an edge with its lengths corrected for distances that are `too_long` times as long as true ones."""
        common_m = common_sd_m(edge.distance_m, self._height_m, self._camera.f_px * self._camera.baseline_m)
        return TerrainEdge(
            distance_m=edge.distance_m / too_long,
            distance_sd_m=math.hypot(edge.distance_sd_m, common_m),
            rise_m=edge.rise_m / too_long,
            rise_sd_m=edge.rise_sd_m,
            bound_only=edge.bound_only,
            yaw_rad=edge.yaw_rad,
        )

    def _follow_height(self, surfaces: list[Surface]) -> None:
        """Take the height over the nearest surface for that over the ground that the wearer stands on."""
        near = [-surface.at(surface.from_m) for surface in surfaces if surface.from_m < FROM_M]
        if near and _LOWEST_M < near[0] < _HIGHEST_M:
            self._height_m += _FOLLOWS * (near[0] - self._height_m)


class _Seen(NamedTuple):
    """The surfaces of a frame, and nearer than these those shown before, along u of this yaw; the camera's velocity in
    W (3,) then."""

    t_ns: int
    v_W_mps: FloatArray
    surfaces: list[Surface]
    shown_before: list[Surface]
    yaw_rad: float

    def lasts(self, t_ns: int) -> bool:
        """Return whether what was seen may still be carried to `t_ns`."""
        return 0 <= t_ns - self.t_ns <= _PATH_LASTS_NS

    def ahead_and_up_m(self, t_ns: int, v_W_mps: FloatArray, R_WH: FloatArray) -> tuple[float, float]:
        """Return how far the camera, at `v_W_mps` (3,) now, has gone along x of H and upwards."""
        way_m = 0.5e-9 * (t_ns - self.t_ns) * (self.v_W_mps + v_W_mps)
        return float(R_WH[:, 0] @ way_m), float(way_m[2])


def _nearness_H(ground: GroundPlane, too_long: float) -> FloatArray | None:
    """Return n (3,) in H: a ray r meets the ground at the depth 1 / (r · n), as a camera sees it whose distances are
    `too_long` times as long as true ones."""
    if ground.status is not Status.VALID:
        return None
    slopes = math.tan(ground.slope_sagittal_rad), math.tan(ground.slope_frontal_rad)
    return np.array([*slopes, -1.0]) / (too_long * ground.height_m)


def _obstacle(obstacle: Obstacle, too_long: float) -> TerrainObstacle:
    return TerrainObstacle(
        distance_m=obstacle.distance_m / too_long,
        left_m=obstacle.left_m / too_long,
        height_m=obstacle.height_m / too_long,
    )


_PATH_LASTS_NS = 300_000_000
_HIGHEST_BUMPS = 10.0
"""In units of how much the ground varies across the path: what is higher bounds the foothold's surface. A kerb that is
taken for a bump is worse than a bump for a kerb, so this is less than what the kind asks."""
_LOWEST_M, _HIGHEST_M = 0.5, 1.6
_FOLLOWS = 0.3
