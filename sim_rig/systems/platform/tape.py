"""A foot that rocks on the tape which holds it, about z and x through P's origin, on the plate's surface.

With π = (m, h, J) of the foot about P's origin, T the moment of the rigid foot, and s = jω, the small turns δ about z
and ε about x follow from

    (J s² + diag(J_zz (2 ζ ω_z s + ω_z²), J_xx (2 ζ ω_x s + ω_x²)) − g h_y) (δ, ε) = −(T_z, T_x)                   (1)

where J holds the entries zz, xx and xz. The foot's frame is then turned by R = Rz(δ) Rx(ε), so that its motion is

    ω_F = Rᵀ (ω + ν),   α_F = Rᵀ (α + ν̇ + ω × ν),   ν = δ̇ e_z + ε̇ R e_x                                          (2)
"""

from dataclasses import dataclass
from math import isfinite

import numpy as np

from impedance.body import geometry
from impedance.body.kinematics import Kinematics
from impedance.body.rigid_body import Array, tensor_of
from sim_rig.systems.platform.band import Band

_GRAVITY_MPS2 = 9.81
_LEAST_KGM2 = 1e-4


@dataclass(frozen=True)
class Rocking:
    """What rocking adds to the wrench (6, n) of the foot, and the turns δ and ε (2, n)."""

    wrench: Array
    turns_rad: Array


def rocking(
    band: Band, foot: Array, motion: Kinematics, rigid: Array, resonances_hz: tuple[float, float], zeta: float
) -> Rocking:
    """Return what a foot of π (10,) about P's origin does that moves by `motion` of P.

    `rigid` (6, n) is its wrench without rocking, tared at rest; `resonances_hz` are those about z and x, infinite where
    the tape does not give.
    """
    J = tensor_of(foot[4:])
    s = 2j * np.pi * band.f_hz
    driving = -band.spectrum(rigid[[5, 3]]) * band.motion_limit
    free = [isfinite(hz) for hz in resonances_hz]
    diagonal = []
    for hz, axis in zip(resonances_hz, (2, 0), strict=True):
        w = 2.0 * np.pi * (hz if isfinite(hz) else 1.0)
        own = max(float(J[axis, axis]), _LEAST_KGM2)
        diagonal.append(own * (s**2 + 2.0 * zeta * w * s + w**2) - _GRAVITY_MPS2 * foot[2])
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
    turn, rate, acceleration = rows[:2], rows[2:4], rows[4:]
    moved = _rocked(foot, motion, turn, rate, acceleration)
    still = (motion.regressor @ foot).T
    return Rocking(moved - still, turn)


def rotation_PF(turns_rad: Array) -> Array:
    """Return R_PF (n, 3, 3) = Rz(δ) Rx(ε) of turns (2, n)."""
    return geometry.rotation_IP(np.zeros(turns_rad.shape[1]), *turns_rad)


def _rocked(foot: Array, motion: Kinematics, turn: Array, rate: Array, acceleration: Array) -> Array:
    """Return by (2) the wrench (6, n) in P of the foot that rocks."""
    R_PF = rotation_PF(turn)
    axis = R_PF[:, :, 0]
    e_z = np.array([0.0, 0.0, 1.0])
    v = rate[0][:, None] * e_z + rate[1][:, None] * axis
    v_rate = acceleration[0][:, None] * e_z + acceleration[1][:, None] * axis
    v_rate += (rate[0] * rate[1])[:, None] * np.cross(e_z, axis)
    alpha = motion.alpha + v_rate + np.cross(motion.w, v)
    a_F, g_F, w_F, alpha_F = (
        (each[:, None, :] @ R_PF)[:, 0] for each in (motion.a_O_P, motion.g_P, motion.w + v, alpha)
    )
    wrench = Kinematics(a_F, w_F, alpha_F, g_F).regressor @ foot
    turned: Array = np.concatenate((R_PF @ wrench[:, :3, None], R_PF @ wrench[:, 3:, None]), axis=1)[:, :, 0].T
    return turned
