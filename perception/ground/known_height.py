"""The height of the ground under the wearer against the one that `gaiteyes calibrate wearer` has measured.

Only ground on which the wearer has walked counts: once the plane ahead has been followed until the feet are on it, and
while the wearer walks, or stands as high as in walking. Who sits, bends or stands before a step tells nothing then.

What differs, Δ, has two explanations: the wearer, whose shoes and posture differ by 30 mm (1 σ_w), and the camera. Up
to 2 σ_w, and 2 σ of the known height itself, nothing here tells which of them it is: all of Δ² is added to the variance
of the ground's height. Beyond, no shoe and no posture is an explanation: that is a contradiction, to be told.
"""

import math
from dataclasses import dataclass

from messages import WearerHeight
from perception.ground.region import FootholdRegion


@dataclass(frozen=True)
class HeightDifference:
    """By how much the ground lies lower under the camera than the wearer's height says, averaged over strides.

    `off_m` is NaN until that is known. `contradicts` says that neither shoes nor posture explain it.
    """

    off_m: float = math.nan
    contradicts: bool = False

    @property
    def variance_m2(self) -> float:
        """Return what it adds to the variance of the height."""
        return 0.0 if math.isnan(self.off_m) else self.off_m**2


UNKNOWN = HeightDifference()


class KnownHeight:
    """Averages the difference over the strides, with the steps' rise and fall of the hip."""

    wearer_std_m = 0.03
    walking_mps = 0.4
    average_s = 5.0
    settled_s = 3.0
    longest_step_s = 0.2
    cleared_m = 0.01  # nearer than the bound by this a contradiction ends

    underfoot_m = 0.3  # beyond the region's farther end: the hip is ahead of the foot behind

    def __init__(self, wearer: WearerHeight | None) -> None:
        """Without a `wearer` nothing is ever known."""
        self._wearer = wearer
        self._t_ns: int | None = None
        self._walked_m = 0.0
        self._seen_s = 0.0
        self._mean_m = 0.0
        self._contradicts = False

    def begin_anew(self) -> None:
        """Wait until the feet are on the plane ahead: it is another one than before."""
        self._walked_m, self._t_ns = 0.0, None

    def add(self, t_ns: int, height_m: float, speed_mps: float, region: FootholdRegion) -> None:
        """Take the height of one frame, measured in `region`, of a wearer who goes at `speed_mps`."""
        if self._wearer is None:
            return
        step_s = 0.0 if self._t_ns is None else min(1e-9 * (t_ns - self._t_ns), self.longest_step_s)
        self._t_ns = t_ns
        self._walked_m += speed_mps * step_s
        off_m = height_m - self._wearer.camera_height_m
        underfoot = self._walked_m >= region.ahead_m + region.half_length_m + self.underfoot_m
        if step_s <= 0.0 or not underfoot or not self._is_upright(off_m, speed_mps):
            return
        self._seen_s += step_s
        self._mean_m += (off_m - self._mean_m) * step_s / min(self._seen_s, self.average_s)
        if self._seen_s >= self.settled_s:
            bound_m = 2.0 * (self.wearer_std_m + self._wearer.std_m) - (self.cleared_m if self._contradicts else 0.0)
            self._contradicts = abs(self._mean_m) > bound_m

    @property
    def difference(self) -> HeightDifference:
        """Return what is known of it by now; it remains while nothing new is learnt."""
        if self._wearer is None or self._seen_s < self.settled_s:
            return UNKNOWN
        return HeightDifference(self._mean_m, self._contradicts)

    def _is_upright(self, off_m: float, speed_mps: float) -> bool:
        if speed_mps >= self.walking_mps:
            return True
        return self._seen_s >= self.settled_s and abs(off_m - self._mean_m) < 2.0 * self.wearer_std_m
