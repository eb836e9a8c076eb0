"""What a smear does to the steepness of a picture, from how the picture differs from itself: no texture is assumed.

With D(s) = E (f(x + s) − f(x))² of a picture f whose texture looks alike in all directions, a smear over L px leaves of
the mean square slope along itself, and of that across itself,

    a(L) = D(l) / (l² D(1)),  l² = 1 + L²,          b(L) = ∫₀¹ 2 (1 − τ) G(τ L) dτ / G(0),  G(s) = D'(s) / 2 s       (1)

because the slope of a running mean is a difference of ends, and G is the slope's own correlation along the smear. D is
measured across the picture, which a walker's smear, downwards, hardly alters.
"""

import numpy as np
from scipy.interpolate import PchipInterpolator

from messages.arrays import FloatArray

_STEP_PX, _MOST_PX = 0.25, 20.0
"""Smears for which (1) is tabulated: it is smooth in between, and a longer smear leaves hardly any slope to compare."""
_SHORTEST_PX = 0.25
"""Within a pixel a picture is smooth: from here on D grows as s², and G is its value at zero."""
_TERMS = 16
"""Of the integral over τ in (1), by the midpoint rule."""
_LEAST_ACROSS = 1e-6
"""Of b(L), as a divisor: rounding may leave it at zero or below."""
_FORESHORTENED = 1.1
"""By how much finer texture is downwards than across where the camera looks down at 45°, measured with the rig: less
than its foreshortening, as lens and pixels are no finer downwards."""


class Steepness:
    """(1) for n frames, in octaves of the slope."""

    def __init__(self, lags_px: tuple[int, ...], difference: FloatArray) -> None:
        """Take D (n, lags) at `lags_px`; a frame of NaN loses nothing."""
        self._octaves = np.stack([_octaves(np.array(lags_px, np.float64), row) for row in difference])

    def loss(self, smear_px: FloatArray) -> FloatArray:
        """Return (n, p): log2 of the slope along a smear against that across it, for smears (n, p) in px."""
        place = np.clip(smear_px, 0.0, _MOST_PX - _STEP_PX) / _STEP_PX
        whole = place.astype(int)
        frame = np.arange(len(place))[:, None]
        before, after = self._octaves[frame, whole], self._octaves[frame, whole + 1]
        interpolated: FloatArray = before + (place - whole) * (after - before)
        return interpolated


def _octaves(lags_px: FloatArray, difference: FloatArray) -> FloatArray:
    smear_px = np.arange(0.0, _MOST_PX + _STEP_PX, _STEP_PX)
    if not np.isfinite(difference).all() or difference[0] <= 0.0:
        return np.zeros_like(smear_px)
    log_s = np.log(np.concatenate(([_SHORTEST_PX], lags_px)))
    log_D = np.log(np.concatenate(([difference[0] * _SHORTEST_PX**2], difference)))  # smooth within a pixel
    curve = PchipInterpolator(log_s, log_D)
    slope = curve.derivative()

    def D(s: FloatArray) -> FloatArray:
        return np.asarray(np.exp(curve(np.minimum(np.log(s), log_s[-1]))))

    def G(s: FloatArray) -> FloatArray:
        here = np.log(s)
        return np.asarray(np.where(here < log_s[-1], slope(np.minimum(here, log_s[-1])), 0.0) * D(s) / s**2)

    reach = np.hypot(1.0, smear_px)
    along = D(_FORESHORTENED * reach) / (reach**2 * D(np.array(_FORESHORTENED)))
    tau = (np.arange(_TERMS) + 0.5) / _TERMS
    s = np.maximum(_FORESHORTENED * np.outer(smear_px, tau), _SHORTEST_PX)
    across = (2.0 * (1.0 - tau) * G(s)).mean(axis=1) / G(np.array(_SHORTEST_PX))
    octaves: FloatArray = 0.5 * np.log2(along / np.maximum(across, _LEAST_ACROSS))
    return octaves
