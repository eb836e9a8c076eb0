"""The wrench that the sensor under a simulated person reads: momenta, differentiated; no equation of the estimator."""

from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from impedance.body.geometry import GRAVITY_I_MPS2
from messages.arrays import FloatArray
from sim_rig.platform.ankle_person import Person
from sim_rig.platform.rig import PLATE

JOINT_TO_SURFACE_M: Final = 0.12


def sensed(
    person: Person,
    plate: FloatArray,
    slip: FloatArray,
    rise: FloatArray,
    push: FloatArray,
    on_foot: FloatArray,
    dt: float,
) -> FloatArray:
    """Return the wrench (c, n, 6) of the sensor on the plate, in P about P's origin, the level plate's weight tared.

    The foot has turned by `slip` (c, n, 2) about the point below the ankle and then by `rise` over the ball; `push`
    (c, n, 3) in I is what the platform must carry of the person beside the foot's weight; `on_foot` (c, n, 2) is the
    moment of the shank on the foot about P's Z and X at the ankle.
    """
    shape = plate.shape[:2]
    R, R_slip, R_rise = (_rotation(each) for each in (plate, slip, rise))
    up = np.array([0.0, JOINT_TO_SURFACE_M, 0.0])
    below = person.ankle_P_m * (1.0, 0.0, 1.0)
    ball = below + (0.0 if person.shoe is None else person.shoe.ball_m) * np.array([1.0, 0.0, 0.0])
    R_foot = R @ R_rise @ R_slip

    def on_foot_at(place: FloatArray) -> FloatArray:
        moved = (R_slip @ (place - below)) + below - ball
        held: FloatArray = (R @ (up + ball + (R_rise @ moved[..., None])[..., 0])[..., None])[..., 0]
        return held

    origin, ankle = R @ up, on_foot_at(person.ankle_P_m)
    force, moment = np.zeros((*shape, 3)), np.zeros((*shape, 3))
    for mass_kg, c, J, turned in (
        (PLATE.mass_kg, R @ (up + PLATE.cog_m), PLATE.inertia_kgm2, R),
        (person.foot_kg, on_foot_at(person.foot_cog_P_m), person.foot_kgm2, R_foot),
    ):
        spun = np.einsum("...ij,jk,...lk,...l->...i", turned, J, turned, _spin(turned, dt))
        load = mass_kg * (derivative(derivative(c, dt), dt) - GRAVITY_I_MPS2)
        force += load
        moment += np.cross(c - origin, load) + derivative(spun, dt)
    shank = -push - person.leg_kg * derivative(derivative(ankle, dt), dt)
    shank_moment = np.stack((on_foot[..., 1], np.zeros(shape), on_foot[..., 0]), axis=-1)
    force -= shank
    moment -= np.cross(ankle - origin, shank) + np.einsum("...ij,...j->...i", R, shank_moment)
    into_P = np.swapaxes(R, -1, -2)
    tare_n = -PLATE.mass_kg * GRAVITY_I_MPS2
    tare_nm = np.cross(PLATE.cog_m, tare_n)
    return np.concatenate(
        ((into_P @ force[..., None])[..., 0] - tare_n, (into_P @ moment[..., None])[..., 0] - tare_nm), axis=-1
    )


def _rotation(turned: FloatArray) -> FloatArray:
    """Return the rotations (c, n, 3, 3) by angles (c, n, 2) about Z and X."""
    R: FloatArray = Rotation.from_euler("ZX", turned.reshape(-1, 2)).as_matrix().reshape(*turned.shape[:2], 3, 3)
    return R


def _spin(R: FloatArray, dt: float) -> FloatArray:
    """Return the angular velocity (c, n, 3) in I."""
    spin = derivative(R.reshape(*R.shape[:2], 9), dt).reshape(R.shape) @ np.swapaxes(R, -1, -2)
    return np.stack((spin[..., 2, 1], spin[..., 0, 2], spin[..., 1, 0]), axis=-1)


def moments_about(A: FloatArray, mass_kg: float, cog: FloatArray, J: FloatArray) -> FloatArray:
    """Return a body's moments of inertia (2,) about Z and X through A."""
    x, y, z = cog - A
    moments: FloatArray = np.array([J[2, 2] + mass_kg * (x * x + y * y), J[0, 0] + mass_kg * (y * y + z * z)])
    return moments


def derivative(values: FloatArray, dt: float) -> FloatArray:
    """Return the time derivative along axis 1 by central differences of eighth order; ends count as at rest."""
    rate = np.zeros_like(values)
    for reach, weight in enumerate((4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0), start=1):
        ahead, behind = values[:, 4 + reach : values.shape[1] - 4 + reach], values[:, 4 - reach : -4 - reach]
        rate[:, 4:-4] += weight * (ahead - behind)
    derivative: FloatArray = rate / dt
    return derivative
