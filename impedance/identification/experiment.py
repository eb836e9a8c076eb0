"""Excitation that tells most of the moment about the vertical, which the universal joint hides.

The plate never turns about its own y freely: with ψ = 0, and θ, φ small,

    ω_y = θ̇ sin φ,   α_y = θ̈ sin φ + θ̇ φ̇ cos φ                                                                   (1)

so J_yy enters the moment T_y = J_yy α_y + … only in second order. Even with all else known, n samples of moment noise
σ_T leave

    σ(J_yy) ≥ σ_T / (√n rms α_y)                                                                                  (2)

and within the limits of the motion |α_y| ≤ |θ̈| sin |φ| + |θ̇ φ̇|: no excitation can do better, so (2) with this
greatest α_y is the proof of what the joint cannot. A design is two multisines over one period: one axis swings slowly
and far, the other as fast as its acceleration lets it; from there their lines' amplitudes and phases are moved to the
greatest rms α_y, scaled to the first limit that they meet. The Cramér-Rao bound with all ten unknown is then computed
in full.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from impedance.identification.eiv import NoiseModel
from impedance.identification.mechanism import UniversalJoint
from impedance.identification.observability import about_cog, about_cog_slope
from messages.arrays import ComplexArray, FloatArray, rms
from messages.constants import NORMAL_95

_JYY = 5
RATE_HZ = 350.0
PERIOD_S = 4.0
_LINES = 7
_ITERATIONS = 30
_STIRRED = 0.02
_SHARPNESS = 24.0


@dataclass(frozen=True)
class MotionLimits:
    """The greatest angle, rate and acceleration of either axis, and the band of the lines."""

    angle_rad: float
    rate_radps: float
    acceleration_radps2: float
    lowest_hz: float = 0.5
    highest_hz: float = 25.0


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of one sample: angles, forces and moments."""

    angle_rad: float
    force_n: float
    torque_nm: float


