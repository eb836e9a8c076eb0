"""Who else may tell a prosthesis its impedance: the truth, and what a foot alone can know, one step late."""

import math
from typing import Final

import numpy as np

from impedance.modulation.curve import Impedance, Limits, StanceCurve
from impedance.modulation.table import published
from messages import GaitPhase, TerrainKind
from sim_rig.prosthesis.profile import Profile
from sim_rig.prosthesis.prosthesis import VirtualProsthesis
from sim_rig.walk.footholds import Foothold

RAMP_RAD: Final = math.radians(1.5)
FOOT_BIAS_RAD: Final = math.radians(0.3)
FOOT_NOISE_RAD: Final = math.radians(0.3)
"""One standard deviation of a foot's inertial inclination: of the unit, and of each stance."""

_STAIR_BEHIND_M = 0.5
_STANDING = 2  # the first stance is that of a wearer who stands, which tells of posture
_SLOPED = (TerrainKind.LEVEL, TerrainKind.RAMP_UP, TerrainKind.RAMP_DOWN)


class OfGround:
    """What the ankle of a body of `mass_kg` should be on some ground, as the published table has it."""

    def __init__(self, mass_kg: float) -> None:
        self._table, self._mass_kg = published(), mass_kg
        self._limits = Limits(self._table.level(mass_kg))

    def curve(self, slope_rad: float, kind: TerrainKind) -> StanceCurve:
        """Return it over stance: that of level ground where the table has none."""
        if kind not in _SLOPED or not self._table.holds(slope_rad):
            return self._limits.level
        return self._limits.bounded(self._table.at(slope_rad, 0.0, self._mass_kg)[0].points)

    def under(self, ground: Profile, foothold: Foothold) -> StanceCurve:
        """Return it for a stance on a foothold."""
        return self.curve(foothold.slope_rad, true_kind(ground, foothold))


def true_kind(ground: Profile, foothold: Foothold) -> TerrainKind:
    """Return the kind of the ground on which a foot stands."""
    if foothold.kind == "stairs":
        x_m = float(foothold.p_WF_m[0])
        goes_up = ground.height_m(x_m) > ground.height_m(x_m - _STAIR_BEHIND_M)
        return TerrainKind.STAIRS_UP if goes_up else TerrainKind.STAIRS_DOWN
    return kind_of_slope(foothold.slope_rad)


def kind_of_slope(slope_rad: float) -> TerrainKind:
    """Return the kind of even ground of a slope."""
    if abs(slope_rad) < RAMP_RAD:
        return TerrainKind.LEVEL
    return TerrainKind.RAMP_UP if slope_rad > 0.0 else TerrainKind.RAMP_DOWN


class ToldByTruth:
    """Controls that know the ground under each stance of the prosthesis that they `watch`."""

    def __init__(self, of_ground: OfGround) -> None:
        self._of_ground = of_ground
        self._prosthesis: VirtualProsthesis | None = None

    def watch(self, prosthesis: VirtualProsthesis) -> None:
        """Take the prosthesis whose footholds are asked for."""
        self._prosthesis = prosthesis

    def impedance(self, _t_ns: int, _phase: GaitPhase, share: float) -> Impedance:
        """Return that for the true ground."""
        foothold = None if self._prosthesis is None else self._prosthesis.stances[-1].foothold
        if self._prosthesis is None or foothold is None:
            return self._of_ground.curve(0.0, TerrainKind.LEVEL).at(share)
        return self._of_ground.under(self._prosthesis.ground, foothold).at(share)


class InertialSlope:
    """The slope that the foot's own inclination shows while it is flat, for the step after it: one step late.

    After Sup, Varol and Goldfarb, IEEE Transactions on Neural Systems and Rehabilitation Engineering 19(1), 2011, which
    the thesis names as what eyes would improve on. The foot is that of the prosthesis that they `watch`; `seed` draws
    the sensor's bias. A foot alone knows no stairs.
    """

    def __init__(self, of_ground: OfGround, seed: int) -> None:
        self._of_ground = of_ground
        self._prosthesis: VirtualProsthesis | None = None
        self._chance = np.random.default_rng([seed, 43])
        self._bias_rad = FOOT_BIAS_RAD * float(self._chance.standard_normal())
        self._curve = of_ground.curve(0.0, TerrainKind.LEVEL)
        self._known = 0

    def watch(self, prosthesis: VirtualProsthesis) -> None:
        """Take the prosthesis whose foot tells the slope."""
        self._prosthesis = prosthesis

    def impedance(self, _t_ns: int, _phase: GaitPhase, share: float) -> Impedance:
        """Return that for the slope of the stance before."""
        stances = [] if self._prosthesis is None else self._prosthesis.stances
        if len(stances) > self._known:
            self._known = len(stances)
            flat_rad = stances[-2].flat_pitch_rad if len(stances) > _STANDING else []
            if flat_rad:
                noise_rad = FOOT_NOISE_RAD * float(self._chance.standard_normal())
                slope_rad = float(np.median(flat_rad)) + self._bias_rad + noise_rad
                self._curve = self._of_ground.curve(slope_rad, kind_of_slope(slope_rad))
        return self._curve.at(share)
