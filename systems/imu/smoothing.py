"""How much of the differentiated reference is motion, by frequency: where the band ends, and who tells the motion best.

Two derivatives of a position that is known to 0.1 to 0.5 mm are mostly noise above a few hertz. A prediction that
carries this noise has a flaw: whatever weakens it (a low pass of the sensor, say) seems to improve it. So the noise
stays in the prediction as it is, and effects act on a motion that holds next to none of it. With the power S of the
motion and N of the reference's noise the reference tells the share W(f) of it, and the sensor itself the rest of all
that is seen, B(f) − W(f):

    W(f) = S² / (S² + (30 N)²),  B(f) = S² / (S² + (0.3 N)²)                                                       (1)

S is what of the reference's power follows from what the sensor reads, in stretches of a few seconds and bins of a
quarter of a hertz, each with a phase and a gain of its own, summed over the axes x = reference, y = read:

    S = Σ |Σ x y*|² / Σ |y|²,  S + N = Σ |x|²                                                                      (2)

No delay, no filter and no drift of a clock lowers it, and a reference that was smoothed shows no less noise by it. What
residuals are searched for (inputs) must hold no noise that the residual holds too: they end where S is 100 N. One W
serves the three axes and has no phase. See Carroll et al., Measurement Error in Nonlinear Models, 2006, ch. 3, and
Bendat and Piersol, Random Data, 2010, ch. 6.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import fftconvolve

from messages.arrays import BoolArray, ComplexArray, FloatArray

SETTLED_S: Final = 0.25
"""After that an end or a gap hardly acts any more."""
_SMOOTHING_S: Final = 2.0
"""Half the length of the filter's impulse response: a shorter one would blur its fall and weaken what is motion."""
_SEGMENT_S: Final = 4.0
"""Of a spectrum: a bin of a quarter of a hertz."""
_AROUND_HZ: Final = 0.25
"""To either side, over which powers are averaged before they are compared."""
_LEAST_BAND_HZ: Final = 10.0
"""Of the band: to there human motion reaches, whatever the noise."""
_MOST_BAND_HZ: Final = 30.0
"""Likewise: beyond, there is none, and vibration of the markers would pass for it."""
_BURIED: Final = 0.33
"""S over S + N: the band ends where it stays below."""
_BAND_AROUND_HZ: Final = 1.5
"""To either side, over which that is averaged: the band must not end at a single bin."""
_WELL_ABOVE: Final = 30.0
"""S over N at which W is one half: with less, smoothing the noise would pay more than it costs in motion."""
_SEEN_AT_ALL: Final = 0.3
"""S over N at which B is one half: where the reference sees next to nothing, it judges no effect."""
_BY_CHANCE: Final = 0.175
"""Share of a noise that seems to follow from another by chance, over three axes and so few bins (by simulation)."""
_SLOW_HZ: Final = 1.0
"""Below it a differentiated reference has no noise to speak of: what is next to it tells the share there too."""
_LEAST_NOISE: Final = 1e-6
"""Of the reference's power: what is read without any noise leaves the ratio finite."""
_FAR_ABOVE: Final = 100.0
"""S over N where the inputs end: noise is a tenth of their amplitude at most."""
_INPUT_S: Final = 0.5
"""Half the length of the inputs' filters: shorter than `_SMOOTHING_S`, as inputs may lose motion but not gain noise."""
_INPUT_EDGE_HZ: Final = 2.0
"""Half the width over which a filter of that half length falls."""


@dataclass(frozen=True, eq=False)
class Smoothing:
    """Filters (2 k + 1,) at `rate_hz` for turning rate and specific force, and where the band ends.

    `..._taps` are W of (1), `..._seen_taps` are B; inputs have filters of their own.
    """

    turning_taps: FloatArray
    force_taps: FloatArray
    turning_seen_taps: FloatArray
    force_seen_taps: FloatArray
    turning_input_taps: FloatArray
    force_input_taps: FloatArray
    band_hz: float
    rate_hz: float

    def by_reference(self, f_hz: FloatArray) -> FloatArray:
        """Return W (k, 6) of (1) for turning rate and specific force at `f_hz` (k,)."""
        return self._shares(self.turning_taps, self.force_taps, f_hz)

    def seen(self, f_hz: FloatArray) -> FloatArray:
        """Return B (k, 6) of (1) for turning rate and specific force at `f_hz` (k,)."""
        return self._shares(self.turning_seen_taps, self.force_seen_taps, f_hz)

    def _shares(self, turning: FloatArray, force: FloatArray, f_hz: FloatArray) -> FloatArray:
        return np.repeat(np.column_stack([_response(taps, f_hz, self.rate_hz) for taps in (turning, force)]), 3, axis=1)

    def inputs(self, w: FloatArray, sf: FloatArray) -> FloatArray:
        """Return turning rate and specific force (n, 6) as far as they are almost free of noise."""
        return np.hstack((_convolved(w, self.turning_input_taps), _convolved(sf, self.force_input_taps)))


