"""The motion of one body's frame, as its equations of motion need it."""

from dataclasses import dataclass

import numpy as np

from impedance.body import geometry
from impedance.body.rigid_body import regressor
from messages.arrays import FloatArray


@dataclass(frozen=True)
class Kinematics:
    """How a frame P moves: its origin's acceleration, ω and α, and gravity; all (n, 3) in P."""

    a_O_P: FloatArray
    w: FloatArray
    alpha: FloatArray
    g_P: FloatArray

    @classmethod
    def on_joint(
        cls,
        angles_rad: FloatArray,
        rates_radps: FloatArray,
        accelerations_radps2: FloatArray,
        lever_m: FloatArray,
    ) -> "Kinematics":
        """Return the exact motion of the plate on its universal joint: (θ, φ) and their derivatives (n, 2).

        `lever_m` (3,) leads from the joint to P's origin, in P.
        """
        no_psi = np.zeros((len(angles_rad), 1))
        euler, rate, second = (np.hstack((no_psi, each)) for each in (angles_rad, rates_radps, accelerations_radps2))
        w = geometry.angular_velocity(euler, rate)
        alpha = geometry.angular_acceleration(euler, rate, second)
        a_O_P = np.cross(alpha, lever_m) + np.cross(w, np.cross(w, lever_m))
        return cls(a_O_P, w, alpha, geometry.GRAVITY_I_MPS2 @ geometry.rotation_IP(*euler.T))

    @classmethod
    def of_pose(
        cls, euler_rad: FloatArray, rates_radps: FloatArray, accelerations_radps2: FloatArray, a_O_I: FloatArray
    ) -> "Kinematics":
        """Return the motion of a free frame: Euler angles (n, 3), derivatives, its origin's acceleration in I."""
        R_IP = geometry.rotation_IP(*euler_rad.T)
        a_O_P: FloatArray = (a_O_I[:, None, :] @ R_IP)[:, 0]
        return cls(
            a_O_P,
            geometry.angular_velocity(euler_rad, rates_radps),
            geometry.angular_acceleration(euler_rad, rates_radps, accelerations_radps2),
            geometry.GRAVITY_I_MPS2 @ R_IP,
        )

    @classmethod
    def at_rest(cls, euler_rad: FloatArray) -> "Kinematics":
        """Return a frame at rest at Euler angles (n, 3)."""
        still = np.zeros_like(euler_rad)
        return cls.of_pose(euler_rad, still, still, still)

    def of_mounted(self, R_PF: FloatArray, p_PF_m: FloatArray) -> "Kinematics":
        """Return the motion in F of a frame F fixed to P: R_PF (3, 3) takes F's vectors to P, p_PF (3,) its origin."""
        a_F = self.a_O_P + np.cross(self.alpha, p_PF_m) + np.cross(self.w, np.cross(self.w, p_PF_m))
        return Kinematics(a_F @ R_PF, self.w @ R_PF, self.alpha @ R_PF, self.g_P @ R_PF)

    @property
    def regressor(self) -> FloatArray:
        """Return Y (n, 6, 10) of impedance.body.rigid_body: the wrench about P's origin, in P, is Y π."""
        return regressor(self.a_O_P, self.g_P, self.w, self.alpha)
