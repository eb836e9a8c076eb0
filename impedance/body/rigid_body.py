"""Inertia of a rigid body and its equations of motion, linear in ten parameters.

With a_O the acceleration of the body frame's origin O, g gravity, ω and α the angular velocity and acceleration, all in
the body's frame, d the centre of gravity from O and J_O = J + m (d·d 1 − d dᵀ) the tensor about O, the wrench is

    f = m (a_O − g) + (α× + ω×ω×) m d                                                                             (1)
    T = J_O α + ω × J_O ω + m d × (a_O − g)                                                                       (2)

which is Y(a_O, g, ω, α) π with π = (m, m d, J_O) [Atkeson, An and Hollerbach, Int. J. Robotics Research 5(3), 1986].
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from messages.arrays import FloatArray

TENSOR_ORDER: Final = ("xx", "yy", "zz", "yz", "xz", "xy")
"""The order of six tensor entries wherever they stand in a row."""


@dataclass(frozen=True)
class Inertia:
    """Mass, centre of gravity (3,) in the body's frame, and tensor (3, 3) about it, along the frame's axes.

    The tensor's off-diagonal entries are the matrix's own: −∫xy dm. Nothing is refused here, for an estimate may be
    impossible: see `is_consistent` and `checked`.
    """

    mass_kg: float
    cog_m: FloatArray
    inertia_kgm2: FloatArray

    @classmethod
    def from_vector(cls, vector: FloatArray) -> "Inertia":
        """Return the inertia of π (10,); without mass the centre of gravity is NaN, and so is the tensor."""
        mass_kg = float(vector[0])
        cog_m: FloatArray = vector[1:4] / mass_kg if mass_kg != 0.0 else np.full(3, np.nan)
        return cls(mass_kg, cog_m, tensor_of(vector[4:]) - mass_kg * _spread(cog_m))

    @classmethod
    def about(cls, mass_kg: float, cog_m: FloatArray, six_kgm2: FloatArray) -> "Inertia":
        """Return the inertia of a tensor given by six entries about the centre of gravity, in TENSOR_ORDER."""
        return cls(mass_kg, np.asarray(cog_m, dtype=np.float64), tensor_of(np.asarray(six_kgm2, dtype=np.float64)))

    @property
    def vector(self) -> FloatArray:
        """Return π (10,): mass, first moment (3), and the six entries of the tensor about the frame's origin."""
        about_origin = self.inertia_kgm2 + self.mass_kg * _spread(self.cog_m)
        return np.concatenate(([self.mass_kg], self.mass_kg * self.cog_m, six_of(about_origin)))

    def about_cog(self) -> FloatArray:
        """Return the six entries (6,) of the tensor about the centre of gravity, in TENSOR_ORDER."""
        return six_of(self.inertia_kgm2)

    @property
    def is_consistent(self) -> bool:
        """Tell whether a rigid body can have it: positive mass, and second moments ½ tr(J) 1 − J ⪰ 0.

        That is the triangle inequality in every direction, and makes J itself positive [Wensing, Kim and Slotine, IEEE
        Robotics and Automation Letters 3(1), 2018].
        """
        J = self.inertia_kgm2
        if not (np.isfinite(J).all() and np.isfinite(self.cog_m).all() and self.mass_kg > 0.0):
            return False
        second_moment = 0.5 * np.trace(J) * np.eye(3) - J
        return bool(np.linalg.eigvalsh(second_moment)[0] >= -_ROUNDING * abs(float(np.trace(J))))

    def checked(self) -> "Inertia":
        """Return this inertia; raises ValueError where no rigid body can have it."""
        if not self.is_consistent:
            entries = ", ".join(f"{value:.4g}" for value in self.about_cog())
            raise ValueError(
                f"no rigid body has mass {self.mass_kg:.4g} kg and tensor ({entries}) kg m²: the mass must be "
                "positive, and each principal moment at most the sum of the two others"
            )
        return self

    def seen_from(self, R_PF: FloatArray, p_PF_m: FloatArray) -> "Inertia":
        """Return the inertia in P of a body known in F: R_PF (3, 3) takes F's vectors to P, p_PF (3,) is F's origin."""
        return Inertia(self.mass_kg, p_PF_m + R_PF @ self.cog_m, R_PF @ self.inertia_kgm2 @ R_PF.T)

    def joined(self, other: "Inertia") -> "Inertia":
        """Return the inertia of both bodies, known in the same frame, as one."""
        return Inertia.from_vector(self.vector + other.vector)


def regressor(a_O: FloatArray, g: FloatArray, w: FloatArray, alpha: FloatArray) -> FloatArray:
    """Return Y (n, 6, 10) of (1) and (2), of arguments (n, 3) in the body's frame: the wrench (f, T) about O is Y π."""
    lift = a_O - g
    Y = np.zeros((len(w), 6, 10))
    Y[:, :3, 0] = lift
    Y[:, :3, 1:4] = cross_matrix(alpha) + w[:, :, None] * w[:, None, :] - (w * w).sum(axis=1)[:, None, None] * np.eye(3)
    Y[:, 3:, 1:4] = -cross_matrix(lift)
    Y[:, 3:, 4:] = _tensor_columns(alpha) + cross_matrix(w) @ _tensor_columns(w)
    return Y


def wrench_transform(R_PF: FloatArray, p_PF_m: FloatArray) -> FloatArray:
    """Return X_PF (6, 6): the wrench about F's origin in F, taken to P's origin in P: (R f, R τ + p_PF × R f)."""
    X = np.zeros((6, 6))
    X[:3, :3] = X[3:, 3:] = R_PF
    X[3:, :3] = cross_matrix(p_PF_m[None])[0] @ R_PF
    return X


def cross_matrix(v: FloatArray) -> FloatArray:
    """Return v× (n, 3, 3) of vectors (n, 3)."""
    matrix = np.zeros((len(v), 3, 3))
    matrix[:, 0, 1], matrix[:, 0, 2], matrix[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    matrix[:, 1, 0], matrix[:, 2, 0], matrix[:, 2, 1] = v[:, 2], -v[:, 1], v[:, 0]
    return matrix


def tensor_of(six: FloatArray) -> FloatArray:
    """Return the symmetric tensor (3, 3) of six entries in TENSOR_ORDER."""
    xx, yy, zz, yz, xz, xy = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def six_of(tensor: FloatArray) -> FloatArray:
    """Return the six entries (6,) of a symmetric tensor (3, 3), in TENSOR_ORDER."""
    return np.array([tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[1, 2], tensor[0, 2], tensor[0, 1]])


def _spread(d: FloatArray) -> FloatArray:
    """Return d·d 1 − d dᵀ (3, 3)."""
    spread: FloatArray = d @ d * np.eye(3) - np.outer(d, d)
    return spread


def _tensor_columns(v: FloatArray) -> FloatArray:
    """Return C (n, 3, 6) with C six = J v."""
    C = np.zeros((len(v), 3, 6))
    x, y, z = v.T
    C[:, 0, 0], C[:, 0, 5], C[:, 0, 4] = x, y, z
    C[:, 1, 5], C[:, 1, 1], C[:, 1, 3] = x, y, z
    C[:, 2, 4], C[:, 2, 3], C[:, 2, 2] = x, y, z
    return C


_ROUNDING = 1e-12
