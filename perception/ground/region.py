"""The rectangle of ground that one frame measures: the fixed one of the settings, or one about the next foothold."""

import math
from dataclasses import dataclass, replace

import numpy as np

from messages.arrays import BoolArray, FloatArray
from perception.ground.plane import Plane


@dataclass(frozen=True)
class FootholdRegion:
    """Ground in H, centred `ahead_m` along x and `left_m` along y, and how far up or down it may lie (see
    `foothold.FootholdSettings`).

    Its near and far sides are parallel to edges whose normal is turned by `yaw_rad` from x (> 0 to the left). It is
    `bounded` where such an edge is near.
    """

    ahead_m: float
    left_m: float
    half_length_m: float
    half_width_m: float
    nominal_height_m: float
    height_margin_m: float
    step_m: float
    yaw_rad: float = 0.0
    bounded: bool = False

    def narrowed(self) -> "FootholdRegion":
        """Return the region with half its width, for when there is no time for all of it."""
        return replace(self, half_width_m=max(0.1, 0.5 * self.half_width_m))

    def along_m(self, points_H: FloatArray) -> FloatArray:
        """Return how far points (..., 3) in H lie beyond the region's middle, towards its far side (...)."""
        across = points_H[..., 1] - self.left_m
        along: FloatArray = points_H[..., 0] - self.ahead_m + across * math.tan(self.yaw_rad)
        return along

    def places(self, along_across_m: FloatArray) -> FloatArray:
        """Return x and y of H (N, 2) of places (N, 2) given along and across the region from its middle."""
        along, across = along_across_m.T
        return np.stack((self.ahead_m + along - across * math.tan(self.yaw_rad), self.left_m + across), axis=-1)

    def footprint(self, plane: Plane, margin_m: float) -> FloatArray:
        """Return (8, 3): the region's corners in H on `plane`, raised and lowered by `margin_m`."""
        across = self.half_width_m * np.array([-1.0, 1.0, -1.0, 1.0])
        x = self.ahead_m + self.half_length_m * np.array([-1.0, -1.0, 1.0, 1.0]) - across * math.tan(self.yaw_rad)
        y = self.left_m + across
        z = plane.gradient[0] * x + plane.gradient[1] * y - plane.height_m
        return np.vstack((np.stack((x, y, z - margin_m), axis=-1), np.stack((x, y, z + margin_m), axis=-1)))

    def contains(self, points_H: FloatArray) -> BoolArray:
        """Return, for points (..., 3) in H, which lie over the region."""
        return (np.abs(self.along_m(points_H)) < self.half_length_m) & (
            np.abs(points_H[..., 1] - self.left_m) < self.half_width_m
        )

    def weights(self, points_H: FloatArray) -> FloatArray:
        """Return a weight in (0, 1] for points (..., 3) in H: the middle of the region counts most.

        Where an edge lies in the region and is not known yet, this makes the surface under the foot win.
        """
        along = self.along_m(points_H) / self.half_length_m
        across = (points_H[..., 1] - self.left_m) / self.half_width_m
        weight: FloatArray = np.exp(-0.5 * (1.5 * along) ** 2 - 0.5 * across**2)
        return weight
