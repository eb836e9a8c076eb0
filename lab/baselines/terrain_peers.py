"""Two simple estimators of the ground ahead, for comparison: a column of medians, and the service's one plane."""

import math
from collections.abc import Iterator

import numpy as np

from daemon.pipeline import Pipeline
from lab.baselines.path_seen import FROM_M, TO_M, PathView
from lab.evaluation.terrain_said import Edge, Foothold, Terrain
from messages import Calibration, GroundPlane, Input, Status
from messages.arrays import FloatArray
from perception.ground.foothold import FootholdSettings

BIN_M = 0.02
_LEAST_POINTS = 6
_JUMP_M = 0.04
_BINS_BESIDE = 3
_FARTHEST_BIN_M = 0.6  # across ground that is not seen
_RAMP_RAD = math.radians(2.0)
_ROUGH_M = 0.012
_FLIGHT_M = 0.5
FOOT_M, FOOT_HALF_M = 0.7, 0.1
_EDGE_SD_M, _HEIGHT_SD_M, _SLOPE_SD_RAD = 0.02, 0.01, math.radians(2.0)


class ColumnMedians:
    """The median height over each 2 cm of the path, frame by frame, from disparities and the service's attitude.

    An edge is where the medians of three places before and three behind differ by 4 cm or more. Nothing is remembered,
    and uncertainties are constants.
    """

    def __init__(self, calibration: Calibration) -> None:
        self._view = PathView(calibration)

    def step(self, message: Input) -> Iterator[Terrain]:
        """Take one input and yield what is seen in a frame whose attitude is known."""
        seen = self._view.step(message)
        if seen is None:
            return
        d, z = medians(seen.points_H_m[:, 0], seen.points_H_m[:, 2])
        edges = jumps(d, z)
        foot = z[np.abs(d - FOOT_M) <= FOOT_HALF_M]
        foothold = level_foothold(-float(np.median(foot)), _HEIGHT_SD_M) if len(foot) else None
        yield Terrain(seen.t_exposure_ns, kind_of(d, z, edges), edges, foothold)


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


def level_foothold(height_m: float, height_sd_m: float) -> Foothold:
    """Return the ground FOOT_M ahead, taken for level."""
    return Foothold(
        ahead_m=FOOT_M,
        left_m=0.0,
        height_m=height_m,
        height_sd_m=height_sd_m,
        slope_sagittal_rad=0.0,
        slope_sagittal_sd_rad=_SLOPE_SD_RAD,
        slope_frontal_rad=0.0,
        slope_frontal_sd_rad=_SLOPE_SD_RAD,
        time_to_contact_s=math.nan,
    )


def medians(x_m: FloatArray, z_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the middle of each 2 cm of path that holds points enough, and their median height."""
    known = np.isfinite(z_m) & (x_m >= FROM_M) & (x_m < TO_M)
    places = np.floor((x_m[known] - FROM_M) / BIN_M).astype(int)
    order = np.argsort(places, kind="stable")
    found, first, counts = np.unique(places[order], return_index=True, return_counts=True)
    groups = np.split(z_m[known][order], first[1:])
    enough = counts >= _LEAST_POINTS
    heights = np.array([np.median(group) for group, many in zip(groups, enough, strict=True) if many])
    return FROM_M + BIN_M * (found[enough] + 0.5), heights


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
        at_m = 0.5 * (d[steepest] + d[steepest + 1]) if rise_m > 0 else d[steepest] + 0.5 * BIN_M
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
