"""Where the next foot will land: a rectangle of ground in H."""

from typing import Annotated

import msgspec
import numpy as np

from messages import Side
from messages.arrays import BoolArray, FloatArray
from perception.ground.plane import Plane


class FootholdSettings(msgspec.Struct, frozen=True, kw_only=True):
    """The rectangle of ground that is measured, and how far up or down it may lie; `side` is that of the prosthesis.

    The region is centred `ahead_m` along x of H and on the wearer's midline. While no plane is known the ground is
    looked for `nominal_height_m` below the camera, give or take `height_margin_m`, and in every second frame elsewhere
    (`first_search`); afterwards it may rise or fall by `step_m` from one frame to the next (a stair is 0.17 m, a high
    kerb 0.25 m).
    """

    side: Side = Side.RIGHT
    ahead_m: Annotated[float, msgspec.Meta(ge=0.2, le=4.0)] = 0.7
    half_length_m: Annotated[float, msgspec.Meta(ge=0.1, le=2.0)] = 0.3
    half_width_m: Annotated[float, msgspec.Meta(ge=0.1, le=2.0)] = 0.3
    nominal_height_m: Annotated[float, msgspec.Meta(ge=0.3, le=2.0)] = 0.95
    height_margin_m: Annotated[float, msgspec.Meta(ge=0.05, le=1.0)] = 0.35
    step_m: Annotated[float, msgspec.Meta(ge=0.05, le=0.5)] = 0.25

    def narrowed(self) -> "FootholdSettings":
        """Return the region with half its width, for when there is no time for all of it."""
        return msgspec.structs.replace(self, half_width_m=max(0.1, 0.5 * self.half_width_m))

    def footprint(self, plane: Plane, margin_m: float) -> FloatArray:
        """Return (8, 3): the region's corners in H on `plane`, raised and lowered by `margin_m`."""
        x = self.ahead_m + self.half_length_m * np.array([-1.0, -1.0, 1.0, 1.0])
        y = self.half_width_m * np.array([-1.0, 1.0, -1.0, 1.0])
        z = plane.gradient[0] * x + plane.gradient[1] * y - plane.height_m
        return np.vstack((np.stack((x, y, z - margin_m), axis=-1), np.stack((x, y, z + margin_m), axis=-1)))

    def contains(self, points_H: FloatArray) -> BoolArray:
        """Return, for points (..., 3) in H, which lie over the region."""
        return (np.abs(points_H[..., 0] - self.ahead_m) < self.half_length_m) & (
            np.abs(points_H[..., 1]) < self.half_width_m
        )

    def weights(self, points_H: FloatArray) -> FloatArray:
        """Return a weight in (0, 1] for points (..., 3) in H: the middle of the region counts most.

        On stairs and kerbs this makes the tread under the foot win over its neighbours.
        """
        along = (points_H[..., 0] - self.ahead_m) / self.half_length_m
        across = points_H[..., 1] / self.half_width_m
        weight: FloatArray = np.exp(-0.5 * (1.5 * along) ** 2 - 0.5 * across**2)
        return weight
