"""The equations of motion (1) to (4) of the thesis's chapter 2, as they must be (docs/results/platform.md: as printed).

All vectors are in P and moments about P's origin O. With p̈ of the centre of gravity, d from O to it, and g gravity,

    f = m (p̈ − g) − f0                                                                                          (1.a)
    T_s = J α + ω × J ω + d × m (p̈ − g) − T0                                                                     (1.b)

(f0, T0) is the same at rest and level, which the tare took away: f0 = −m g and T0 = d × f0. A foot on the plate,
mounted at p_PF and R_PF, adds its own wrench about F's origin, turned to P and with its lever:

    f = f_P + R_PF f_F,   T_s = T_P + R_PF T_F + p_PF × R_PF f_F                                                  (2)

The residuals (3) of the plate and (4) of the foot are these minus what was measured.
"""

import numpy as np

from impedance.body.kinematics import Kinematics
from impedance.body.rigid_body import Inertia, wrench_transform
from messages.arrays import FloatArray


def body_wrench(body: Inertia, motion: Kinematics) -> FloatArray:
    """Return the wrench (n, 6) that moves `body` about its frame's origin: (1.a) and (1.b) before the tare.

    It is written with the motion of the centre of gravity; `Kinematics.regressor` says the same linear in ten
    parameters.
    """
    d, J, w, alpha = body.cog_m, body.inertia_kgm2, motion.w, motion.alpha
    cog_mps2 = motion.a_O_P + np.cross(alpha, d) + np.cross(w, np.cross(w, d))
    f = body.mass_kg * (cog_mps2 - motion.g_P)
    T = alpha @ J.T + np.cross(w, w @ J.T) + np.cross(d, f)
    return np.hstack((f, T))


def tare(body: Inertia) -> FloatArray:
    """Return (f0, T0) (6,): the wrench of `body` at rest on the level plate."""
    rest: FloatArray = body_wrench(body, Kinematics.at_rest(np.zeros((1, 3))))[0]
    return rest


def plate_wrench(plate: Inertia, motion: Kinematics) -> FloatArray:
    """Return the measured wrench (n, 6) of the bare plate, tared: (1.a) and (1.b)."""
    return body_wrench(plate, motion) - tare(plate)


def plate_and_foot_wrench(
    plate: Inertia, foot: Inertia, motion: Kinematics, R_PF: FloatArray, p_PF_m: FloatArray
) -> FloatArray:
    """Return the measured wrench (n, 6) of plate and foot after the bare plate's tare: (2).

    `foot` is known in F; R_PF (3, 3) takes vectors from F to P, p_PF (3,) is F's origin in P.
    """
    foot_wrench = body_wrench(foot, motion.of_mounted(R_PF, p_PF_m))
    both: FloatArray = plate_wrench(plate, motion) + foot_wrench @ wrench_transform(R_PF, p_PF_m).T
    return both


def plate_residual(plate: Inertia, motion: Kinematics, wrench: FloatArray) -> FloatArray:
    """Return ε (n, 6) of (3)."""
    return plate_wrench(plate, motion) - wrench


def foot_residual(
    foot: Inertia, plate: Inertia, motion: Kinematics, R_PF: FloatArray, p_PF_m: FloatArray, wrench: FloatArray
) -> FloatArray:
    """Return η (n, 6) of (4)."""
    return plate_and_foot_wrench(plate, foot, motion, R_PF, p_PF_m) - wrench
