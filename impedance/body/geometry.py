"""The platform's frames: I inertial with Y up, P on the plate, and the universal joint between them.

    R_IP = Ry(ψ) Rz(θ) Rx(φ)                                                                                      (1)
    ω = E (ψ̇, θ̇, φ̇),   E = [[sin θ, 0, 1], [cos θ cos φ, sin φ, 0], [−cos θ sin φ, cos φ, 0]]    in P               (2)
    α = E (ψ̈, θ̈, φ̈) + Ė (ψ̇, θ̇, φ̇)                                                                                  (3)

The joint stands at the origin of I: its first axis is I's Z (angle θ), its second P's X (angle φ), so ψ = 0. P's
origin, the centre of the plate's surface, is carried at `joint_to_surface_m` along P's Y.
"""

from typing import Final

import numpy as np

from messages.arrays import FloatArray

PLATFORM_GRAVITY_MPS2: Final = 9.81
"""Not standard gravity but MuJoCo's default: the platform's model, its fits and the thesis's tables all rest on it."""

GRAVITY_I_MPS2: Final = np.array([0.0, -PLATFORM_GRAVITY_MPS2, 0.0])
"""Gravity in I, which has Y up."""


def rotation_IP(psi: FloatArray, theta: FloatArray, phi: FloatArray) -> FloatArray:
    """Return R_IP (n, 3, 3) of (1), which takes vectors from P to I; angles (n,) in rad."""
    psi, theta, phi = (np.asarray(angle, dtype=np.float64) for angle in (psi, theta, phi))
    sp, cp = np.sin(psi), np.cos(psi)
    st, ct = np.sin(theta), np.cos(theta)
    sf, cf = np.sin(phi), np.cos(phi)
    R = np.empty((*np.broadcast(psi, theta, phi).shape, 3, 3))
    R[..., 0, 0], R[..., 0, 1], R[..., 0, 2] = cp * ct, sp * sf - cp * st * cf, cp * st * sf + sp * cf
    R[..., 1, 0], R[..., 1, 1], R[..., 1, 2] = st, ct * cf, -ct * sf
    R[..., 2, 0], R[..., 2, 1], R[..., 2, 2] = -sp * ct, sp * st * cf + cp * sf, cp * cf - sp * st * sf
    return R


def euler_of(R_IP: FloatArray) -> FloatArray:
    """Return (ψ, θ, φ) (n, 3) of R_IP (n, 3, 3), the inverse of `rotation_IP` for |θ| < 90°."""
    return np.stack(
        (
            np.arctan2(-R_IP[..., 2, 0], R_IP[..., 0, 0]),
            np.arcsin(np.clip(R_IP[..., 1, 0], -1.0, 1.0)),
            np.arctan2(-R_IP[..., 1, 2], R_IP[..., 1, 1]),
        ),
        axis=-1,
    )


def angular_velocity(euler_rad: FloatArray, rate_radps: FloatArray) -> FloatArray:
    """Return ω (n, 3) of (2) in P, of Euler angles (n, 3) in the order (ψ, θ, φ) and their rates (n, 3)."""
    return _applied(_E(euler_rad), rate_radps)


def angular_acceleration(euler_rad: FloatArray, rate_radps: FloatArray, acceleration_radps2: FloatArray) -> FloatArray:
    """Return α (n, 3) of (3) in P, of Euler angles (n, 3), their rates (n, 3) and second derivatives (n, 3)."""
    return _applied(_E(euler_rad), acceleration_radps2) + _applied(_E_rate(euler_rad, rate_radps), rate_radps)


def joint_pose(theta: FloatArray, phi: FloatArray, joint_to_surface_m: float) -> tuple[FloatArray, FloatArray]:
    """Return p_IP_I (n, 3) and the Euler angles (n, 3) of the plate on its universal joint, at angles (n,) in rad."""
    euler_rad = np.stack((np.zeros_like(theta), theta, phi), axis=-1)
    return joint_to_surface_m * rotation_IP(*euler_rad.T)[..., :, 1], euler_rad


def _E(euler_rad: FloatArray) -> FloatArray:
    _, theta, phi = euler_rad.T
    E = np.zeros((len(theta), 3, 3))
    E[:, 0, 0], E[:, 0, 2] = np.sin(theta), 1.0
    E[:, 1, 0], E[:, 1, 1] = np.cos(theta) * np.cos(phi), np.sin(phi)
    E[:, 2, 0], E[:, 2, 1] = -np.cos(theta) * np.sin(phi), np.cos(phi)
    return E


def _E_rate(euler_rad: FloatArray, rate_radps: FloatArray) -> FloatArray:
    _, theta, phi = euler_rad.T
    _, theta_rate, phi_rate = rate_radps.T
    E = np.zeros((len(theta), 3, 3))
    E[:, 0, 0] = np.cos(theta) * theta_rate
    E[:, 1, 0] = -np.sin(theta) * np.cos(phi) * theta_rate - np.cos(theta) * np.sin(phi) * phi_rate
    E[:, 1, 1] = np.cos(phi) * phi_rate
    E[:, 2, 0] = np.sin(theta) * np.sin(phi) * theta_rate - np.cos(theta) * np.cos(phi) * phi_rate
    E[:, 2, 1] = -np.sin(phi) * phi_rate
    return E


def _applied(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    product: FloatArray = (matrices @ vectors[:, :, None])[:, :, 0]
    return product
