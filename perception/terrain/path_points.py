"""What a frame shows of the ground along the path: points in H, thinned so that each stands for about as much
ground."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from messages import Image
from messages.arrays import BoolArray, FloatArray
from perception.depth.disparity import DisparityCamera, DisparityPatch, View


@dataclass(frozen=True)
class PathSettings:
    """The path is `half_width_m` wide to either side and reaches from `nearest_m` to `farthest_m` along x of H.

    Ground is looked for down to `below_m` under the ground that the wearer stands on, and up to `above_m` over it,
    far away, half as high near the feet. What a polished floor mirrors lies deeper: down to `mirrored_m` it is found,
    and left out, since where it is not looked for something else is like it by chance.
    """

    nearest_m: float = 0.15
    farthest_m: float = 2.75
    half_width_m: float = 0.25
    above_m: float = 0.60
    below_m: float = 1.50
    mirrored_m: float = 4.50


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
    R_HC: FloatArray,
    w_HC_C_radps: FloatArray,
    height_rate_mps: float,
    height_m: float,
    path: PathSettings,
    nearness_H: FloatArray | None = None,
) -> PathPoints:
    """Return the points on the path that a frame's raw `images` show.

    `height_m` is that of the camera over the ground that the wearer stands on; `R_HC`, `w_HC_C_radps` and
    `height_rate_mps` are as for `perception.ground.meter`. The picture is matched in bands of rows: each sees other
    distances. What looks as much like the ground is that: the ray r meets it at the depth 1 / (r · `nearness_H`).
    """
    found = []
    for view, strides in _views(camera, R_HC, height_m, path):
        patch = camera.find_in_view(images, view)
        if patch is None:
            continue
        patch = patch.every(*strides)
        if nearness_H is not None:
            theta_C = camera.f_px * camera.baseline_m * R_HC.T @ nearness_H
            patch = camera.laid_on_plane(images, patch, theta_C)
        found.append(_points(camera, patch, R_HC, w_HC_C_radps, height_rate_mps / height_m, strides))
    points = PathPoints(*(np.concatenate(each) for each in zip(*found, strict=True))) if found else _NO_POINTS
    beside = np.abs(points.y_m) > path.half_width_m
    beyond = (points.x_m < path.nearest_m) | (points.x_m > path.farthest_m)
    return points.where(~beside & ~beyond & (points.z_m > -(height_m + path.below_m)))


def _views(
    camera: DisparityCamera, R_HC: FloatArray, height_m: float, path: PathSettings
) -> list[tuple[View, tuple[int, int]]]:
    """Return what of the picture shows the path, band by band from top to bottom, and of how many rows and columns
    one is taken."""
    top, bottom = camera.tangents_down
    edges = np.linspace(top, bottom, len(_STRIDES) + 1)
    views = []
    for band, strides, share in zip(itertools.pairwise(edges), _STRIDES, (1.0, 0.75, 0.5), strict=True):
        highest_m, lowest_m = max(height_m - share * path.above_m, _LEAST_HEIGHT_M), height_m + path.mirrored_m
        falls = -(np.array([[0.0, band[0], 1.0], [0.0, band[1], 1.0]]) @ R_HC.T)[:, 2]  # of a ray that is 1 deep
        if falls[1] <= _LEAST_FALL:
            continue
        deepest_m = lowest_m / max(falls[0], _LEAST_FALL)
        nearest_m = highest_m / falls[1]
        reach = path.half_width_m * falls[1] / max(height_m - _USUAL_RISE_M, _LEAST_HEIGHT_M)
        views.append((View((-reach, reach), band, (nearest_m, min(deepest_m, _DEEPEST_M))), strides))
    return views


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
        known = np.isfinite(depth_m) & (rays_H[..., 2] < -_LEAST_FALL)
        known[:-1] &= ~(np.diff(depth_m, axis=0) < -_ALONG_RAY * strides[0] / camera.f_px * depth_m[1:])
    rays_H, depth_m = rays_H[known], depth_m[known]
    x_m, y_m, z_m = (rays_H * depth_m[:, None]).T
    # a level surface |z| below shows f² |z| / Z³ pixels a square metre, f |z| / Z² a metre along x
    along_m = strides[0] * depth_m**2 / (camera.f_px * np.abs(z_m))
    area_m2 = along_m * strides[1] * depth_m / camera.f_px
    return x_m, y_m, z_m, NOISE_PX / fB_px_m * depth_m * np.abs(z_m), area_m2, along_m


_STRIDES = ((1, 4), (2, 4), (3, 5))
"""Rows and columns of which one is taken, in the top, middle and bottom band."""
_ALONG_RAY = 8.0
"""Between two rows a surface recedes by so many times the distance of their rays where it is seen at 7°: what recedes
more is no surface but what the matcher puts between a lip and what it hides."""
NOISE_PX = 0.1
"""Of a disparity, one σ, where the texture is good."""
_LEAST_FALL = 0.15
_LEAST_HEIGHT_M = 0.35
_USUAL_RISE_M = 0.25  # over ground that is higher still, the path is narrower
_DEEPEST_M = 12.0
_NO_POINTS = PathPoints(*(np.empty(0) for _ in range(6)))
