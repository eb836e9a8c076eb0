"""Inertia from periods: a body swung as a compound pendulum or on a torsion bar whose stiffness a known rod tells.

    compound  I = (T / 2π)² m g l − m l²                                                                          (1)
    torsion   I = I_rod (T / T_rod)²,   I_rod = m l² / 12 + m r² / 4                                              (2)

A body symmetric about its xz plane, hung on the bar in several orientations β of that plane, shows the moments

    I(β) = I_xx cos²β − 2 I_xz sin β cos β + I_zz sin²β                                                           (3)

and its centre of gravity lies each time straight below the bar, at the signed distance a from a reference point:

    x sin β + z cos β = −a                                                                                        (4)

(3) and (4) are solved by least squares; `propagation` carries errors through. Source: Kooijman, "Experimental
validation of a model for the motion of an uncontrolled bicycle", MSc thesis, Delft 2006; Moore, Hubbard, Schwab and
Kooijman, "Accurate measurement of bicycle parameters", Bicycle and Motorcycle Dynamics 2010.
"""

import numpy as np

from messages.arrays import FloatArray

_PEAK_SAMPLES = 8
_NEWTON_STEPS = 50


def compound_inertia(period_s: float, mass_kg: float, length_m: float, gravity_mps2: float) -> float:
    """Return (1): the moment about the centre of gravity, `length_m` below the axis."""
    return (period_s / (2.0 * np.pi)) ** 2 * mass_kg * gravity_mps2 * length_m - mass_kg * length_m**2


def rod_inertia(mass_kg: float, length_m: float, radius_m: float) -> float:
    """Return I_rod of (2), about an axis through the middle of a solid rod and across it."""
    return mass_kg * length_m**2 / 12.0 + mass_kg * radius_m**2 / 4.0


def torsional_inertia(period_s: FloatArray, rod_period_s: float, rod_kgm2: float) -> FloatArray:
    """Return I (n,) of (2) about the bar's axis."""
    inertia: FloatArray = rod_kgm2 * (period_s / rod_period_s) ** 2
    return inertia


def planar_tensor(beta_rad: FloatArray, moments_kgm2: FloatArray) -> FloatArray:
    """Return (I_xx, I_xz, I_zz) of (3) of n ≥ 3 orientations (n,); raises ValueError where they do not determine it."""
    sin, cos = np.sin(beta_rad), np.cos(beta_rad)
    return _least_squares(np.column_stack((cos**2, -2.0 * sin * cos, sin**2)), moments_kgm2)


def centre_of_lines(beta_rad: FloatArray, distance_m: FloatArray) -> FloatArray:
    """Return (x, z) of (4) of n ≥ 2 orientations (n,); raises ValueError where they do not determine it."""
    return _least_squares(np.column_stack((np.sin(beta_rad), np.cos(beta_rad))), -distance_m)


def centre_of_pairs(beta_rad: FloatArray, distance_m: FloatArray) -> FloatArray:
    """Return (x, z): the mean of the points where every two of the lines (4) meet, the published evaluation.

    Lines that nearly coincide weigh as much as others, so `centre_of_lines` is the better estimate.
    """
    pairs = [[i, j] for i in range(len(beta_rad)) for j in range(i)]
    crossings = np.array([centre_of_lines(beta_rad[pair], distance_m[pair]) for pair in pairs])
    return np.asarray(crossings.mean(axis=0), dtype=np.float64)


def period_of(signal: FloatArray, rate_hz: float) -> tuple[float, float]:
    """Return the period of a decaying oscillation (n,) and its standard deviation, s.

    Least squares of offset plus a decaying sine, from the peak of the spectrum on; the residual counts as white. Raises
    ValueError where the signal holds fewer than two periods.
    """
    t = np.arange(len(signal)) / rate_hz
    spectrum = np.abs(np.fft.rfft((signal - signal.mean()) * np.hanning(len(signal)), _PEAK_SAMPLES * len(signal)))
    frequency = float(np.argmax(spectrum)) * rate_hz / (_PEAK_SAMPLES * len(signal))
    if frequency * t[-1] < 2.0:
        raise ValueError("the signal holds fewer than two periods")
    w, decay = 2.0 * np.pi * frequency, 1.0 / t[-1]
    for _ in range(_NEWTON_STEPS):
        envelope = np.exp(-decay * t)
        sine, cosine = envelope * np.sin(w * t), envelope * np.cos(w * t)
        shapes = np.column_stack((sine, cosine, np.ones(len(t))))
        p, q, _offset = np.linalg.lstsq(shapes, signal)[0]
        model = shapes @ np.linalg.lstsq(shapes, signal)[0]
        slopes = np.column_stack((shapes, t * (p * cosine - q * sine), -t * (p * sine + q * cosine)))
        step = np.linalg.lstsq(slopes, signal - model)[0]
        w, decay = w + float(step[3]), decay + float(step[4])
        if abs(step[3]) < 1e-12 * w:
            break
    variance = float(((signal - model) ** 2).sum()) / (len(t) - 5)
    deviation = np.sqrt(variance * np.linalg.inv(slopes.T @ slopes)[3, 3])
    return 2.0 * np.pi / w, float(2.0 * np.pi / w**2 * deviation)


def _least_squares(columns: FloatArray, values: FloatArray) -> FloatArray:
    solution, _, rank, _ = np.linalg.lstsq(columns, values, rcond=1e-6)
    if rank < columns.shape[1]:
        raise ValueError(f"{len(values)} orientations do not determine {columns.shape[1]} numbers")
    return np.asarray(solution, dtype=np.float64)
