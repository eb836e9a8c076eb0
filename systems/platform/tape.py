"""A foot that rocks on the tape which holds it, about z and x through P's origin, on the plate's surface.

With π = (m, h, J) of the foot about P's origin, T the moment of the rigid foot, and s = jω, the small turns δ about z
and ε about x follow from

    (J s² + diag(J_zz (2 ζ ω_z s + ω_z²), J_xx (2 ζ ω_x s + ω_x²)) − g h_y) (δ, ε) = −(T_z, T_x)                   (1)

where J holds the entries zz, xx and xz. The foot's frame is then turned by R = Rz(δ) Rx(ε), so that its motion is

    ω_F = Rᵀ (ω + ν),   α_F = Rᵀ (α + ν̇ + ω × ν),   ν = δ̇ e_z + ε̇ R e_x                                          (2)

and with p̈ its origin's acceleration less gravity, all in F,

    f = m p̈ + α × h + ω × (ω × h),   T = J α + ω × J ω + h × p̈                                                   (3)

Vectors are rows (3, n): every start and every step of a fit of the tape comes through here.
"""

from dataclasses import dataclass
from math import isfinite

import numpy as np

from impedance.body.geometry import PLATFORM_GRAVITY_MPS2
from impedance.body.kinematics import Kinematics
from impedance.body.rigid_body import tensor_of
from messages.arrays import FloatArray
from systems.platform.band import Band

_LEAST_KGM2 = 1e-4
"""Inertia of the foot, at least: a fit may try none, and nothing would then resist the moment."""


@dataclass(frozen=True)
class Carried:
    """The motion of P as rows (3, n): its origin's acceleration less gravity, ω and α, all in P."""

    sf_mps2: FloatArray
    w: FloatArray
    alpha: FloatArray

    @classmethod
    def of(cls, motion: Kinematics) -> "Carried":
        """Return the rows of a motion."""
        rows = (motion.a_O_P - motion.g_P, motion.w, motion.alpha)
        return cls(*(np.ascontiguousarray(each.T) for each in rows))


@dataclass(frozen=True)
class Rocking:
    """What rocking adds to the wrench (6, n) of the foot, and the turns δ and ε (2, n)."""

    wrench: FloatArray
    turns_rad: FloatArray


def rocking(
    band: Band,
    foot: FloatArray,
    motion: Carried,
    rigid: FloatArray,
    rest: FloatArray,
    resonances_hz: tuple[float, float],
    zeta: float,
) -> Rocking:
    """Return what a foot of π (10,) about P's origin does that moves by `motion` of P.

    `rigid` (6, n) is its wrench without rocking, less that at `rest` (6,); `resonances_hz` are those about z and x,
    infinite where the tape does not give.
    """
    J = tensor_of(foot[4:])
    s = 2j * np.pi * band.f_hz
    driving = -band.spectrum(rigid[[5, 3]]) * band.motion_limit
    free = [isfinite(hz) for hz in resonances_hz]
    diagonal = []
    for hz, axis in zip(resonances_hz, (2, 0), strict=True):
        w = 2.0 * np.pi * (hz if isfinite(hz) else 1.0)  # any: that turn is set to zero below
        own = max(float(J[axis, axis]), _LEAST_KGM2)
        diagonal.append(own * (s**2 + 2.0 * zeta * w * s + w**2) - PLATFORM_GRAVITY_MPS2 * foot[2])
    coupling = J[0, 2] * s**2 if all(free) else np.zeros_like(s)
    determinant = diagonal[0] * diagonal[1] - coupling**2
    turns = (
        np.stack(
            (
                (diagonal[1] * driving[0] - coupling * driving[1]) / determinant,
                (diagonal[0] * driving[1] - coupling * driving[0]) / determinant,
            )
        )
        * np.array(free)[:, None]
    )
    rows = band.full(np.concatenate((turns, s * turns, s**2 * turns)))
    wrench = _rocked(foot, motion, rows[:2], rows[2:4], rows[4:])
    return Rocking(wrench - rigid - rest[:, None], rows[:2])


def shifted(R_IP: FloatArray, turns_rad: FloatArray, at_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what turns (2, n) of F about P's origin do to the place `at_m` (3,) of F's origin, in I, and to θ and φ.

    `R_IP` (9, n) holds the matrix row by row; the results are (3, n) and (2, n).
    """
    turn = _Turn.by(turns_rad)
    moved_m = np.einsum("rcn,cn->rn", R_IP.reshape(3, 3, -1), turn.to_P(at_m[:, None]) - at_m[:, None])
    sin_theta, cos_cos, minus_cos_sin = turn.to_F(R_IP[3:6])  # the second row of R_IF
    before = np.stack((np.arcsin(R_IP[3]), np.arctan2(-R_IP[5], R_IP[4])))
    after = np.stack((np.arcsin(np.clip(sin_theta, -1.0, 1.0)), np.arctan2(-minus_cos_sin, cos_cos)))
    return moved_m, after - before


def _rocked(
    foot: FloatArray, motion: Carried, turns_rad: FloatArray, rate: FloatArray, acceleration: FloatArray
) -> FloatArray:
    """Return by (2) and (3) the wrench (6, n) in P of the foot that rocks."""
    turn = _Turn.by(turns_rad)
    (sin, _), (cos, _) = turn.sin, turn.cos
    both = rate[0] * rate[1]
    v = np.stack((rate[1] * cos, rate[1] * sin, rate[0]))
    v_rate = np.stack((acceleration[1] * cos - both * sin, acceleration[1] * sin + both * cos, acceleration[0]))
    sf_mps2 = turn.to_F(motion.sf_mps2)
    w = turn.to_F(motion.w + v)
    alpha = turn.to_F(motion.alpha + v_rate + _cross(motion.w, v))
    m, h, J = foot[0], foot[1:4, None], tensor_of(foot[4:])
    force = m * sf_mps2 + _cross(alpha, h) + _cross(w, _cross(w, h))
    moment = J @ alpha + _cross(w, J @ w) + _cross(h, sf_mps2)
    return np.concatenate((turn.to_P(force), turn.to_P(moment)))


@dataclass(frozen=True)
class _Turn:
    """R = Rz(δ) Rx(ε) by the sines and cosines (2, n) of both."""

    sin: FloatArray
    cos: FloatArray

    @classmethod
    def by(cls, turns_rad: FloatArray) -> "_Turn":
        return cls(np.sin(turns_rad), np.cos(turns_rad))

    def to_P(self, v: FloatArray) -> FloatArray:
        """Return R v of rows (3, n)."""
        (sin_d, sin_e), (cos_d, cos_e) = self.sin, self.cos
        y, z = cos_e * v[1] - sin_e * v[2], sin_e * v[1] + cos_e * v[2]
        return np.stack((cos_d * v[0] - sin_d * y, sin_d * v[0] + cos_d * y, z))

    def to_F(self, v: FloatArray) -> FloatArray:
        """Return Rᵀ v of rows (3, n)."""
        (sin_d, sin_e), (cos_d, cos_e) = self.sin, self.cos
        y = cos_d * v[1] - sin_d * v[0]
        return np.stack((cos_d * v[0] + sin_d * v[1], cos_e * y + sin_e * v[2], cos_e * v[2] - sin_e * y))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.stack((a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]))
