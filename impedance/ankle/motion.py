"""From a trial's samples to what the ankle's equations need: smooth motion, and the moment about the ankle.

The sensor and the shank hold plate and foot, rigid in P while the foot is flat. About the ankle's centre A, in P:

    M_A = T − r × f = Y_T(motion) π − M_shank − δr × f_shank,   f_shank = Y_f(motion) π − f                       (1)

r is A in P as told, δr its error, π the ten parameters of plate plus foot about A, and Y the regressor of a rigid body.
"""

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline

from impedance.ankle.trial import AnkleTrial, BodyPrior, Perturbation, TrialSettings, in_flat_foot
from impedance.body.geometry import GRAVITY_I_MPS2, angular_acceleration, angular_velocity, rotation_IP
from impedance.body.rigid_body import Inertia, regressor
from impedance.identification.propagation import propagated
from messages.arrays import FloatArray, IntArray

PLATE_BAND_HZ: Final = (42.0, 65.0)
"""What passes whole and what is stopped of the plate's motion."""

SHANK_BAND_HZ: Final = (12.0, 30.0)
"""The same of the shank's, which is slower and measured worse."""

REFLEX_FROM_S: Final = 0.095
"""After a muscle is stretched its reflex begins to turn the ankle."""

_HALF_S: Final = 0.06
_STOP_WEIGHT: Final = 1e-3


@dataclass(frozen=True)
class Bodies:
    """Parameters (10,) about A, along P, of plate and of foot, and the covariance (10, 10) of each."""

    plate: FloatArray
    foot: FloatArray
    plate_covariance: FloatArray
    foot_covariance: FloatArray

    @property
    def root(self) -> FloatArray:
        """Return S (10, 10) with S Sᵀ the covariance of both bodies' sum."""
        values, vectors = np.linalg.eigh(self.plate_covariance + self.foot_covariance)
        root: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))
        return root


@dataclass(frozen=True)
class AnkleMotion:
    """n samples with the foot flat; `rows` (n,) are their places in the trial.

    `plate`, `shank` (3, n, 2): angle, rate and acceleration about Z and X; `all_rates` (N, 2) the plate's rates at all
    samples of the trial; `moment` (n, 2): M_A of (1) about Z and X minus what the expected bodies need;
    `body_columns` (n, 2, 10) of one standard deviation each of π; `lever_columns` (n, 2, 3) of δr;
    `gain_columns` and `delay_columns` (n, 2) of the wrench's gain and of its delay beyond the one stated, which is
    taken out.
    """

    rows: IntArray
    plate: FloatArray
    shank: FloatArray
    all_rates: FloatArray
    moment: FloatArray
    body_columns: FloatArray
    lever_columns: FloatArray
    gain_columns: FloatArray
    delay_columns: FloatArray


def bodies_of(settings: TrialSettings) -> Bodies:
    """Return the bodies' parameters about A, their covariances by linear propagation."""
    A = np.array(settings.ankle.in_plate_m)
    (plate, plate_covariance), (foot, foot_covariance) = (_about(A, each) for each in (settings.plate, settings.foot))
    return Bodies(plate, foot, plate_covariance, foot_covariance)


