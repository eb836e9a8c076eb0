"""From a recording's samples to those that are compared: one band limit for what is measured and what is predicted.

A record x (c, n) is continued over a second by odd reflections of its ends, faded into each other, so that it is smooth
around the circle of the Fourier transform. There, a delay or a lag is a factor and the band limit

    B(f) = 1 below 60 Hz, 0 above 75 Hz, half a cosine between                                                    (1)

lets all be sampled anew just above 150 Hz. Nothing is lost that can be predicted: twice differentiated, the angles hold
more noise than motion above. All of it is linear in x, so that predictions and measurements stay comparable.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import fft
from scipy.ndimage import binary_dilation

from messages.arrays import BoolArray, ComplexArray, FloatArray
from messages.errors import UserError

BAND_HZ = 60.0
"""Where the band ends: twice differentiated, the angles hold more noise than motion above."""
BAND_SHARE = 0.3
"""Of the rate, the most that the band may be, so that (1) has fallen to zero well below half the rate."""
_ROLL_OFF = 1.25
"""Of the band's end, where (1) is zero: a steeper fall rings for longer, and `GUARD_S` would have to grow."""
_MOTION_SHARES = (0.36, 0.43)
"""Of the rate: from where to where the motion that is differentiated fades, above the band, below half the rate."""
_JOIN_S = 1.0
"""Around the circle from the record's end to its beginning: the filters have long died down there."""
GUARD_S = 0.25
"""What is left out at either end and around gaps: by then the filters have died down."""
_LEAST_S = 3.0
"""Of what is compared: a body's ten parameters and an effect need that much motion."""


