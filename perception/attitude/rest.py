"""Whether an IMU is at rest: on a table, or on a wearer who stands and sways.

The sensors' deviation from their own running mean decides, so that rest is known before any bias is.
"""

import math
from dataclasses import dataclass

from messages import Vec3
from perception import vec3


@dataclass(frozen=True, kw_only=True)
class RestSettings:
    """Rest is `time_s` without movement: without a smoothed sample farther than `deviation_*` from its mean.

    Samples are smoothed over `smoothing_s`, since motors shake a wearer who stands still. Their mean is taken over
    the time since the last movement, and over about `average_s` once that is longer.
    """

    time_s: float = 1.0
    average_s: float = 0.5
    smoothing_s: float = 0.1
    deviation_sf_mps2: float = 0.5
    deviation_w_radps: float = math.radians(2.0)


@dataclass
class Rest:
    """Specific force and angular rate, smoothed and on average since the last movement, `quiet_s` ago; and the smoothed
    rate's variance about its average, on one axis."""

    smooth_sf_B: Vec3 = vec3.ZERO
    smooth_w_B: Vec3 = vec3.ZERO
    mean_sf_B: Vec3 = vec3.ZERO
    mean_w_B: Vec3 = vec3.ZERO
    rate_var: float = 0.0
    quiet_s: float = 0.0
    samples: int = 0

    def update(self, settings: RestSettings, sf_B: Vec3, w_B: Vec3, dt_s: float) -> None:
        """Take one sample, `dt_s` after the one before it."""
        if self.samples == 0:
            self.smooth_sf_B, self.smooth_w_B = sf_B, w_B
            self._restart()
            return
        gain = dt_s / (dt_s + settings.smoothing_s)
        self.smooth_sf_B = vec3.between(self.smooth_sf_B, sf_B, gain)
        self.smooth_w_B = vec3.between(self.smooth_w_B, w_B, gain)
        if (
            math.dist(self.smooth_sf_B, self.mean_sf_B) > settings.deviation_sf_mps2
            or math.dist(self.smooth_w_B, self.mean_w_B) > settings.deviation_w_radps
        ):
            self._restart()
            return
        self.samples += 1
        self.quiet_s += dt_s
        scatter = vec3.square(vec3.minus(self.smooth_w_B, self.mean_w_B)) / 3.0
        gain = max(1.0 / self.samples, dt_s / (dt_s + settings.average_s))
        self.mean_sf_B = vec3.between(self.mean_sf_B, sf_B, gain)
        self.mean_w_B = vec3.between(self.mean_w_B, w_B, gain)
        self.rate_var += gain * (scatter - self.rate_var)

    def _restart(self) -> None:
        self.mean_sf_B, self.mean_w_B = self.smooth_sf_B, self.smooth_w_B
        self.rate_var, self.quiet_s, self.samples = 0.0, 0.0, 1