def smoothing(
    ideal: tuple[FloatArray, FloatArray],
    read: tuple[FloatArray, FloatArray],
    seen: BoolArray,
    rate_hz: float,
    most_hz: float,
) -> Smoothing:
    """Return the filters for turning rate and specific force, `ideal` from the reference and as `read` (n, 3) at
    `rate_hz`, from where the reference is `seen` (n, 2) without a gap.

    The band never reaches beyond `most_hz`.
    """
    ratios = []
    for x, y, there in zip(ideal, read, seen.T, strict=True):
        f_hz, ratio = _above_noise(x, y, there, rate_hz)
        ratios.append(ratio)
    top_hz = min(most_hz, _MOST_BAND_HZ)
    around = 2 * round(_BAND_AROUND_HZ / f_hz[1]) + 1
    told_hz = []
    for ratio in ratios:
        share = uniform_filter1d(np.where(f_hz <= top_hz, ratio / (1.0 + ratio), 0.0), around)
        told_hz.append(float(f_hz[share > _BURIED].max(initial=0.0)))
    band_hz = min(max(_LEAST_BAND_HZ, *told_hz), top_hz)
    inside = f_hz <= band_hz

    def motion_taps(ratio: FloatArray, level: float) -> FloatArray:
        return _taps(inside * ratio**2 / (ratio**2 + level**2), rate_hz, _SMOOTHING_S)

    clear_hz = [float(f_hz[inside & (ratio > _FAR_ABOVE)].max(initial=0.0)) - _INPUT_EDGE_HZ for ratio in ratios]
    turning_input, force_input = (
        _taps(np.where(f_hz <= max(end_hz, _INPUT_EDGE_HZ), 1.0, 0.0), rate_hz, _INPUT_S) for end_hz in clear_hz
    )
    turning, force = ratios
    return Smoothing(
        turning_taps=motion_taps(turning, _WELL_ABOVE),
        force_taps=motion_taps(force, _WELL_ABOVE),
        turning_seen_taps=motion_taps(turning, _SEEN_AT_ALL),
        force_seen_taps=motion_taps(force, _SEEN_AT_ALL),
        turning_input_taps=turning_input,
        force_input_taps=force_input,
        band_hz=band_hz,
        rate_hz=rate_hz,
    )


def _above_noise(x: FloatArray, y: FloatArray, there: BoolArray, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Return the frequencies (k,) and S over N (k,) of the reference's `x` (n, 3), by (2) with what was read, `y`."""
    length = min(len(x), round(_SEGMENT_S * rate_hz))
    starts = np.arange(0, len(x) - length + 1, max(1, length // 2))
    gone = np.concatenate(([0], np.cumsum(~there)))
    whole = starts[gone[starts + length] == gone[starts]]
    rows = (whole if len(whole) else starts)[:, None] + np.arange(length)
    X, Y = (
        np.fft.rfft((each[rows] - each[rows].mean(axis=1, keepdims=True)) * np.hanning(length)[:, None], axis=1)
        for each in (x, y)
    )
    f_hz = np.asarray(np.fft.rfftfreq(length, 1.0 / rate_hz), dtype=np.float64)
    width = 2 * round(_AROUND_HZ / f_hz[1]) + 1

    def near(products: ComplexArray) -> ComplexArray:
        averaged: ComplexArray = uniform_filter1d(products.sum(axis=2), width, axis=1)
        return averaged

    xx, yy = (near(each * each.conj()).real for each in (X, Y))
    following = (np.abs(near(X * Y.conj())) ** 2 / np.maximum(yy, np.finfo(float).tiny)).sum(axis=0)
    share = following / np.maximum(xx.sum(axis=0), np.finfo(float).tiny)
    share = np.clip((share - _BY_CHANCE) / (1.0 - _BY_CHANCE), 0.0, 1.0 - _LEAST_NOISE)
    slow = int(np.searchsorted(f_hz, _SLOW_HZ))
    share[:slow] = share[slow : 2 * slow].max()  # stretches without their mean hold little there, and leak
    return f_hz, share / (1.0 - share)


def _taps(share: FloatArray, rate_hz: float, half_s: float) -> FloatArray:
    """Return the impulse response of the real response `share` (k,), tapered to ± `half_s`, exact at zero."""
    half = round(half_s * rate_hz)
    whole = np.fft.irfft(share)
    taps = np.concatenate((whole[-half:], whole[: half + 1])) * np.hanning(2 * half + 3)[1:-1]
    found: FloatArray = taps * (share[0] / taps.sum())
    return found


def _response(taps: FloatArray, f_hz: FloatArray, rate_hz: float) -> FloatArray:
    """Return the response (k,) of symmetric taps, which is real."""
    half = len(taps) // 2
    turns = np.arange(1, half + 1) / rate_hz
    found: FloatArray = taps[half] + 2.0 * np.cos(2.0 * np.pi * np.outer(f_hz, turns)) @ taps[half + 1 :]
    return found


def _convolved(values: FloatArray, taps: FloatArray) -> FloatArray:
    half = len(taps) // 2
    found: FloatArray = fftconvolve(np.pad(values, ((half, half), (0, 0)), mode="edge"), taps[:, None], "valid", axes=0)
    return found
