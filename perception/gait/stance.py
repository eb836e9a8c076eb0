"""The ground below the feet: what was ahead where a foot landed, kept while the foot stands on it.

Heights are told above a level that the camera's own way up and down is counted from; a second's count is off by a few
millimetres.
"""

import math
from dataclasses import dataclass, field

from messages import Side
from perception.gait.landing import Landing


@dataclass(frozen=True)
class GroundHeight:
    """The height of the ground at one place, m, with one σ."""

    m: float
    sd_m: float


@dataclass
class StanceGround:
    """Keeps the ground of the next landing of each foot, and that under the foot which landed last."""

    under: GroundHeight | None = None
    _next: dict[Side, tuple[float, GroundHeight | None]] = field(default_factory=dict)

    def add(self, side: Side, landing: Landing | None, ground: GroundHeight | None) -> None:
        """Take where a foot lands next and the `ground` there, as one frame tells it.

        The foot has landed where its next landing is suddenly later. What a frame does not tell of the ground remains
        as the frames before did.
        """
        before_s, known = self._next.get(side, (math.inf, None))
        if landing is None:
            self._next.pop(side, None)
            self.under = None
            return
        if landing.time_s > before_s + _LATER_S:
            self.under, known = known, None
        self._next[side] = (landing.time_s, ground or known)

    def rise_to(self, ground: GroundHeight | None) -> tuple[float, float]:
        """Return how much higher `ground` is than that below the foot that stands, with one σ; NaN where unknown."""
        if ground is None or self.under is None:
            return math.nan, math.nan
        return ground.m - self.under.m, math.hypot(ground.sd_m, self.under.sd_m, _COUNTED_SD_M)


_LATER_S = 0.35
_COUNTED_SD_M = 0.004
"""Of the camera's way up and down since, 1 σ: 4 mm/s of a velocity for a second."""
