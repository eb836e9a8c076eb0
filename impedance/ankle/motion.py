"""From a trial's samples to what the ankle's equations need: smooth motion, and the moment about the ankle.

The sensor and the shank hold plate and foot, the foot flat. About where the ankle's centre A was measured, in P:

    M = T − r × f = (Y_P − Y⁰) π_P + Y_F π_F − M_shank − (s + δr) × f_shank,   f_shank = (…)_f − f                (1)

r is A in P as told, δr its error, s = e × (A − C) by how much shoe and heel pad have moved it, where the foot has
turned by e about C; π_P, π_F are the ten parameters of plate and foot about A, Y the regressor of a rigid body in its
own motion, and Y⁰ that of a level one at rest, for the tare took the plate's weight.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline

from impedance.ankle.smoothing import PLATE_BAND_HZ, SHANK_BAND_HZ, smooth_derivatives
from impedance.ankle.trial import AnkleTrial, BodyPrior, Contact, Perturbation, TrialSettings, in_flat_foot
from impedance.ankle.turns import own_turns, slip_of
from impedance.body.geometry import GRAVITY_I_MPS2, angular_acceleration, angular_velocity, rotation_IP
from impedance.body.rigid_body import Inertia, regressor
from impedance.identification.considered import root_of
from impedance.identification.mechanism import level_rest
from impedance.identification.propagation import propagated
from messages.arrays import FloatArray, IntArray

REFLEX_FROM_S: Final = 0.095
"""After a muscle is stretched its reflex begins to turn the ankle."""


@dataclass(frozen=True)
class Bodies:
    """Parameters (10,) about A, along P, of plate and of foot, and the covariance (10, 10) of each."""

    plate: FloatArray
    foot: FloatArray
    plate_covariance: FloatArray
    foot_covariance: FloatArray

    @property
    def roots(self) -> tuple[FloatArray, FloatArray]:
        """Return S (10, 10) of plate and foot with S Sᵀ the covariance."""
        return root_of(self.plate_covariance), root_of(self.foot_covariance)


@dataclass(frozen=True)
class AnkleMotion:
    """n samples with the foot flat; `rows` (n,) are their places in the trial.

    `turns` (2, n, 2): x and ẋ, the ankle's turn away from its own course and the rate, about Z and X; `angle_rad`
    (n, 2) is that of foot against shank; `all_rates` (N, 2) the plate's rates at all samples of the trial; `moment`
    (n, 2): −M_shank of (1) about Z and X with the expected bodies; `plate_columns`, `foot_columns` (n, 2, 10) of one
    standard deviation each of π_P and π_F; `lever_columns` and `contact_columns` (n, 2, 3) of δr and of the error of C;
    `gain_columns`, `crosstalk_columns` and `delay_columns` (n, 2) of the wrench's gain, of what one moment makes of the
    other, and of its delay beyond the one stated, which is taken out.
    """

    rows: IntArray
    turns: FloatArray
    angle_rad: FloatArray
    all_rates: FloatArray
    moment: FloatArray
    plate_columns: FloatArray
    foot_columns: FloatArray
    lever_columns: FloatArray
    contact_columns: FloatArray
    gain_columns: FloatArray
    crosstalk_columns: FloatArray
    delay_columns: FloatArray


def bodies_of(settings: TrialSettings) -> Bodies:
    """Return the bodies' parameters about A, their covariances by linear propagation."""
    A = np.array(settings.ankle.in_plate_m)
    (plate, plate_covariance), (foot, foot_covariance) = (_about(A, each) for each in (settings.plate, settings.foot))
    return Bodies(plate, foot, plate_covariance, foot_covariance)


