"""How the IMU usually hangs on its wearer: what is left to go by when its samples were missing."""

import math
from dataclasses import dataclass

from messages import Vec3
from perception import vec3


@dataclass(frozen=True, kw_only=True)
class UsualMountingSettings:
    """The mean vertical is taken over about `average_s`, once it has been observed for `least_observed_s`.

    The tilt after `gap_s` of absence is the mean within √(`tilt_rad`² + scatter² + `wander_rad_rts`² · gap), 1 σ on
    each horizontal axis: `tilt_rad` for what the mean may be off, wander for a wearer who bends or sits down meanwhile.
    """

    average_s: float = 3.0
    least_observed_s: float = 1.0
    tilt_rad: float = math.radians(4.0)
    wander_rad_rts: float = math.radians(2.5)


@dataclass
class UsualMounting:
    """The vertical in B on average, of any length, and its mean square deviation from it on one axis, rad²."""

    mean_up_B: Vec3 = vec3.ZERO
    scatter_var: float = 0.0
    observed_s: float = 0.0

    def update(self, settings: UsualMountingSettings, up_B: Vec3, dt_s: float) -> None:
        """Take the vertical in B, `dt_s` after the one before it."""
        self.observed_s = min(self.observed_s + dt_s, settings.average_s)
        gain = dt_s / self.observed_s
        deviation = vec3.minus(up_B, self.mean_up_B) if self.observed_s > dt_s else vec3.ZERO
        self.mean_up_B = vec3.plus_scaled(up_B, deviation, gain - 1.0)
        self.scatter_var += gain * (0.5 * vec3.square(deviation) - self.scatter_var)

    def tilt_rad(self, settings: UsualMountingSettings, gap_s: float) -> float:
        """Return how well the mean tells the tilt `gap_s` later, 1 σ on each axis; infinite where it is not known."""
        if self.observed_s < settings.least_observed_s:
            return math.inf
        return math.sqrt(settings.tilt_rad**2 + self.scatter_var + settings.wander_rad_rts**2 * gap_s)
