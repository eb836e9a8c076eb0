"""People who stand and walk on the simulated platform: their true ankle impedance and how they use the foot.

The shapes over stance are those of published perturbation studies of walking: stiffness about the dorsi-plantarflexion
axis from 1 to 2 N·m/rad/kg after foot flat to 6 to 7 before heel off, then falling, about a third of it about
inversion-eversion; damping at a ratio of 0.3 to 0.4 with a foot of 0.02 and 0.008 kg m² (Rouse, Hargrove, Perreault and
Kuiken, IEEE Trans. Neural Syst. Rehabil. Eng. 22(4), 2014; Lee, Rouse and Krebs, IEEE J. Transl. Eng. Health Med. 4,
2016; Ficanha, Ribeiro, Knop and Rastgaar, 2017). Curves are interpolated by piecewise cubics, no estimator's basis.
What couples the axes is drawn, a tenth of the root of the product of both stiffnesses; shoe and heel pad are assumed to
be 8 to 10 times as stiff as the ankle in mid-stance.

A mock-up has the same shape, but a spring and a damper for an ankle, a weight for a body, and does nothing by itself.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline

from impedance.body.geometry import PLATFORM_GRAVITY_MPS2
from messages.arrays import FloatArray

_SHARE: Final = np.array([0.0, 0.1, 0.2, 0.35, 0.5, 0.65, 0.75, 0.85, 1.0])
_STIFFNESS_PER_KG: Final = np.array([1.3, 1.5, 1.9, 3.0, 4.3, 5.8, 6.5, 6.1, 3.5])
_STANDING_PER_KG: Final = np.full(9, 4.5)
_INVERSION_SHARE: Final = 0.33
_TORQUE_SHARE: Final = np.array([0.0, 0.08, 0.2, 0.4, 0.6, 0.75, 0.85, 1.0])
_TORQUE_PER_KG: Final = np.array([0.0, -0.10, 0.05, 0.45, 0.95, 1.35, 1.20, 0.0])
"""On the foot, about Z: the heel's load plantarflexes it first, then the ball's dorsiflexes it against the calf."""
_SHANK_RAD: Final = (-0.22, 0.35)
_FOOT_OF_KG: Final = 0.0155
_DAMPED_KGM2: Final = np.array([0.02, 0.008])
_CROSS_SHARE: Final = 0.1
_SHOE_PER_KG: Final = np.array([40.0, 12.0])
_SHOE_RATIO: Final = 0.25


@dataclass(frozen=True)
class Shoe:
    """Shoe and heel pad between foot and plate: `stiffness` (N·m/rad) and `damping` (N·m·s/rad) (2,) about Z and X.

    The foot turns against the plate about the point of the surface below the ankle; from `heel_off`, a share of
    stance, it rises over the ball, which lies `ball_m` before the ankle.
    """

    stiffness: FloatArray
    damping: FloatArray
    heel_off: float = 0.70
    ball_m: float = 0.13
    heel_m: float = -0.05


@dataclass(frozen=True)
class Person:
    """One person: `stiffness` (N·m/rad) and `damping` (N·m·s/rad) (k, 2) about Z and X at shares of stance.

    `reflex_nm_s` (2,) is the reflex's gain at mid-stance; the foot's body is in P, the tensor (3, 3) about its centre
    of gravity; `leg_kg` moves with the ankle's centre, `shank_kgm2` (2,) resists the ankle's moment. `cross_share` of
    the root of both stiffnesses couples the axes; `restless` is 1 for all that a person does unasked, 0 for a mock-up.
    Without a `shoe` the foot is one with the plate.
    """

    mass_kg: float
    stance_s: float
    ankle_P_m: FloatArray
    foot_kg: float
    foot_cog_P_m: FloatArray
    foot_kgm2: FloatArray
    leg_kg: float
    shank_kgm2: FloatArray
    reflex_nm_s: FloatArray
    walks: bool
    _stiffness: CubicSpline
    _ratio: tuple[float, float]
    cross_share: float = 0.0
    restless: float = 1.0
    shoe: Shoe | None = None

    def stiffness(self, stance: FloatArray) -> FloatArray:
        """Return K (..., 2) about Z and X."""
        about_z = self._stiffness(np.clip(stance, 0.0, 1.0))
        return np.stack((about_z, _INVERSION_SHARE * about_z), axis=-1)

    def cross_stiffness(self, stance: FloatArray) -> FloatArray:
        """Return the moment (...) about either axis by a turn about the other, N·m/rad."""
        cross: FloatArray = self.cross_share * np.sqrt(self.stiffness(stance).prod(axis=-1))
        return cross

    def damping(self, stance: FloatArray) -> FloatArray:
        """Return B (..., 2): 2 ζ √(K I)."""
        ratio = self._ratio[0] + self._ratio[1] * np.cos(np.pi * np.clip(stance, 0.0, 1.0))
        damping: FloatArray = 2.0 * ratio[..., None] * np.sqrt(self.stiffness(stance) * _DAMPED_KGM2)
        return damping

    def usual_moment(self, stance: FloatArray) -> FloatArray:
        """Return the moment (..., 2) of the platform on the foot about the ankle with no perturbation."""
        if not self.walks:
            return np.broadcast_to(self.restless * self.mass_kg * np.array([0.30, 0.02]), (*stance.shape, 2))
        about_z = self.mass_kg * CubicSpline(_TORQUE_SHARE, _TORQUE_PER_KG)(stance)
        about_x = 0.12 * self.mass_kg * np.sin(np.pi * stance) * np.cos(1.5 * np.pi * stance)
        return np.stack((about_z, about_x), axis=-1)

    def usual_force(self, stance: FloatArray) -> FloatArray:
        """Return the force (..., 3) in I that the platform exerts on the foot with no perturbation."""
        weight_n = PLATFORM_GRAVITY_MPS2 * self.mass_kg
        if not self.walks:
            return np.broadcast_to(weight_n * np.array([0.0, 0.5 if self.restless else 1.0, 0.0]), (*stance.shape, 3))
        ahead = -0.18 * np.sin(2.0 * np.pi * stance)
        up = np.sin(np.pi * stance) ** 0.4 * (1.0 - 0.22 * np.sin(np.pi * stance) ** 6) * 1.12
        across = 0.04 * np.sin(np.pi * stance)
        return weight_n * np.stack((ahead, up, across), axis=-1)

    def usual_shank(self, stance: FloatArray) -> FloatArray:
        """Return the shank's turn (..., 2) about Z and X, against the upright."""
        if not self.walks:
            return np.broadcast_to(self.restless * np.array([-0.03, 0.0]), (*stance.shape, 2))
        first, last = _SHANK_RAD
        smooth = stance**2 * (3.0 - 2.0 * stance)
        return np.stack((-(first + (last - first) * smooth), 0.04 * np.sin(np.pi * stance)), axis=-1)


