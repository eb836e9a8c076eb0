"""Whether the ground that is measured now is another surface than the one before: the region moves over borders."""

import math
from dataclasses import replace

import numpy as np

from messages.arrays import FloatArray
from perception.ground.plane import Plane
from perception.ground.region import FootholdRegion
from perception.ground.sole import about
from perception.terrain.path_ahead import PathAhead
from perception.terrain.surfaces import Surface


class SurfaceChange:
    """Remembers where the ground was measured last, while the camera moves on."""

    def __init__(self) -> None:
        self._t_ns: int | None = None
        self._measured_m = np.zeros(2)

    def move(self, t_ns: int, v_H_mps: FloatArray) -> None:
        """Come to a frame at `t_ns`; the camera moves by `v_H_mps` (2,) over the ground."""
        if self._t_ns is not None:
            self._measured_m = self._measured_m - 1e-9 * (t_ns - self._t_ns) * v_H_mps
            self._t_ns = t_ns

    def has_come(self, t_ns: int, region: FootholdRegion, path: PathAhead) -> bool:
        """Return whether `region`, which is measured at `t_ns`, lies beyond a border of the path from where the ground
        was measured before."""
        before_m, now_m = self._measured_m, np.array([region.ahead_m, region.left_m])
        first = self._t_ns is None
        self._t_ns, self._measured_m = t_ns, now_m
        if first:
            return False
        from_m, to_m = sorted((float(before_m[0]), region.ahead_m))
        return any(from_m < at_m <= to_m for at_m in path.borders_m(region.left_m))


def plane_under(region: FootholdRegion, path: PathAhead) -> tuple[Plane, FloatArray] | None:
    """Return the plane that the path shows in the middle of a region, and the covariance (3, 3) of its (a, b, h).

    It is that of one profile along the path, which tells nothing of the slope across. On rough ground no plane tells
    how it lies under a foot.
    """
    if path.rough:
        return None
    along = math.tan(path.yaw_rad)
    u_m = region.ahead_m + region.left_m * along
    surface = path.known_at(u_m)
    if surface is None:
        return None
    at_region = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [region.ahead_m, region.left_m, 1.0]])
    deviations = np.array([_SLOPE_SD + surface.slope_sd, _SLOPE_SD, math.hypot(_HEIGHT_SD_M, surface.sd_at(u_m))])
    cov: FloatArray = at_region @ np.diag(deviations**2) @ at_region.T
    return plane_of(surface, path.yaw_rad), cov


def plane_of(surface: Surface, yaw_rad: float) -> Plane:
    """Return the plane in H of a surface of a path along u = x + y tan(`yaw_rad`)."""
    gradient = (surface.slope, surface.slope * math.tan(yaw_rad))
    return Plane(gradient, surface.slope * surface.middle_m - surface.height_m)


def region_on(surface: Surface, yaw_rad: float, like: FootholdRegion) -> FootholdRegion:
    """Return the region on a surface of the path straight ahead, as wide as another and no longer than it."""
    half_length_m = min(0.5 * (surface.to_m - surface.from_m), like.half_length_m)
    return replace(like, ahead_m=surface.middle_m, left_m=0.0, half_length_m=half_length_m, yaw_rad=yaw_rad)


def is_other_surface(plane: Plane, region: FootholdRegion, path: PathAhead) -> bool:
    """Return whether the path shows another surface than `plane` between the borders of a region."""
    under = plane_under(region, path) if region.bounded else None
    return under is not None and abs(_apart(plane, under[0], region)[1]) > region.step_m


def apart_cov(plane: Plane, cov: FloatArray, region: FootholdRegion, path: PathAhead) -> FloatArray:
    """Return the covariance (3, 3) of (a, b, h) by which a measured `plane`, of covariance `cov`, and the path's
    surface there are apart where they contradict each other: which of them is the ground is open then.

    What the slope along is off says as much of the one across, of which the path tells nothing.
    """
    under = plane_under(region, path)
    if under is None:
        return np.zeros((3, 3))
    apart = _apart(plane, under[0], region)
    to_place = _to_place(region)
    apart_var = to_place @ (cov + under[1]) @ to_place.T
    if apart @ np.linalg.solve(apart_var, apart) < _CONTRADICTS:
        return np.zeros((3, 3))
    cov_apart = about(region.ahead_m, region.left_m, apart[0] ** 2 * np.eye(2))
    cov_apart[2, 2] += apart[1] ** 2
    return cov_apart


def beside_bend_cov(region: FootholdRegion, path: PathAhead) -> FloatArray:
    """Return the covariance (3, 3) of (a, b, h) by which the planes to either side of a bend are apart that is so near
    to the middle of a region that either may be there; nothing tells there how the bend is turned."""
    bend = path.bend_near(region.ahead_m, region.left_m, _BESIDE_BEND_M)
    return about(region.ahead_m, region.left_m, (0.5 * bend) ** 2 * np.eye(2))


def _apart(plane: Plane, under: Plane, region: FootholdRegion) -> FloatArray:
    """Return by how much a plane slopes more ahead than the one `under` a region, and lies below it in the middle."""
    apart: FloatArray = _to_place(region) @ (plane.abh - under.abh)
    return apart


def _to_place(region: FootholdRegion) -> FloatArray:
    """Return the matrix (2, 3) that takes (a, b, h) to the slope ahead and the depth in the middle of a region."""
    return np.array([[1.0, 0.0, 0.0], [-region.ahead_m, -region.left_m, 1.0]])


_CONTRADICTS = 13.8  # χ² of two, of which 0.1 % exceed it
_BESIDE_BEND_M = 0.05
"""As far from where two lines of a profile meet the slope may change."""
_SLOPE_SD, _HEIGHT_SD_M = 0.03, 0.012
"""What a profile of the frame before may be off, beside what it states: matching is worse there than in the region."""
