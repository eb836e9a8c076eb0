"""Two simple estimators of the ground ahead, for comparison: a column of medians, and the service's one plane."""

import math
from collections.abc import Iterator

import numpy as np

from daemon.pipeline import Pipeline
from lab.evaluation.terrain_said import Edge, Foothold, Terrain
from messages import Calibration, GroundPlane, ImuSample, Input, Status, StereoFrame
from messages.arrays import FloatArray
from perception import so3
from perception.attitude.track import AttitudeTrack
from perception.depth.disparity import OutOfRangeError
from perception.depth.stereo_camera import StereoCamera
from perception.ground.foothold import FootholdSettings
from perception.heading import heading
from perception.motion.watch import MotionWatch

_FROM_M, _TO_M, _BIN_M = 0.3, 2.5, 0.02
_HALF_WIDTH_M = 0.15
_BELOW_M = (0.3, 1.6)  # the camera, where ground is looked for
_LEAST_POINTS = 6
_JUMP_M = 0.04
_BINS_BESIDE = 3
_FARTHEST_BIN_M = 0.6  # across ground that is not seen
_RAMP_RAD = math.radians(2.0)
_ROUGH_M = 0.012
_FLIGHT_M = 0.5
_FOOT_M, _FOOT_HALF_M = 0.7, 0.1
_EDGE_SD_M, _HEIGHT_SD_M, _SLOPE_SD_RAD = 0.02, 0.01, math.radians(2.0)


class ColumnMedians:
    """The median height over each 2 cm of the path, frame by frame, from disparities and the service's attitude.

    An edge is where the medians of three places before and three behind differ by 4 cm or more. Nothing is remembered,
    and uncertainties are constants.
    """

    def __init__(self, calibration: Calibration) -> None:
        self._track, self._watch = AttitudeTrack(calibration), MotionWatch(calibration)
        self._camera = StereoCamera(calibration.stereo)
        self._R_BC = np.array(calibration.X_BL.R) @ self._camera.R_EC

    def step(self, message: Input) -> Iterator[Terrain]:
        """Take one input and yield what is seen in a frame whose attitude is known."""
        if isinstance(message, ImuSample):
            self._watch.add_sample(message)
            self._track.add_sample(message)
        elif isinstance(message, StereoFrame):
            motion = self._watch.add_frame(message, self._track.foretold)
            if motion is not None and self._watch.step_is_sound:
                self._track.add_camera_step(motion)
            said = self._said(message)
            self._watch.finish_frame()
            if said is not None:
                yield said

    def _said(self, frame: StereoFrame) -> Terrain | None:
        placed = self._track.at(frame.header.t_exposure_ns)
        if placed is None:
            return None
        R_WC = so3.matrix_from_quaternion(placed.q_WB) @ self._R_BC
        R_WH = heading(R_WC)
        points_H = None if R_WH is None else self._path(frame, R_WH.T @ R_WC, np.array(placed.w_WB_B))
        if points_H is None:
            return None
        d, z = medians(points_H[:, 0], points_H[:, 2])
        edges = jumps(d, z)
        foot = z[np.abs(d - _FOOT_M) <= _FOOT_HALF_M]
        foothold = None
        if len(foot):
            foothold = Foothold(
                ahead_m=_FOOT_M,
                left_m=0.0,
                height_m=-float(np.median(foot)),
                height_sd_m=_HEIGHT_SD_M,
                slope_sagittal_rad=0.0,
                slope_sagittal_sd_rad=_SLOPE_SD_RAD,
                slope_frontal_rad=0.0,
                slope_frontal_sd_rad=_SLOPE_SD_RAD,
                time_to_contact_s=math.nan,
            )
        return Terrain(frame.header.t_exposure_ns, kind_of(d, z, edges), edges, foothold)

    def _path(self, frame: StereoFrame, R_HC: FloatArray, w_B_radps: FloatArray) -> FloatArray | None:
        """Return the points (n, 3) in H that are seen along the path."""
        x, y, z = np.meshgrid((_FROM_M, _TO_M), (-_HALF_WIDTH_M, _HALF_WIDTH_M), -np.array(_BELOW_M))
        corners_C = np.column_stack((x.ravel(), y.ravel(), z.ravel())) @ R_HC
        middle_C = np.array([[0.5 * (_FROM_M + _TO_M), 0.0, -np.mean(_BELOW_M)]]) @ R_HC
        corners_C = np.vstack((corners_C[corners_C[:, 2] > _LEAST_DEPTH_M], middle_C))
        try:
            patch = self._camera.find_disparities(frame.images, corners_C)
        except OutOfRangeError:
            return None
        if patch is None:
            return None
        skew = so3.skew(self._R_BC.T @ w_B_radps)
        rays_H = patch.rays_C @ R_HC.T + patch.row_time_s[..., None] * (patch.rays_C @ (R_HC @ skew).T)
        points_H = rays_H * (self._camera.f_px * self._camera.baseline_m / patch.disparity_px)[..., None]
        with np.errstate(invalid="ignore"):
            on_path = np.abs(points_H[..., 1]) < _HALF_WIDTH_M
        found: FloatArray = points_H[on_path]
        return found


