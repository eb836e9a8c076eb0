"""Smooth derivatives of what was sampled: without phase, exact up to one frequency, blind above another."""

from functools import cache
from typing import Final

import numpy as np

from messages.arrays import FloatArray

PLATE_BAND_HZ: Final = (42.0, 65.0)
"""What passes whole and what is stopped of the plate's motion."""

SHANK_BAND_HZ: Final = (12.0, 30.0)
"""The same of the shank's, which is slower and measured worse."""

_HALF_S: Final = 0.06
_STOP_WEIGHT: Final = 1e-3


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
