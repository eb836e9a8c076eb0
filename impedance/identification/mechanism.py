"""How the plate may move: the universal joint's two angles, or all six degrees of freedom of a free body.

A mechanism names the coordinates q of the motion and turns them, with two derivatives, into what the equations need. To
first order about level the pose of P moves by C q, where a small pose is (p_IP_I, small rotation about x, y, z).

The wrench is weighed in the frame in which the coordinates' noise enters without being modulated by the motion, so that
it stays one number per frequency:

    joint   z = (f, T) in P about O_P: the angles' noise enters through α in P                                    (1)
    free    z = (R f, R (T − d × f)): the position's noise enters R f alone, as m p̈_IP_I; the moment about the
            centre of gravity R (J α + ω × J ω) does not know where O_P is                                        (2)
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from impedance.body import geometry
from impedance.body.geometry import GRAVITY_I_MPS2
from impedance.body.kinematics import Kinematics
from impedance.body.rigid_body import regressor
from messages.arrays import FloatArray


class Mechanism(ABC):
    """The coordinates q (n, c) of a motion of P in I."""

    C: FloatArray
    """(6, c) of the small pose to the coordinates."""

    @abstractmethod
    def kinematics(self, q: FloatArray, rate: FloatArray, acceleration: FloatArray) -> Kinematics:
        """Return what the equations need, of coordinates (n, c) and their derivatives."""

    @abstractmethod
    def weighed(self, q: FloatArray, wrench: FloatArray, cog_m: FloatArray) -> FloatArray:
        """Return z (n, 6, k) of wrenches (n, 6, k) in P, by (1) or (2) with d = `cog_m` (3,) in P."""

    def level_weighing(self, cog_m: FloatArray) -> FloatArray:
        """Return z (6, 6) of the six unit wrenches on the level plate."""
        weighed: FloatArray = self.weighed(np.zeros((1, self.C.shape[1])), np.eye(6)[None], cog_m)[0]
        return weighed

    def level_columns(self) -> tuple[FloatArray, FloatArray]:
        """Return B0, B2 (c, 6, 10): near level the regressor moves by Σ_j B0_j q_j + B2_j q̈_j."""
        unit, none = np.eye(3), np.zeros((9, 3))
        a, alpha, g = none.copy(), none.copy(), none.copy()
        a[:3], alpha[3:6] = unit, unit
        g[6:] = np.cross(GRAVITY_I_MPS2, unit)  # R turned by a small δ: Rᵀ g = g + g × δ
        columns = regressor(a, g, none, alpha)
        B0 = np.einsum("kc,kwp->cwp", self.C[3:], columns[6:])
        B2 = np.einsum("kc,kwp->cwp", self.C, columns[:6])
        return B0, B2


@dataclass(frozen=True)
class UniversalJoint(Mechanism):
    """q = (θ, φ): ψ = 0 and p_IP_I = c + R (x, L, z), L = `joint_to_surface_m`.

    `beside_m` (x, z) is P's origin beside the joint, in P, and `centre_m` c is where the joint stands in I.
    """

    joint_to_surface_m: float
    beside_m: tuple[float, float] = (0.0, 0.0)
    centre_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def lever_m(self) -> FloatArray:
        """Return P's origin from the joint (3,), in P."""
        return np.array([self.beside_m[0], self.joint_to_surface_m, self.beside_m[1]])

    def moved(self, by_m: FloatArray) -> "UniversalJoint":
        """Return the joint whose lever is longer by (3,)."""
        x, y, z = (float(value) for value in self.lever_m + by_m)
        return UniversalJoint(y, (x, z), self.centre_m)

    @property
    def C(self) -> FloatArray:  # type: ignore[override]
        """(6, 2): a small θ turns about z, a small φ about x, and either carries O_P on its lever."""
        turns = np.array([[0.0, 1.0], [0.0, 0.0], [1.0, 0.0]])
        return np.vstack((np.cross(turns.T, self.lever_m).T, turns))

    def kinematics(self, q: FloatArray, rate: FloatArray, acceleration: FloatArray) -> Kinematics:
        """Return the motion of P about the joint."""
        return Kinematics.on_joint(q, rate, acceleration, self.lever_m)

    def weighed(self, q: FloatArray, wrench: FloatArray, cog_m: FloatArray) -> FloatArray:  # noqa: ARG002 - (1) asks neither
        """Return (1): the wrench as it is."""
        return wrench


@dataclass(frozen=True)
class FreeBody(Mechanism):
    """q = (p_IP_I, ψ, θ, φ): nothing is known of how the plate is held."""

    @property
    def C(self) -> FloatArray:  # type: ignore[override]
        """(6, 6): ψ turns about y, θ about z, φ about x."""
        C = np.eye(6)
        return C[:, [0, 1, 2, 4, 5, 3]]

    def kinematics(self, q: FloatArray, rate: FloatArray, acceleration: FloatArray) -> Kinematics:
        """Return the motion of P, its origin's acceleration being that of the position."""
        return Kinematics.of_pose(q[:, 3:], rate[:, 3:], acceleration[:, 3:], acceleration[:, :3])

    def weighed(self, q: FloatArray, wrench: FloatArray, cog_m: FloatArray) -> FloatArray:
        """Return (2)."""
        force, moment = wrench[:, :3], wrench[:, 3:]
        R_IP = geometry.rotation_IP(*q[:, 3:].T)
        about_cog = moment - np.cross(cog_m[None, :, None], force, axis=1)
        return np.concatenate((R_IP @ force, R_IP @ about_cog), axis=1)


def level_rest() -> FloatArray:
    """Return the columns (6, 10) of a body at rest on the level plate."""
    level: FloatArray = Kinematics.at_rest(np.zeros((1, 3))).regressor[0]
    return level