class PublishedPlane:
    """The whole service's one plane a frame, taken for the ground ahead: no edges, and a ramp where it is inclined."""

    def __init__(self, calibration: Calibration) -> None:
        self._settings = FootholdSettings()
        self._pipeline = Pipeline(calibration, self._settings)

    def step(self, message: Input) -> Iterator[Terrain]:
        """Take one input and yield what the service says of the ground."""
        for ground in self._pipeline.step(message):
            if isinstance(ground, GroundPlane) and ground.status is Status.VALID:
                yield self._said(ground)

    def _said(self, ground: GroundPlane) -> Terrain:
        ahead_m, slope = ground.ahead_m, ground.slope_sagittal_rad
        per_slope = -ahead_m * (1.0 + math.tan(slope) ** 2)  # of the height below the camera at the foothold
        var_s, _, cov_sh, var_f, _, var_h = ground.covariance
        height_var = per_slope**2 * var_s + 2.0 * per_slope * cov_sh + var_h
        kind = "level" if abs(slope) < _RAMP_RAD else "ramp_up" if slope > 0 else "ramp_down"
        foothold = Foothold(
            ahead_m=ahead_m,
            left_m=0.0,
            height_m=ground.height_m - math.tan(slope) * ahead_m,
            height_sd_m=math.sqrt(max(height_var, 0.0)),
            slope_sagittal_rad=slope,
            slope_sagittal_sd_rad=math.sqrt(var_s),
            slope_frontal_rad=ground.slope_frontal_rad,
            slope_frontal_sd_rad=math.sqrt(var_f),
            time_to_contact_s=math.nan,
        )
        return Terrain(ground.t_exposure_ns, kind, (), foothold)


def medians(x_m: FloatArray, z_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the middle of each 2 cm of path that holds points enough, and their median height."""
    known = np.isfinite(z_m) & (x_m >= _FROM_M) & (x_m < _TO_M)
    places = np.floor((x_m[known] - _FROM_M) / _BIN_M).astype(int)
    order = np.argsort(places, kind="stable")
    found, first, counts = np.unique(places[order], return_index=True, return_counts=True)
    groups = np.split(z_m[known][order], first[1:])
    enough = counts >= _LEAST_POINTS
    heights = np.array([np.median(group) for group, many in zip(groups, enough, strict=True) if many])
    return _FROM_M + _BIN_M * (found[enough] + 0.5), heights


def jumps(d: FloatArray, z: FloatArray) -> tuple[Edge, ...]:
    """Return the edges of medians `z` (n,) at `d` (n,): the largest jump of each run of places that differ."""
    differences = np.zeros(max(0, len(d) - 1))
    for k in range(len(differences)):
        before, behind = slice(max(0, k - _BINS_BESIDE + 1), k + 1), slice(k + 1, k + 1 + _BINS_BESIDE)
        if d[k + 1] - d[k] <= _FARTHEST_BIN_M:
            differences[k] = np.median(z[behind]) - np.median(z[before])
    signs = np.where(np.abs(differences) >= _JUMP_M, np.sign(differences), 0.0)
    borders = np.flatnonzero(np.diff(signs)) + 1
    edges = []
    for run in np.split(np.arange(len(signs)), borders):
        if not len(run) or not signs[run[0]]:
            continue
        steepest = run[np.argmax(np.abs(z[run + 1] - z[run]))]
        rise_m = float(differences[run[np.argmax(np.abs(differences[run]))]])
        at_m = 0.5 * (d[steepest] + d[steepest + 1]) if rise_m > 0 else d[steepest] + 0.5 * _BIN_M
        edges.append(Edge(float(at_m), _EDGE_SD_M, rise_m, _EDGE_SD_M))
    return tuple(edges)


def kind_of(d: FloatArray, z: FloatArray, edges: tuple[Edge, ...]) -> str:
    """Return the kind of the path from 0.3 to 1.0 m."""
    for edge in edges:
        if 0.3 <= edge.distance_m <= 1.0:
            flight = any(
                0 < abs(other.distance_m - edge.distance_m) < _FLIGHT_M and other.rise_m * edge.rise_m > 0
                for other in edges
            )
            return f"{'stairs' if flight else 'step'}_{'up' if edge.rise_m > 0 else 'down'}"
    near = d <= 1.0
    if np.count_nonzero(near) < 2 * _BINS_BESIDE:
        return "unknown"
    slope, at_zero = np.polyfit(d[near], z[near], 1)
    if float(np.std(z[near] - slope * d[near] - at_zero)) > _ROUGH_M:
        return "rough"
    angle = math.atan(slope)
    return "level" if abs(angle) < _RAMP_RAD else "ramp_up" if angle > 0 else "ramp_down"


_LEAST_DEPTH_M = 0.1
