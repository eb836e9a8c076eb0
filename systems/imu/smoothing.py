"""How much of the differentiated reference is motion, by frequency: where the band ends, and what effects act on.

Two derivatives of a position that is known to 0.1 to 0.5 mm are mostly noise above a few hertz. A prediction that
carries this noise has a flaw: whatever weakens it (a low pass of the sensor, say) seems to improve it. So the noise
stays in the prediction as it is, and only the motion that stands well above it passes through the effects. With the
power S of the motion and N of the noise, that is the share

    W(f) = S² / (S² + (3 N)²),   S + N seen,   N = N0 (2πf)^2k for the k-th derivative of white noise            (1)

What residuals are searched for (inputs) must hold no noise that the residual holds too: they end where S is 100 N.

N0 is read where attitude and position hold nothing but noise, in the upper part of their band. Where the quietest
stretches hold more, as with a reference that was smoothed before, N is that, up to eight times as much. One W serves
the three axes and has no phase. See Carroll et al., Measurement Error in Nonlinear Models, 2006, ch. 3.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import fftconvolve

from messages.arrays import BoolArray, FloatArray

SETTLED_S: Final = 0.25
"""After that an end or a gap hardly acts any more."""
_SMOOTHING_S: Final = 2.0
"""Half the length of the filter's impulse response: a shorter one would blur its fall and weaken what is motion."""
_SEGMENT_S: Final = 4.0
"""Of a spectrum: a bin of a quarter of a hertz."""
_UPPER: Final = (0.25, 0.4)
"""Of the reference's rate: noise only, and still differentiated well."""
_AROUND_HZ: Final = 0.25
"""To either side, over which powers are averaged before they are compared."""
_LEAST_BAND_HZ: Final = 10.0
"""Of the band: to there human motion reaches, whatever the noise."""
_MOST_BAND_HZ: Final = 30.0
"""Likewise: beyond, there is none, and vibration of the markers would pass for it."""
_MOST_OF_REFERENCE: Final = 0.3
"""Of the reference's rate: splines of degree seven keep second derivatives to 1 % that far."""
_BURIED: Final = 0.5
"""S over N: the band ends where it stays below."""
_WELL_ABOVE: Final = 3.0
"""S over N at which (1) is one half."""
_QUIETEST: Final = 5
"""One in so many stretches, the quietest at each frequency, tells the noise: in the others there may be motion."""
_OF_QUIETEST: Final = 1.4
"""The mean power of noise over that of its quietest fifth of stretches."""
_MOST_COLOUR: Final = 8.0
"""Times white noise, differentiated: motion that never rests must not pass for noise."""
_FAR_ABOVE: Final = 100.0
"""S over N where the inputs end: noise is a tenth of their amplitude at most."""
_INPUT_S: Final = 0.5
"""Half the length of the inputs' filters: shorter than `_SMOOTHING_S`, as inputs may lose motion but not gain noise."""
_INPUT_EDGE_HZ: Final = 2.0
"""Half the width over which a filter of that half length falls."""


@dataclass(frozen=True, eq=False)
class Smoothing:
    """Filters (2 k + 1,) for turning rate and specific force, by (1) and for inputs, and where the band ends."""

    turning_taps: FloatArray
    force_taps: FloatArray
    turning_input_taps: FloatArray
    force_input_taps: FloatArray
    band_hz: float

    def turning(self, values: FloatArray) -> FloatArray:
        """Return (n, c) of what follows from one derivative of the attitude, smoothed."""
        return _convolved(values, self.turning_taps)

    def force(self, values: FloatArray) -> FloatArray:
        """Return (n, c) of what follows from two derivatives of the position, smoothed."""
        return _convolved(values, self.force_taps)

    def inputs(self, w: FloatArray, sf: FloatArray) -> FloatArray:
        """Return turning rate and specific force (n, 6) as far as they are almost free of noise."""
        return np.hstack((_convolved(w, self.turning_input_taps), _convolved(sf, self.force_input_taps)))


