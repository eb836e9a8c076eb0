"""A record in the frequency domain: the bins that are weighed, and the derivatives of what moves, both inside a taper.

Noise that is white in time stays independent from bin to bin, and a linear filter multiplies it by a number: weights of
a whole covariance cost one small matrix per bin. Two tapers keep the ends (and gaps) out: the motion is differentiated
under the wider one, so that the equations are exact wherever the narrower one lets them count.
"""

from dataclasses import dataclass

import numpy as np
from scipy import fft

from messages.arrays import BoolArray, ComplexArray, FloatArray
from messages.errors import UserError

MOTION_RAMP_S = 0.15
GUARD_S = 0.1
EQUATION_RAMP_S = 0.3
ROLL_OFF_HZ = 25.0
LEAST_VALID_S = 3.0


@dataclass(frozen=True)
class Spectra:
    """The transforms of one uniform record of n samples at `rate_hz`.

    `f_hz` (k,) are the bins from 0 on, to the end of the roll-off above the band, and `kept` (k,) is what remains of
    the motion there: 1 in the band. `share` (k,) is by what |X|² counts in Σ|x|², 0 above the band. `counted_s` is the
    length of record that the taper of the equations lets count.
    """

    rate_hz: float
    f_hz: FloatArray
    kept: FloatArray
    share: FloatArray
    counted_s: float
    _length: int
    _motion_taper: FloatArray
    _equation_taper: FloatArray

    @classmethod
    def of(cls, rate_hz: float, valid: BoolArray, band_hz: float) -> "Spectra":
        """Return the transforms for a record whose samples are `valid` (n,), that count from 0 to `band_hz`.

        Raises UserError if the band leaves no room below half the rate, or if less than three seconds count.
        """
        if not 0.0 < band_hz + ROLL_OFF_HZ < 0.5 * rate_hz:
            raise UserError(f"band {band_hz:g} Hz: must lie between 0 and {0.5 * rate_hz - ROLL_OFF_HZ:g} Hz")
        inside_s = _distance(valid) / rate_hz
        equation_taper = _raised_cosine((inside_s - MOTION_RAMP_S - GUARD_S) / EQUATION_RAMP_S)
        counted_s = float(equation_taper @ equation_taper) / rate_hz
        if counted_s < LEAST_VALID_S:
            raise UserError(f"recording: {counted_s:.2f} s without gaps, at least {LEAST_VALID_S:g} s are needed")
        length = fft.next_fast_len(len(valid), real=True)
        all_hz = np.asarray(np.fft.rfftfreq(length, 1.0 / rate_hz), dtype=np.float64)
        f_hz: FloatArray = all_hz[all_hz < band_hz + ROLL_OFF_HZ]
        return cls(
            rate_hz=rate_hz,
            f_hz=f_hz,
            kept=_raised_cosine(1.0 - (f_hz - band_hz) / ROLL_OFF_HZ),
            share=np.where(f_hz == 0.0, 1.0, 2.0) * (f_hz <= band_hz) / length,
            counted_s=counted_s,
            _length=length,
            _motion_taper=_raised_cosine(inside_s / MOTION_RAMP_S),
            _equation_taper=equation_taper,
        )

    def equations(self, values: FloatArray) -> ComplexArray:
        """Return `values` (n, ...) under the taper of the equations, at the bins: (k, ...)."""
        taper = self._equation_taper.reshape(-1, *(1,) * (values.ndim - 1))
        bins: ComplexArray = fft.rfft(values * taper, self._length, axis=0)[: len(self.f_hz)]
        return bins

    def motion(self, values: FloatArray) -> tuple[FloatArray, ComplexArray]:
        """Return the mean (c,) of `values` (n, c) and the rest at the bins (k, c)."""
        weight = self._motion_taper / self._motion_taper.sum()
        mean: FloatArray = weight @ values
        bins: ComplexArray = fft.rfft((values - mean) * self._motion_taper[:, None], self._length, axis=0)
        return mean, bins[: len(self.f_hz)]

    def derivatives(self, mean: FloatArray, spectrum: ComplexArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the motion of a spectrum (k, c) with two derivatives (n, c), exact where the equations count."""
        n = len(self._motion_taper)
        jw = 2j * np.pi * self.f_hz[:, None]
        value, rate, acceleration = (
            np.ascontiguousarray(fft.irfft(each, self._length, axis=0)[:n])
            for each in (spectrum, jw * spectrum, jw**2 * spectrum)
        )
        return value + mean, rate, acceleration


def _distance(valid: BoolArray) -> FloatArray:
    """Return how many samples each one (n,) lies from the nearest invalid one or the record's end."""
    n = len(valid)
    walls = np.concatenate(([-1], np.flatnonzero(~valid), [n]))
    index = np.arange(n)
    after = np.clip(np.searchsorted(walls, index, side="left"), 1, len(walls) - 1)
    distance: FloatArray = np.minimum(index - walls[after - 1], walls[after] - index).astype(np.float64)
    return np.where(valid, distance, 0.0)


def _raised_cosine(position: FloatArray) -> FloatArray:
    ramp: FloatArray = 0.5 - 0.5 * np.cos(np.pi * np.clip(position, 0.0, 1.0))
    return ramp
