"""Impedance over stance: five points, straight lines between them, and the limits that it is kept within."""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from messages.arrays import FloatArray
from messages.setpoint import STANCE_PERCENT

SHARES: Final = 0.01 * np.array(STANCE_PERCENT, dtype=np.float64)
"""The shares of stance (5,) at which a curve has its points."""

MOST_OFF_RAD: Final = 0.25
"""By so much the equilibrium may leave that of level ground."""
STIFFNESS_SHARES: Final = (0.5, 1.5)
"""Between these shares of that of level ground the stiffness stays."""
DAMPING_SHARES: Final = (0.5, 2.0)
"""As `STIFFNESS_SHARES`, for the damping: too little is worse than too much."""
BACK_S: Final = 0.25
"""From any limit a curve is back at that of level ground in so long, at the fastest rate that is allowed."""


class Impedance(NamedTuple):
    """What an ankle's drive imitates: a spring about an equilibrium angle beside a damper; dorsiflexion is positive."""

    equilibrium_rad: float
    stiffness_nm_per_rad: float
    damping_nms_per_rad: float

    def torque_nm(self, angle_rad: float, rate_radps: float) -> float:
        """Return the torque at an angle and its rate, > 0 where it dorsiflexes."""
        return self.stiffness_nm_per_rad * (self.equilibrium_rad - angle_rad) - self.damping_nms_per_rad * rate_radps


@dataclass(frozen=True)
class StanceCurve:
    """`points` (5, 3): equilibrium (rad), stiffness (N·m/rad) and damping (N·m·s/rad) at `SHARES` of stance."""

    points: FloatArray

    def at(self, share: float) -> Impedance:
        """Return the impedance when this share of stance is over; before and after stance that of its ends."""
        found = (float(np.interp(share, SHARES, column)) for column in self.points.T)
        return Impedance(*found)


@dataclass(frozen=True)
class Limits:
    """What a curve may be beside that of `level` ground, and how fast each of its numbers may change.

    Raises ValueError for a level curve that is not finite, or has no stiffness or damping.
    """

    level: StanceCurve

    def __post_init__(self) -> None:
        """Refuse a curve that bounds nothing."""
        points = self.level.points
        if not (np.isfinite(points).all() and np.all(points[:, 1:] > 0.0)):
            raise ValueError("the impedance on level ground must be finite, stiffness and damping above 0")

    @property
    def low(self) -> FloatArray:
        """Return the least of each number (5, 3)."""
        level = self.level.points
        return np.column_stack(
            (level[:, 0] - MOST_OFF_RAD, STIFFNESS_SHARES[0] * level[:, 1], DAMPING_SHARES[0] * level[:, 2])
        )

    @property
    def high(self) -> FloatArray:
        """Return the largest of each number (5, 3)."""
        level = self.level.points
        return np.column_stack(
            (level[:, 0] + MOST_OFF_RAD, STIFFNESS_SHARES[1] * level[:, 1], DAMPING_SHARES[1] * level[:, 2])
        )

    @property
    def rates(self) -> FloatArray:
        """Return by how much each number (5, 3) may change in a second."""
        level = self.level.points
        return np.maximum(self.high - level, level - self.low) / BACK_S

    def bounded(self, points: FloatArray) -> StanceCurve:
        """Return the nearest curve within the limits; a number that is not finite becomes that of level ground."""
        finite = np.where(np.isfinite(points), points, self.level.points)
        return StanceCurve(np.clip(finite, self.low, self.high))

    def approached(self, now: StanceCurve, wanted: StanceCurve, seconds: float) -> StanceCurve:
        """Return the curve that comes `seconds` after `now` on the way to `wanted`, no faster than allowed."""
        most = self.rates * max(seconds, 0.0)
        return StanceCurve(now.points + np.clip(wanted.points - now.points, -most, most))