@dataclass(frozen=True)
class Band:
    """The transforms of n samples at `rate_hz`, gaps filled where not `valid` (n,).

    `values` (m,) at `t_s` (m,), counted from the first sample on, are what is compared; `kept` (m,) tells where.
    """

    rate_hz: float
    valid: BoolArray

    def __post_init__(self) -> None:
        """Refuse a recording that is too short."""
        if len(self.valid) / self.rate_hz < _LEAST_S + 2.0 * _JOIN_S:
            raise UserError(
                f"recording: lasts {len(self.valid) / self.rate_hz:.2f} s, at least {_LEAST_S + 2.0 * _JOIN_S:g} s"
            )
        if self.kept.sum() / self.out_hz < _LEAST_S:
            raise UserError(
                f"recording: {self.kept.sum() / self.out_hz:.2f} s lie {GUARD_S:g} s from ends and gaps, at least "
                f"{_LEAST_S:g} s are needed"
            )

    @cached_property
    def pass_hz(self) -> float:
        """Return up to where nothing is taken away."""
        return min(BAND_HZ, BAND_SHARE * self.rate_hz)

    @cached_property
    def length(self) -> int:
        """Return the samples around the circle."""
        return int(fft.next_fast_len(len(self.valid) + round(_JOIN_S * self.rate_hz), real=True))

    @cached_property
    def reduced_length(self) -> int:
        """Return the samples around the circle of what is compared."""
        least = int(np.ceil(2.0 * _ROLL_OFF * self.pass_hz / self.rate_hz * self.length)) + 2
        return int(fft.next_fast_len(least, real=True))

    @cached_property
    def out_hz(self) -> float:
        """Return the rate of what is compared."""
        return self.rate_hz * self.reduced_length / self.length

    @cached_property
    def _inside(self) -> slice:
        first = int(np.ceil(GUARD_S * self.out_hz))
        last = int(np.floor(((len(self.valid) - 1) / self.rate_hz - GUARD_S) * self.out_hz))
        return slice(first, last + 1)

    @cached_property
    def t_s(self) -> FloatArray:
        """Return the times (m,) of what is compared."""
        return np.arange(self._inside.start, self._inside.stop) / self.out_hz

    @cached_property
    def kept(self) -> BoolArray:
        """Return where (m,) no gap is near."""
        reach = round(GUARD_S * self.rate_hz)
        near = binary_dilation(~self.valid, structure=np.ones(2 * reach + 1, dtype=np.bool_))
        return ~np.asarray(near[np.rint(self.t_s * self.rate_hz).astype(np.int64)], dtype=np.bool_)

    @cached_property
    def f_hz(self) -> FloatArray:
        """Return the frequencies of the bins."""
        return np.asarray(fft.rfftfreq(self.length, 1.0 / self.rate_hz), dtype=np.float64)

    @cached_property
    def limit(self) -> FloatArray:
        """Return B of (1) at the bins."""
        return _fall(self.f_hz, self.pass_hz, _ROLL_OFF * self.pass_hz)

    @cached_property
    def motion_limit(self) -> FloatArray:
        """Return the limit of the motion that is differentiated."""
        return motion_limit(self.f_hz, self.rate_hz)

    def spectrum(self, values: FloatArray) -> ComplexArray:
        """Return the bins (c, k) of `values` (c, n)."""
        join = self.length - len(self.valid)
        after = 2.0 * values[:, -1:] - values[:, -2 : -2 - join : -1]
        before = 2.0 * values[:, :1] - values[:, join:0:-1]
        weight = 0.5 + 0.5 * np.cos(np.pi * (np.arange(join) + 1.0) / (join + 1.0))
        bins: ComplexArray = fft.rfft(np.hstack((values, weight * after + (1.0 - weight) * before)), axis=1)
        return bins

    def full(self, spectrum: ComplexArray, finer: int = 1) -> FloatArray:
        """Return the samples (c, finer n) of a spectrum (c, k), `finer` for each one of the recording."""
        values: FloatArray = fft.irfft(spectrum, finer * self.length, axis=1)[:, : finer * len(self.valid)]
        return finer * values

    def stretched(self, spectrum: ComplexArray, rate: float) -> FloatArray:
        """Return the samples (c, n) as a clock that runs fast by `rate` shows them: what is at t seems at t (1 + rate).

        With W = exp(2πj / (L (1 + rate))) they are Σ_k c_k W^(k m), a convolution by 2 k m = k² + m² − (m − k)²
        (Bluestein, IEEE Trans. Audio Electroacoustics 18(4), 1970).
        """
        n, used = len(self.valid), int(np.count_nonzero(self.motion_limit))
        place = np.arange(max(n, used), dtype=np.float64)
        chirp = np.exp(1j * np.pi / (self.length * (1.0 + rate)) * place**2)
        size = int(fft.next_fast_len(n + used))
        kernel = np.zeros(size, dtype=np.complex128)
        kernel[:n] = chirp[:n].conj()
        kernel[size - used + 1 :] = chirp[used - 1 : 0 : -1].conj()
        weight = np.where(place[:used] == 0.0, 1.0, 2.0) / self.length
        bins = fft.fft(spectrum[:, :used] * (weight * chirp[:used]), size, axis=1)
        bins *= fft.fft(kernel)
        values: FloatArray = (fft.ifft(bins, axis=1)[:, :n] * chirp[:n]).real
        return values

    def reduced(self, spectrum: ComplexArray) -> FloatArray:
        """Return what is compared (c, m) of a spectrum (c, k): behind (1), sampled anew."""
        bins = self.reduced_length // 2 + 1
        values: FloatArray = fft.irfft(spectrum[:, :bins] * self._scaled_limit, self.reduced_length, axis=1)
        return values[:, self._inside]

    @cached_property
    def _scaled_limit(self) -> FloatArray:
        return self.limit[: self.reduced_length // 2 + 1] * (self.reduced_length / self.length)

    def noise_gain(self, power: int, limit: FloatArray) -> float:
        """Return by what white noise is multiplied that is differentiated `power` times and passes a `limit` (k,)."""
        twice = np.where(self.f_hz == 0.0, 1.0, 2.0)
        response = (2.0 * np.pi * self.f_hz) ** power * limit
        return float(np.sqrt((twice * response**2).sum() / self.length))


def bridged(values: FloatArray, valid: BoolArray) -> FloatArray:
    """Return `values` (n, c) with lines across what is not `valid` (n,), time last: (c, n)."""
    if valid.all():
        return np.ascontiguousarray(values.T)
    index = np.arange(len(values))
    return np.stack([np.interp(index, index[valid], column[valid]) for column in values.T])


def motion_limit(f_hz: FloatArray, rate_hz: float) -> FloatArray:
    """Return the limit, at `f_hz`, of motion that is sampled `rate_hz` times a second and differentiated."""
    return _fall(f_hz, *(share * rate_hz for share in _MOTION_SHARES))


def _fall(f_hz: FloatArray, first_hz: float, last_hz: float) -> FloatArray:
    position = np.clip((f_hz - first_hz) / (last_hz - first_hz), 0.0, 1.0)
    fall: FloatArray = 0.5 + 0.5 * np.cos(np.pi * position)
    return fall