def person(seed: int, walks: bool = True, shod: bool = False) -> Person:
    """Return the person of this seed: body, stiffness and damping vary by some 10 %; `shod` with shoe and heel pad."""
    rng = np.random.default_rng((seed, 1))
    mass_kg = float(rng.uniform(60.0, 90.0))
    per_kg = _STIFFNESS_PER_KG if walks else _STANDING_PER_KG
    level, tilt = 1.0 + 0.1 * rng.standard_normal(), 0.08 * rng.standard_normal()
    knots = mass_kg * per_kg * np.clip(level + tilt * np.cos(np.pi * _SHARE), 0.7, 1.3)
    foot_kg = _FOOT_OF_KG * mass_kg
    found = Person(
        mass_kg=mass_kg,
        stance_s=float(rng.uniform(0.65, 0.75)) if walks else 3.0,
        ankle_P_m=np.array([-0.05, 0.10, 0.01]) + 0.01 * rng.standard_normal(3),
        foot_kg=foot_kg,
        foot_cog_P_m=np.array([0.02, 0.05, 0.0]) + 0.005 * rng.standard_normal(3),
        foot_kgm2=foot_kg * np.array([[0.0010, 1e-4, 0.0], [1e-4, 0.0040, 1e-4], [0.0, 1e-4, 0.0036]]),
        leg_kg=0.06 * mass_kg,
        shank_kgm2=mass_kg * np.array([0.05, 0.06]),
        reflex_nm_s=mass_kg * np.array([0.10, 0.03]) * rng.uniform(0.5, 1.5),
        walks=walks,
        _stiffness=CubicSpline(_SHARE, knots),
        _ratio=(0.35 + 0.03 * float(rng.standard_normal()), 0.05 * float(rng.standard_normal())),
    )
    found = replace(found, cross_share=_CROSS_SHARE * float(rng.standard_normal()))
    stiffness = mass_kg * _SHOE_PER_KG * rng.uniform(0.8, 1.2)
    shoe = Shoe(stiffness, 2.0 * _SHOE_RATIO * np.sqrt(stiffness * _DAMPED_KGM2))
    return replace(found, shoe=shoe) if shod else found


def mockup(
    stiffness_nm_per_rad: float, damping_nms_per_rad: float, mass_kg: float = 40.0, shod: bool = False
) -> Person:
    """Return a spring and a damper about Z, a third of the spring about X with the same damping ratio, under a weight.

    A foot of steel, of which everything is known, carries them; `shod` puts a rubber sole under it.
    """
    ratio = damping_nms_per_rad / (2.0 * float(np.sqrt(stiffness_nm_per_rad * _DAMPED_KGM2[0])))
    foot_kg = 2.0
    shoe = Shoe(8.0 * np.array([1.0, _INVERSION_SHARE]) * stiffness_nm_per_rad, np.array([3.0, 1.5]), heel_off=1.0)
    return Person(
        mass_kg=mass_kg,
        stance_s=1.5,
        ankle_P_m=np.array([-0.03, 0.08, 0.0]),
        foot_kg=foot_kg,
        foot_cog_P_m=np.array([0.0, 0.03, 0.0]),
        foot_kgm2=np.diag([0.0030, 0.0110, 0.0090]),
        leg_kg=mass_kg,
        shank_kgm2=mass_kg * np.array([0.08, 0.08]),
        reflex_nm_s=np.zeros(2),
        walks=False,
        _stiffness=CubicSpline(_SHARE, np.full(len(_SHARE), stiffness_nm_per_rad)),
        _ratio=(ratio, 0.0),
        restless=0.0,
        shoe=shoe if shod else None,
    )