def smoothing(
    w: FloatArray, sf: FloatArray, seen: BoolArray, rate_hz: float, reference_hz: float, most_hz: float
) -> Smoothing:
    """Return the filters for `w` and `sf` (n, 3) at `rate_hz`, from where both are `seen` (n, 2) without a gap.

    The band never reaches beyond `most_hz`, nor beyond what the reference's rate allows.
    """
    ratios = []
    for values, there, order in ((w, seen[:, 0], 1), (sf, seen[:, 1], 2)):
        f_hz, pieces = _power(values, there, rate_hz)
        power = pieces.mean(axis=0)
        growth = np.maximum(f_hz, f_hz[1]) ** (2 * order)
        upper = (f_hz > _UPPER[0] * reference_hz) & (f_hz < _UPPER[1] * reference_hz)
        width = 2 * round(_AROUND_HZ / f_hz[1]) + 1
        white = uniform_filter1d(growth * float(np.mean(power[upper] / growth[upper])), width)
        quietest = np.sort(uniform_filter1d(pieces, width, axis=1), axis=0)[: -(-len(pieces) // _QUIETEST)].mean(axis=0)
        noise = np.clip(_OF_QUIETEST * quietest, white, _MOST_COLOUR * white)
        ratios.append(np.maximum(uniform_filter1d(power, width) / noise - 1.0, 0.0))
    told_hz = max(float(f_hz[ratio > _BURIED].max(initial=0.0)) for ratio in ratios)
    top_hz = min(most_hz, _MOST_BAND_HZ, _MOST_OF_REFERENCE * reference_hz)
    band_hz = min(max(_LEAST_BAND_HZ, told_hz), top_hz)
    inside = f_hz <= band_hz
    turning, force = (_taps(inside * ratio**2 / (ratio**2 + _WELL_ABOVE**2), rate_hz, _SMOOTHING_S) for ratio in ratios)
    clear_hz = [float(f_hz[inside & (ratio > _FAR_ABOVE)].max(initial=0.0)) - _INPUT_EDGE_HZ for ratio in ratios]
    turning_input, force_input = (
        _taps(np.where(f_hz <= max(end_hz, _INPUT_EDGE_HZ), 1.0, 0.0), rate_hz, _INPUT_S) for end_hz in clear_hz
    )
    return Smoothing(turning, force, turning_input, force_input, band_hz)


def _power(values: FloatArray, there: BoolArray, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Return the frequencies (k,) and the power density (s, k) of stretches without a gap, mean over axes."""
    length = min(len(values), round(_SEGMENT_S * rate_hz))
    starts = np.arange(0, len(values) - length + 1, max(1, length // 2))
    gone = np.concatenate(([0], np.cumsum(~there)))
    whole = starts[gone[starts + length] == gone[starts]]
    pieces = values[(whole if len(whole) else starts)[:, None] + np.arange(length)]
    bins = np.fft.rfft((pieces - pieces.mean(axis=1, keepdims=True)) * np.hanning(length)[:, None], axis=1)
    power: FloatArray = (np.abs(bins) ** 2).mean(axis=2)
    f_hz = np.asarray(np.fft.rfftfreq(length, 1.0 / rate_hz), dtype=np.float64)
    return f_hz, power


def _taps(share: FloatArray, rate_hz: float, half_s: float) -> FloatArray:
    """Return the impulse response of the real response `share` (k,), tapered to ± `half_s`, one at zero frequency."""
    half = round(half_s * rate_hz)
    whole = np.fft.irfft(share)
    taps = np.concatenate((whole[-half:], whole[: half + 1])) * np.hanning(2 * half + 3)[1:-1]
    found: FloatArray = taps / taps.sum()
    return found


def _convolved(values: FloatArray, taps: FloatArray) -> FloatArray:
    half = len(taps) // 2
    found: FloatArray = fftconvolve(np.pad(values, ((half, half), (0, 0)), mode="edge"), taps[:, None], "valid", axes=0)
    return found
