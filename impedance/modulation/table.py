"""The table of set-points: the ankle's impedance over stance for slopes of the ground, per kg of the body.

Published numbers (`published.toml`, docs/setpoints.md) until own trials replace them (`own_trials`). From a published
angle θ and moment M of the unperturbed stance the equilibrium of a spring of stiffness K follows:

    M = K (θ_eq − θ)     ⇒     θ_eq = θ + M / K                                                                  (1)
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Final

import msgspec
import numpy as np

from impedance.modulation.curve import SHARES, StanceCurve
from messages.arrays import FloatArray
from messages.constants import NORMAL_95
from messages.text_files import parse_toml

BEYOND_RAD: Final = float(np.deg2rad(2.5))
"""So far beyond its steepest slopes a table is continued, in the straight lines of its ends."""


@dataclass(frozen=True)
class SetpointTable:
    """`values` and `deviations` (s, 5, 3) over rising `slopes_rad` (s,): equilibrium (rad), stiffness, damping per kg.

    A deviation is that between people and strides, or of an own trial that of its interval.
    """

    slopes_rad: FloatArray
    values: FloatArray
    deviations: FloatArray
    name: str

    @property
    def id(self) -> str:
        """Return eight hexadecimal digits that change with any number of the table."""
        numbers = np.concatenate([part.ravel() for part in (self.slopes_rad, self.values, self.deviations)])
        return hashlib.sha256(numbers.astype("<f8").tobytes()).hexdigest()[:8]

    def holds(self, slope_rad: float) -> bool:
        """Return whether the table tells anything for ground of this slope."""
        return bool(self.slopes_rad[0] - BEYOND_RAD <= slope_rad <= self.slopes_rad[-1] + BEYOND_RAD)

    def at(self, slope_rad: float, slope_sd_rad: float, mass_kg: float) -> tuple[StanceCurve, FloatArray]:
        """Return the curve for a body of `mass_kg` on ground of this slope, and the deviations (5, 3) of its points.

        They hold the table's and the slope's. Raises ValueError for a slope that the table does not hold.
        """
        if not self.holds(slope_rad):
            raise ValueError(f"slope_rad: {slope_rad} is outside the table '{self.name}'")
        k = int(np.clip(np.searchsorted(self.slopes_rad, slope_rad) - 1, 0, len(self.slopes_rad) - 2))
        share = (slope_rad - self.slopes_rad[k]) / (self.slopes_rad[k + 1] - self.slopes_rad[k])
        rise = self.values[k + 1] - self.values[k]
        by_slope = rise / (self.slopes_rad[k + 1] - self.slopes_rad[k])
        inside = min(max(share, 0.0), 1.0)
        deviation = self.deviations[k] + inside * (self.deviations[k + 1] - self.deviations[k])
        of_body = np.array([1.0, mass_kg, mass_kg])
        points = (self.values[k] + share * rise) * of_body
        return StanceCurve(points), np.hypot(deviation, by_slope * slope_sd_rad) * of_body

    def level(self, mass_kg: float) -> StanceCurve:
        """Return the curve on level ground: what a controller does whenever it is told nothing."""
        return self.at(0.0, 0.0, mass_kg)[0]


@cache
def published() -> SetpointTable:
    """Return the table of published numbers."""
    text = resources.files("impedance.modulation").joinpath("published.toml").read_text(encoding="utf-8")
    told = msgspec.convert(parse_toml(text, "published.toml"), _Published)
    stance = told.stance
    stiffness, damping = np.array(stance.stiffness_nm_per_rad_per_kg), np.array(stance.damping_nms_per_rad_per_kg)
    stiffness_sd, damping_sd = stiffness * stance.stiffness_sd_share, damping * stance.damping_sd_share
    rows = sorted(told.slope, key=lambda row: row.slope_deg)
    values, deviations = [], []
    for row in rows:
        equilibrium, equilibrium_sd = _equilibrium(row, stance, stiffness, stiffness_sd)
        values.append(np.column_stack((equilibrium, stiffness, damping)))
        deviations.append(np.column_stack((equilibrium_sd, stiffness_sd, damping_sd)))
    slopes_rad = np.deg2rad([row.slope_deg for row in rows])
    return SetpointTable(slopes_rad, np.array(values), np.array(deviations), "published")


class _Slope(msgspec.Struct, forbid_unknown_fields=True):
    slope_deg: float
    angle_low_rad: list[float]
    angle_high_rad: list[float]
    moment_low_nm_per_kg: list[float]
    moment_high_nm_per_kg: list[float]


class _Stance(msgspec.Struct, forbid_unknown_fields=True):
    measured_at: list[float]
    stiffness_nm_per_rad_per_kg: list[float]
    stiffness_sd_share: list[float]
    damping_nms_per_rad_per_kg: list[float]
    damping_sd_share: list[float]
    toe_off_equilibrium_rad: float
    toe_off_equilibrium_sd_rad: float


class _Published(msgspec.Struct, forbid_unknown_fields=True):
    slope: list[_Slope]
    stance: _Stance


def _equilibrium(
    row: _Slope, stance: _Stance, stiffness: FloatArray, stiffness_sd: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return θ_eq of (1) and its deviation (5,)."""
    angle, angle_sd = _middle(row.angle_low_rad, row.angle_high_rad)
    moment, moment_sd = _middle(row.moment_low_nm_per_kg, row.moment_high_nm_per_kg)
    K, K_sd = (np.interp(stance.measured_at, SHARES, each) for each in (stiffness, stiffness_sd))
    value = np.append(angle + moment / K, stance.toe_off_equilibrium_rad)
    variance = angle_sd**2 + (moment_sd / K) ** 2 + (moment * K_sd / K**2) ** 2
    deviation = np.append(np.sqrt(variance), stance.toe_off_equilibrium_sd_rad)
    at = np.append(stance.measured_at, 1.0)
    return np.interp(SHARES, at, value), np.interp(SHARES, at, deviation)


def _middle(low: Sequence[float], high: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Return the middle of ranges that hold 95 %, and the deviation."""
    lowest, highest = np.array(low), np.array(high)
    return 0.5 * (lowest + highest), (highest - lowest) / (2.0 * NORMAL_95)
