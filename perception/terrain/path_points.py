"""What a frame shows of the ground along the path: points in H, thinned so that each stands for about as much
ground."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from messages import Image
from messages.arrays import BoolArray, FloatArray
from perception.depth.disparity import DisparityCamera, DisparityPatch
from perception.terrain.path_matching import LEAST_FALL, MatchedBand, PathSettings


@dataclass(frozen=True)
class PathPoints:
    """Points (n,) on the path in H.

    `deviation_m` is how far a matching noise of NOISE_PX moves z, one σ; `area_m2` the part of a level surface at that
    depth that each point stands for, `along_m` its length along x.
    """

    x_m: FloatArray
    y_m: FloatArray
    z_m: FloatArray
    deviation_m: FloatArray
    area_m2: FloatArray
    along_m: FloatArray

    def along(self, yaw_rad: float) -> FloatArray:
        """Return u = x + y tan(yaw) (n,): where each point lies along the path before an edge of that yaw."""
        along: FloatArray = self.x_m + self.y_m * np.tan(yaw_rad)
        return along

    def where(self, chosen: BoolArray) -> "PathPoints":
        """Return some of the points."""
        arrays = (self.x_m, self.y_m, self.z_m, self.deviation_m, self.area_m2, self.along_m)
        return PathPoints(*(each[chosen] for each in arrays))


def find_points(
    camera: DisparityCamera,
    images: Sequence[Image],
    matched: Sequence[MatchedBand],
    R_HC: FloatArray,
    w_HC_C_radps: FloatArray,
    height_rate_mps: float,
    height_m: float,
    path: PathSettings,
    nearness_H: FloatArray | None = None,
) -> PathPoints:
    """Return the points on the path, of what was `matched` in a frame's raw `images`.

    `height_m` is that of the camera over the ground that the wearer stands on; `R_HC`, `w_HC_C_radps` and
    `height_rate_mps` are as for `perception.ground.meter`. What looks as much like the ground is that: the ray r meets
    it at the depth 1 / (r · `nearness_H`).
    """
    theta_C = None if nearness_H is None else camera.f_px * camera.baseline_m * R_HC.T @ nearness_H
    found = []
    for patch, strides in matched:
        laid = patch if theta_C is None else camera.laid_on_plane(images, patch, theta_C)
        found.append(_points(camera, laid, R_HC, w_HC_C_radps, height_rate_mps / height_m, strides))
    points = PathPoints(*(np.concatenate(each) for each in zip(*found, strict=True))) if found else _NO_POINTS
    beside = np.abs(points.y_m) > path.half_width_m
    beyond = (points.x_m < path.nearest_m) | (points.x_m > path.farthest_m)
    return points.where(~beside & ~beyond & (points.z_m > -(height_m + path.below_m)))


def _points(
    camera: DisparityCamera,
    patch: DisparityPatch,
    R_HC: FloatArray,
    w_HC_C_radps: FloatArray,
    rise_rate: float,
    strides: tuple[int, int],
) -> tuple[FloatArray, ...]:
    """Return x, y, z, deviation and area of the pixels of `patch` that matched, (n,) each."""
    fB_px_m = camera.f_px * camera.baseline_m
    rays_H = patch.rays_H(R_HC, w_HC_C_radps, rise_rate)
    depth_m = fB_px_m / patch.disparity_px
    with np.errstate(invalid="ignore"):
        known = np.isfinite(depth_m) & (rays_H[..., 2] < -LEAST_FALL)
        known[:-1] &= ~(np.diff(depth_m, axis=0) < -_ALONG_RAY * strides[0] / camera.f_px * depth_m[1:])
    rays_H, depth_m = rays_H[known], depth_m[known]
    x_m, y_m, z_m = (rays_H * depth_m[:, None]).T
    # a level surface |z| below shows f² |z| / Z³ pixels a square metre, f |z| / Z² a metre along x
    along_m = strides[0] * depth_m**2 / (camera.f_px * np.abs(z_m))
    area_m2 = along_m * strides[1] * depth_m / camera.f_px
    return x_m, y_m, z_m, NOISE_PX / fB_px_m * depth_m * np.abs(z_m), area_m2, along_m


_ALONG_RAY = 8.0
"""Between two rows a surface recedes by so many times the distance of their rays where it is seen at 7°: what recedes
more is no surface but what the matcher puts between a lip and what it hides."""
NOISE_PX = 0.1
"""Of a disparity, one σ, where the texture is good."""
_NO_POINTS = PathPoints(*(np.empty(0) for _ in range(6)))