@dataclass(frozen=True)
class Multisine:
    """θ and φ as sums of lines: `f_hz` (k,), complex amplitudes (2, k) of θ and φ, q = Re Σ A exp(2πj f t)."""

    period_s: float
    f_hz: FloatArray
    amplitude_rad: ComplexArray

    def motion(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the coordinates (n, 2) with first and second derivative at `t_s` (n,)."""
        return _motion(self.amplitude_rad, np.exp(2j * np.pi * t_s[:, None] * self.f_hz), self.f_hz)


@dataclass(frozen=True)
class Design:
    """An excitation with the information (10, 10) about π that a second of it gives."""

    excitation: Multisine
    information_per_s: FloatArray
    alpha_y_rms_radps2: float


def seconds_for(information_per_s: FloatArray, vector: FloatArray, share: float, parameter: int = _JYY) -> float:
    """Return the least time after which the 95 % interval of one of η is within ± `share` of its value."""
    slope = about_cog_slope(vector)[parameter]
    variance_s = float(slope @ np.linalg.solve(information_per_s, slope))
    return variance_s * (NORMAL_95 / (share * float(about_cog(vector)[parameter]))) ** 2


def information_per_second(
    excitation: Multisine, vector: FloatArray, rest: FloatArray, joint: UniversalJoint, noise: SensorNoise
) -> tuple[FloatArray, float]:
    """Return the information (10, 10) of a body (10,) per second of a periodic motion, and the rms of α_y, rad/s².

    `rest` (6, 10) are the columns that the tare took away: those of the level plate, or zeros.
    """
    n = round(excitation.period_s * RATE_HZ)
    motion = joint.kinematics(*excitation.motion(np.arange(n) / RATE_HZ))
    columns = motion.regressor - rest
    f_hz = np.asarray(np.fft.rfftfreq(n, 1.0 / RATE_HZ), dtype=np.float64)
    D = np.fft.rfft(columns, axis=0)
    model = NoiseModel(joint, noise.angle_rad**2 * np.eye(2), np.repeat((noise.force_n, noise.torque_nm), 3))
    root = model.weights(f_hz, vector, np.eye(6))[0] * np.sqrt(np.where(f_hz == 0.0, 1.0, 2.0) / n)[:, None, None]
    whitened = (root @ D).reshape(-1, 10)
    information = (whitened.conj().T @ whitened).real / excitation.period_s
    return information, rms(motion.alpha[:, 1])


def designed(
    limits: MotionLimits, vector: FloatArray, rest: FloatArray, joint: UniversalJoint, noise: SensorNoise, seed: int
) -> Design:
    """Return the multisine, periodic in four seconds, that tells most of a body's J_yy; `seed` draws the starts."""
    rng = np.random.default_rng(seed)
    lines = np.unique(np.round(np.geomspace(limits.lowest_hz * PERIOD_S, limits.highest_hz * PERIOD_S, _LINES)))
    quickest_hz = np.sqrt(limits.acceleration_radps2 / limits.angle_rad) / (2.0 * np.pi)
    f_hz = np.union1d(lines, [round(min(quickest_hz, limits.highest_hz) * PERIOD_S)]) / PERIOD_S
    wave = np.exp(2j * np.pi * _one_period()[:, None] * f_hz)
    best: Design | None = None
    for slow in (0, 1):
        shape = _STIRRED * rng.normal(size=(2, 2, len(f_hz)))
        shape[slow, 0, 0] += 1.0
        shape[1 - slow, 0, np.argmin(np.abs(f_hz - quickest_hz))] += 1.0
        found = minimize(
            _poverty, shape.reshape(-1), (wave, f_hz, limits), method="L-BFGS-B", options={"maxiter": _ITERATIONS}
        )
        excitation = Multisine(PERIOD_S, f_hz, _scaled(found.x, wave, f_hz, limits, sharpness=np.inf))
        design = Design(excitation, *information_per_second(excitation, vector, rest, joint, noise))
        if best is None or design.alpha_y_rms_radps2 > best.alpha_y_rms_radps2:
            best = design
    assert best is not None
    return best


def greatest_alpha_y(limits: MotionLimits) -> float:
    """Return what |α_y| of (1) cannot exceed within the limits, rad/s².

    Lines up to f let a motion within ± A be no faster than 2πf A, nor accelerate more than (2πf)² A (Bernstein).
    """
    w = 2.0 * np.pi * limits.highest_hz
    rate = min(limits.rate_radps, w * limits.angle_rad)
    acceleration = min(limits.acceleration_radps2, w**2 * limits.angle_rad)
    return float(acceleration * np.sin(limits.angle_rad) + rate**2)


def least_seconds(alpha_y_radps2: float, J_yy_kgm2: float, torque_nm: float, rate_hz: float, share: float) -> float:
    """Return by (2) the time before which no 95 % interval of J_yy is within ± `share`, the rms of α_y being given."""
    return float((NORMAL_95 * torque_nm / (share * J_yy_kgm2 * alpha_y_radps2)) ** 2 / rate_hz)


def _poverty(shape: FloatArray, wave: ComplexArray, f_hz: FloatArray, limits: MotionLimits) -> float:
    """Return −log of the mean square of α_y, by (1)."""
    angle, rate, acceleration = _motion(_scaled(shape, wave, f_hz, limits, _SHARPNESS), wave, f_hz)
    phi = angle[:, 1]
    alpha_y = acceleration[:, 0] * np.sin(phi) + rate[:, 0] * rate[:, 1] * np.cos(phi)
    return -float(np.log(np.mean(alpha_y**2)))


def _scaled(
    shape: FloatArray, wave: ComplexArray, f_hz: FloatArray, limits: MotionLimits, sharpness: float
) -> ComplexArray:
    """Return the amplitudes (2, k) of real and imaginary parts `shape` (2 · 2 · k,), which weigh as 1 / f.

    Each axis is scaled to the first limit that it meets; the maximum over time is a norm of `sharpness`.
    """
    parts = shape.reshape(2, 2, -1)
    amplitude: ComplexArray = np.asarray((parts[:, 0] + 1j * parts[:, 1]) / f_hz, dtype=np.complex128)
    of_all = 1.0 if np.isinf(sharpness) else len(wave) ** (-1.0 / sharpness)
    allowed = (limits.angle_rad, limits.rate_radps, limits.acceleration_radps2)
    used = [
        of_all * np.linalg.norm(part / limit, ord=sharpness, axis=0)
        for part, limit in zip(_motion(amplitude, wave, f_hz), allowed, strict=True)
    ]
    scaled: ComplexArray = amplitude / np.max(used, axis=0)[:, None]
    return scaled


def _motion(
    amplitude_rad: ComplexArray, wave: ComplexArray, f_hz: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return Re Σ A exp(2πj f t) (n, 2) and two derivatives."""
    jw = 2j * np.pi * f_hz
    value: FloatArray = (wave @ amplitude_rad.T).real
    rate: FloatArray = (wave @ (amplitude_rad * jw).T).real
    acceleration: FloatArray = (wave @ (amplitude_rad * jw**2).T).real
    return value, rate, acceleration


def _one_period() -> FloatArray:
    return np.arange(round(PERIOD_S * RATE_HZ)) / RATE_HZ
