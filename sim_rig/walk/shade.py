"""Hard shadows, and strips painted on the ground: what lies between two parallel planes is darker or brighter."""

from dataclasses import dataclass, replace

import numpy as np

from messages import Vec3
from messages.arrays import FloatArray


@dataclass(frozen=True)
class Shade:
    """Of what has `from_m` ≤ n · p < `to_m`, with n = `normal_W` and p in W, `factor` of the light is left.

    The border of a shadow is a plane through the sun; so it moves sideways where it climbs a riser.
    """

    normal_W: Vec3
    from_m: float
    to_m: float
    factor: float

    def ahead_by(self, x_m: float) -> "Shade":
        """Return the same shade `x_m` further on along x of W."""
        moved_m = self.normal_W[0] * x_m
        return replace(self, from_m=self.from_m + moved_m, to_m=self.to_m + moved_m)

    def light(self, p_W: FloatArray) -> FloatArray:
        """Return the share of light (...,) that is left at each point (..., 3)."""
        along_m = p_W @ np.array(self.normal_W)
        return np.where((along_m >= self.from_m) & (along_m < self.to_m), self.factor, 1.0)