def motion_of(trial: AnkleTrial, bodies: Bodies) -> AnkleMotion:
    """Return the motion and moments of (1) with the foot flat."""
    settings = trial.settings
    plate, shank = np.empty((3, len(trial.t_s), 2)), np.empty((3, len(trial.t_s), 2))
    for cycle in range(len(trial.perturbation)):
        own = trial.rows_of(cycle)
        plate[:, own] = smooth_derivatives(trial.plate_rad[own], settings.rate_hz, PLATE_BAND_HZ)
        shank[:, own] = smooth_derivatives(trial.shank_rad[own], settings.rate_hz, SHANK_BAND_HZ)
    rows = np.flatnonzero(in_flat_foot(trial))
    all_rates = plate[1]
    A = np.array(settings.ankle.in_plate_m)
    instruments = settings.instruments
    all_wrench, measured_rate = np.empty_like(trial.wrench), np.empty((len(trial.t_s), 2))
    axes = [2, 0]
    for cycle in range(len(trial.perturbation)):
        own = trial.rows_of(cycle)
        later, rate = _later(trial, cycle)
        all_wrench[own] = trial.wrench[own] + later
        measured_rate[own] = (rate[:, 3:] - np.cross(A, rate[:, :3]))[:, axes]
    plate, shank, wrench = plate[:, rows], shank[:, rows], all_wrench[rows]
    Y = regressor(*_motion_of_A(plate, settings.joint_to_surface_m, A))
    tared = level_rest(A)
    need = Y @ (bodies.plate + bodies.foot) - tared @ bodies.plate
    moment = wrench[:, 3:] - np.cross(A, wrench[:, :3]) - need[:, 3:]
    f_shank = need[:, :3] - wrench[:, :3]
    levers = -np.cross(np.eye(3)[:, None], f_shank).transpose(1, 2, 0)  # −e × f_shank, (n, axis, e)
    whole = wrench[:, 3:] - np.cross(A, wrench[:, :3])
    return AnkleMotion(
        rows=rows,
        plate=plate,
        shank=shank,
        all_rates=all_rates,
        moment=moment[:, axes],
        body_columns=(Y @ bodies.root)[:, 3:][:, axes],
        lever_columns=settings.ankle.deviation_m * levers[:, axes],
        gain_columns=instruments.gain_deviation_share * whole[:, axes],
        delay_columns=-instruments.delay_deviation_s * measured_rate[rows],
    )


def _later(trial: AnkleTrial, cycle: int) -> tuple[FloatArray, FloatArray]:
    """Return by what a cycle's wrench (n, 6) differs the stated delay later, and its rate (n, 6), both smooth.

    Of a ramp's cycle nothing from the reflex on reaches before it.
    """
    own = trial.rows_of(cycle)
    t_s, wrench = trial.t_s[own], trial.wrench[own]
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


def level_rest(A: FloatArray) -> FloatArray:
    """Return Y⁰ (6, 10) about A of a body that rests on the level plate: what the tare took of the plate."""
    rest = np.zeros((1, 3))
    Y: FloatArray = regressor(rest, GRAVITY_I_MPS2[None], rest, rest)[0]
    return Y


def smooth_derivatives(values: FloatArray, rate_hz: float, band_hz: tuple[float, float]) -> FloatArray:
    """Return values (n, k), their first and second derivatives (3, n, k), without phase: exact up to `band_hz[0]`,
    nothing above `band_hz[1]`. Beyond both ends the values count as a straight line.
    """
    half = round(_HALF_S * rate_hz)
    slope = (values[-1] - values[-2], values[0] - values[1])
    steps = np.arange(1, half + 1)[:, None]
    padded = np.vstack((values[0] + steps[::-1] * slope[1], values, values[-1] + steps * slope[0]))
    kernels = _kernels(rate_hz, half, band_hz)
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=0)
    derivatives: FloatArray = np.einsum("nkw,dw->dnk", windows, kernels)
    return derivatives


@cache
def _kernels(rate_hz: float, half: int, band_hz: tuple[float, float]) -> FloatArray:
    """Return (3, 2 half + 1): weights of the samples that give the value and two derivatives, by least squares in
    frequency: (jω)^d in the pass band, 0 in the stop band.
    """
    taps = np.arange(-half, half + 1) / rate_hz
    stop_hz = min(band_hz[1], 0.45 * rate_hz)
    passed = 2.0 * np.pi * np.linspace(0.0, min(band_hz[0], 0.8 * stop_hz), 4 * half)
    stopped = 2.0 * np.pi * np.linspace(stop_hz, 0.5 * rate_hz, 8 * half)
    w = np.concatenate((passed, stopped))
    weight = np.concatenate((np.ones(len(passed)), np.full(len(stopped), _STOP_WEIGHT)))
    kernels = np.empty((3, len(taps)))
    for order in range(3):
        phase = np.cos if order % 2 == 0 else np.sin
        sign = -1.0 if order == 2 else 1.0
        target = np.where(w <= passed[-1], sign * w**order, 0.0) * weight
        scale = passed[-1] ** order
        kernels[order] = (
            scale * np.linalg.lstsq(weight[:, None] * phase(np.outer(w, taps)), target / scale, rcond=1e-9)[0]
        )
    return kernels


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
