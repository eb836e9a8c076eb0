"""The signal processing of the thesis's study of the platform: a windowed low pass and interpolating derivatives.

Both filters have an odd number of taps symmetric (or antisymmetric) about the middle one, so their delay is a whole
number of samples on every channel alike. The samples at the ends that lack a full window are left out instead of being
made up, and the value returned at a time is the one centred on it: no delay is left, between channels or against time.
"""

from typing import Final

from scipy.signal import fftconvolve, firwin, savgol_coeffs

from messages.arrays import FloatArray

LOW_PASS_CUTOFF_HZ: Final = 40.0
LOW_PASS_ORDER: Final = 100
DERIVATIVE_POINTS: Final = 13
DERIVATIVE_ORDER: Final = 12

LOW_PASS_LOST: Final = LOW_PASS_ORDER // 2  # samples left out at each end
DERIVATIVE_LOST: Final = DERIVATIVE_POINTS // 2


def low_pass_taps(rate_hz: float) -> FloatArray:
    """Return the 101 taps of the 40 Hz low pass: 100th order, Hann window, unit gain at rest.

    Raises ValueError where 40 Hz is not below half of `rate_hz`.
    """
    taps: FloatArray = firwin(LOW_PASS_ORDER + 1, LOW_PASS_CUTOFF_HZ, window="hann", fs=rate_hz)
    return taps


def derivative_taps(rate_hz: float, derivative: int) -> FloatArray:
    """Return the 13 taps of Savitzky and Golay's derivative (0, 1 or 2), for convolution.

    A 12th-order polynomial through 13 points passes through all of them: the 0th derivative is the sample itself.
    """
    taps: FloatArray = savgol_coeffs(DERIVATIVE_POINTS, DERIVATIVE_ORDER, deriv=derivative, delta=1.0 / rate_hz)
    return taps


def low_passed(samples: FloatArray, rate_hz: float) -> FloatArray:
    """Return `samples` (n, k) below 40 Hz, (n − 100, k): row i belongs to the time of row i + 50."""
    return _convolved(samples, low_pass_taps(rate_hz))


def derivatives(samples: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return `samples` (n, k) and their first and second derivative in time, (n − 12, k) each.

    Row i belongs to the time of row i + 6.
    """
    about_mean = samples - samples.mean(axis=0)  # the taps' sum is zero but for rounding
    first, second = (_convolved(about_mean, derivative_taps(rate_hz, order)) for order in (1, 2))
    return samples[DERIVATIVE_LOST:-DERIVATIVE_LOST], first, second


def _convolved(samples: FloatArray, taps: FloatArray) -> FloatArray:
    if len(samples) < len(taps):
        raise ValueError(f"{len(samples)} samples, but a filter of {len(taps)} taps needs as many")
    convolved: FloatArray = fftconvolve(samples, taps[:, None], mode="valid", axes=0)
    return convolved