def motion_of(trial: AnkleTrial, bodies: Bodies, noise_nm: FloatArray | None = None) -> AnkleMotion:
    """Return the motion and moments of (1) with the foot flat.

    `noise_nm` (n, 2) is what is known of the noise in the trial's moments about A. The stated delay is taken out, and
    more of it looked for, by the rate of the wrench without it: noise in both would draw the delay to zero.
    """
    settings = trial.settings
    clean = trial.wrench.copy()
    if noise_nm is not None:
        clean[:, [5, 3]] -= noise_nm
    plate, shank = np.empty((3, len(trial.t_s), 2)), np.empty((3, len(trial.t_s), 2))
    for cycle in range(len(trial.perturbation)):
        own = trial.rows_of(cycle)
        plate[:, own] = smooth_derivatives(trial.plate_rad[own], settings.rate_hz, PLATE_BAND_HZ)
        shank[:, own] = smooth_derivatives(trial.shank_rad[own], settings.rate_hz, SHANK_BAND_HZ)
    rows = np.flatnonzero(in_flat_foot(trial))
    all_rates = plate[1]
    slip = slip_of(trial, plate, rows)
    A = np.array(settings.ankle.in_plate_m)
    contact = settings.contact or Contact((float(A[0]), 0.0, float(A[2])))
    C = np.array(contact.in_plate_m)
    instruments = settings.instruments
    all_wrench, measured_rate = np.empty_like(trial.wrench), np.empty((len(trial.t_s), 2))
    axes = [2, 0]
    for cycle in range(len(trial.perturbation)):
        own = trial.rows_of(cycle)
        later, rate = _later(trial, clean, cycle)
        all_wrench[own] = trial.wrench[own] + later
        moved = trial.perturbation[cycle] is not Perturbation.NONE  # without it the rate is noise, which dims the delay
        measured_rate[own] = (rate[:, 3:] - np.cross(A, rate[:, :3]))[:, axes] if moved else 0.0
    plate, shank, wrench = plate[:, rows], shank[:, rows], all_wrench[rows]
    turned, given = _vector(slip.angle), _vector(slip.answer[2])
    L_m = settings.joint_to_surface_m
    Y_plate = regressor(*_motion_of_A(plate, L_m, A)) - level_rest()
    foot = plate + np.concatenate((slip.angle[None], slip.answer[1:]))
    _, *turning = _motion_of_A(foot, L_m, A)
    Y_foot = regressor(_motion_of_A(plate, L_m, A)[0] + np.cross(given, A - C), *turning)
    need = Y_plate @ bodies.plate + Y_foot @ bodies.foot
    whole = wrench[:, 3:] - np.cross(A, wrench[:, :3])
    f_shank = need[:, :3] - wrench[:, :3]
    moment = whole - need[:, 3:] + np.cross(np.cross(turned, A - C), f_shank)
    units = np.eye(3)[:, None]
    levers = -np.cross(units, f_shank).transpose(1, 2, 0)  # −e × f_shank, (n, axis, e)
    contacts = np.cross(np.cross(turned, units), f_shank).transpose(1, 2, 0)
    roots = bodies.roots
    seen_rad = trial.plate_rad if trial.foot_rad is None else trial.foot_rad
    return AnkleMotion(
        rows=rows,
        turns=own_turns(trial, rows, plate, shank[0], slip),
        angle_rad=(seen_rad - trial.shank_rad)[rows],
        all_rates=all_rates,
        moment=moment[:, axes],
        plate_columns=(Y_plate @ roots[0])[:, 3:][:, axes],
        foot_columns=(Y_foot @ roots[1])[:, 3:][:, axes],
        lever_columns=settings.ankle.deviation_m * levers[:, axes],
        contact_columns=contact.deviation_m * contacts[:, axes],
        gain_columns=instruments.gain_deviation_share * whole[:, axes],
        crosstalk_columns=instruments.crosstalk_deviation_share * whole[:, axes[::-1]],
        delay_columns=-instruments.delay_deviation_s * measured_rate[rows],
    )


def _vector(about_z_and_x: FloatArray) -> FloatArray:
    """Return a small turn (n, 2) about Z and X as a vector (n, 3)."""
    vector = np.zeros((len(about_z_and_x), 3))
    vector[:, [2, 0]] = about_z_and_x
    return vector


def _later(trial: AnkleTrial, wrench: FloatArray, cycle: int) -> tuple[FloatArray, FloatArray]:
    """Return by what the trial's `wrench` differs in a cycle the stated delay later, and its rate (n, 6), both smooth.

    Of a ramp's cycle nothing from the reflex on reaches before it.
    """
    own = trial.rows_of(cycle)
    t_s, wrench = trial.t_s[own], wrench[own]
    ramp = trial.perturbation[cycle] is Perturbation.RAMP
    reflex_s = trial.onset_s[cycle] + REFLEX_FROM_S if ramp else np.inf
    later, rate = np.zeros_like(wrench), np.zeros_like(wrench)
    cut = int(np.searchsorted(t_s, reflex_s))
    for part in (slice(0, cut), slice(cut, len(t_s))):
        if part.stop - part.start > 3:
            slow, rate[part], _ = smooth_derivatives(wrench[part], trial.settings.rate_hz, PLATE_BAND_HZ)
            at_s = np.clip(t_s[part] + trial.settings.instruments.delay_s, t_s[part][0], t_s[part][-1])
            later[part] = CubicSpline(t_s[part], slow)(at_s) - slow
    return later, rate


def _motion_of_A(
    plate: FloatArray, joint_to_surface_m: float, A: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return a_A, g, ω and α in P (n, 3) of the universal joint with θ, φ and derivatives in `plate` (3, n, 2)."""
    euler, first, second = np.concatenate((np.zeros((*plate.shape[:2], 1)), plate), axis=2)
    w = angular_velocity(euler, first)
    alpha = angular_acceleration(euler, first, second)
    r = A + np.array([0.0, joint_to_surface_m, 0.0])
    a_A = np.cross(alpha, r) + np.cross(w, np.cross(w, r))
    return a_A, GRAVITY_I_MPS2 @ rotation_IP(*euler.T), w, alpha


def _about(A: FloatArray, body: BodyPrior) -> tuple[FloatArray, FloatArray]:
    """Return a body's parameters (10,) about A and their covariance, from those about its centre of gravity."""
    told = np.array([body.mass_kg, *body.cog_m, *body.inertia_kgm2])
    deviation = np.array([body.mass_deviation_kg, *body.cog_deviation_m, *body.inertia_deviation_kgm2])
    found = propagated(lambda x: Inertia.about(x[0], x[1:4] - A, x[4:]).vector, told, deviation)
    return found.value, found.covariance
