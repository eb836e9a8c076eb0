"""Noise and offset of a force plate at rest: what a simulation or a tare must reckon with.

Each channel of a resting record, sampled uniformly, is taken for

    y(t) = offset + drift t + walk(t) + Σ A cos(2π f t + φ) + e,   e_k = Σ_j a_j e_{k−j} + s w_k                    (1)

with lines (mains and its aliases, motors), an autoregressive colour e whose order Schwarz's criterion chooses, and a
random walk below all of it. The innovations w of the channels are correlated: they share plate and amplifiers. What a
mean over T leaves follows from the density of e at zero frequency:

    S0 = s² / (rate (1 − Σ a)²),   σ(mean)² = S0 / T + q² T / 3                                                   (2)
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

from messages.arrays import FloatArray
from messages.errors import UserError

LEAST_S: Final = 10.0
HIGHEST_ORDER: Final = 48
_LINE_OVER_MEDIAN: Final = 25.0
"""Of the periodogram's median around: with 3000 bins, chance exceeds it once in ten thousand records."""
_AROUND_HZ: Final = 1.0
_MOST_LINES: Final = 24
_FINER: Final = 4
"""Times the periodogram's own resolution: how finely a line's frequency is sought."""
_BLOCK_S: Final = 5.0
_UNEVEN: Final = 0.5
_SETTLE: Final = 2000


@dataclass(frozen=True)
class Line:
    """A sinusoid that all channels share: `amplitude` and `phase_rad` (c,) in each, at `f_hz`.

    `mains_hz` is 50 or 60 at a harmonic of that or its alias, else 0.
    """

    f_hz: float
    amplitude: FloatArray
    phase_rad: FloatArray
    mains_hz: float

    def wave(self, t_s: FloatArray, shift_rad: float) -> FloatArray:
        """Return it at `t_s` (n,), all channels shifted alike: (n, c)."""
        return self.amplitude * np.cos(2.0 * np.pi * self.f_hz * t_s[:, None] + self.phase_rad + shift_rad)


@dataclass(frozen=True)
class ChannelNoise:
    """One channel of (1) in its own unit. `deviation` is that of a sample about offset, drift and walk, lines included.

    `offset` holds at the record's middle; deviations are standard errors. `autoregression` (p,) and `innovation` make
    e; `walk_per_root_s` is q of (2), zero where the blocks show none.
    """

    name: str
    offset: float
    offset_deviation: float
    drift_per_s: float
    drift_deviation: float
    deviation: float
    autoregression: FloatArray
    innovation: float
    walk_per_root_s: float

    def density(self, f_hz: FloatArray, rate_hz: float) -> FloatArray:
        """Return the one-sided power density (k,) of e at `f_hz` (k,), unit²/Hz."""
        lags = np.arange(1, len(self.autoregression) + 1)
        response = 1.0 - np.exp(-2j * np.pi * np.outer(f_hz / rate_hz, lags)) @ self.autoregression
        density: FloatArray = 2.0 * self.innovation**2 / rate_hz / np.abs(response) ** 2
        return density

    def innovations(self, e: FloatArray) -> FloatArray:
        """Return s w (n,) of (1) of a record's e (n,); the first as many as the order are not settled."""
        taps: FloatArray = np.concatenate(([1.0], -self.autoregression))
        white: FloatArray = lfilter(taps, [1.0], e)
        return white

    def deviation_of_mean(self, seconds: float, rate_hz: float) -> float:
        """Return by (2) how far the mean over `seconds` lies from the offset, one standard deviation."""
        at_zero = 0.5 * float(self.density(np.zeros(1), rate_hz)[0])
        return float(np.sqrt(at_zero / seconds + self.walk_per_root_s**2 * seconds / 3.0))


@dataclass(frozen=True)
class ForceNoise:
    """The model (1) of a plate's channels; `correlation` (c, c) is that of the innovations."""

    rate_hz: float
    channels: tuple[ChannelNoise, ...]
    lines: tuple[Line, ...]
    correlation: FloatArray

    def generate(self, samples: int, rng: np.random.Generator, *, offsets: bool = False) -> FloatArray:
        """Return (n, c) of noise with this colour, correlation, walk and lines; with offset and drift where asked."""
        t_s = np.arange(samples) / self.rate_hz
        shape = (_SETTLE + samples, len(self.channels))
        innovations = rng.standard_normal(shape) @ np.linalg.cholesky(self.correlation).T
        noise = np.empty((samples, len(self.channels)))
        for k, channel in enumerate(self.channels):
            taps: FloatArray = np.concatenate(([1.0], -channel.autoregression))
            noise[:, k] = lfilter([channel.innovation], taps, innovations[:, k])[_SETTLE:]
            noise[:, k] += channel.walk_per_root_s * np.cumsum(rng.standard_normal(samples)) / np.sqrt(self.rate_hz)
            if offsets:
                noise[:, k] += channel.offset + channel.drift_per_s * (t_s - 0.5 * t_s[-1])
        for line in self.lines:
            noise += line.wave(t_s, 2.0 * np.pi * rng.random())
        return noise


def fit_force_noise(t_s: FloatArray, values: FloatArray, names: Sequence[str]) -> ForceNoise:
    """Return the model of a resting record: `values` (n, c) of the channels `names` at `t_s` (n,).

    Raises UserError for NaN, stamps that are not uniform, a record below ten seconds, or a channel that never changes.
    """
    steps_s = np.diff(t_s)
    if not (np.isfinite(values).all() and np.isfinite(t_s).all()):
        row, column = np.argwhere(~np.isfinite(np.column_stack((t_s, values))))[0]
        raise UserError(f"resting record: row {row + 1}: {('t_s', *names)[column]} is not a number")
    if len(t_s) < 2 or t_s[-1] - t_s[0] < LEAST_S:
        raise UserError(f"resting record: {len(t_s)} samples, {LEAST_S:g} s or more are needed")
    if np.abs(steps_s - steps_s.mean()).max() > _UNEVEN * steps_s.mean():
        worst = int(np.argmax(np.abs(steps_s - steps_s.mean())))
        raise UserError(
            f"resting record: row {worst + 2}: {steps_s[worst]:.4g} s after the last, not {steps_s.mean():.4g}"
        )
    still = np.flatnonzero(np.ptp(values, axis=0) == 0.0)
    if len(still):
        raise UserError(f"resting record: {names[still[0]]} never changes: not connected?")
    rate_hz = float(1.0 / steps_s.mean())
    even_s = np.arange(len(values)) / rate_hz
    middle_s = even_s - even_s.mean()
    drifts, offsets = np.polyfit(middle_s, values, 1)
    left = values - offsets - drifts * middle_s[:, None]
    lines, colour = _lines_of(left, rate_hz)
    channels = tuple(
        _channel(name, float(offset), float(drift), float(y.std()), e, rate_hz)
        for name, offset, drift, y, e in zip(names, offsets, drifts, left.T, colour.T, strict=True)
    )
    innovations = [channel.innovations(e)[HIGHEST_ORDER:] for channel, e in zip(channels, colour.T, strict=True)]
    return ForceNoise(rate_hz, channels, lines, np.atleast_2d(np.corrcoef(innovations)))


def _channel(name: str, offset: float, drift: float, deviation: float, e: FloatArray, rate_hz: float) -> ChannelNoise:
    """Return a channel's model; `e` (n,) is what offset, drift and lines leave."""
    autoregression, innovation = _autoregression(e)
    at_zero = innovation**2 / rate_hz / (1.0 - autoregression.sum()) ** 2
    walk, seconds = _walk(e, rate_hz, at_zero), len(e) / rate_hz
    return ChannelNoise(
        name=name,
        offset=offset,
        offset_deviation=float(np.sqrt(at_zero / seconds + walk**2 * seconds / 12.0)),
        drift_per_s=drift,
        drift_deviation=float(np.sqrt(12.0 * at_zero / seconds**3 + 1.2 * walk**2 / seconds)),
        deviation=deviation,
        autoregression=autoregression,
        innovation=innovation,
        walk_per_root_s=walk,
    )


def _lines_of(y: FloatArray, rate_hz: float) -> tuple[tuple[Line, ...], FloatArray]:
    """Return the sinusoids that stand out of a channel's periodogram around them, and what is left of y (n, c)."""
    lines: list[Line] = []
    n = len(y)
    t_s = np.arange(n) / rate_hz
    around = max(8, round(_AROUND_HZ * n / rate_hz))
    for _ in range(_MOST_LINES):
        power = np.abs(np.fft.rfft(y, axis=0)) ** 2
        padded = np.pad(power, ((around, around), (0, 0)), mode="reflect")
        median = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * around + 1, axis=0), axis=2)
        ratio = (power / median)[around:-1]
        if float(ratio.max()) < _LINE_OVER_MEDIAN:
            break
        place, channel = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
        first = _FINER * (around + int(place) - 1)
        near = np.abs(np.fft.rfft(y[:, channel], _FINER * n)[first : first + 2 * _FINER + 1])
        f_hz = float((first + int(np.argmax(near))) * rate_hz / (_FINER * n))
        wave = np.column_stack((np.cos(2.0 * np.pi * f_hz * t_s), -np.sin(2.0 * np.pi * f_hz * t_s)))
        cosine, sine = parts = np.linalg.lstsq(wave, y, rcond=None)[0]
        y = y - wave @ parts
        lines.append(Line(f_hz, np.hypot(cosine, sine), np.arctan2(sine, cosine), _mains(f_hz, rate_hz, n / rate_hz)))
    return tuple(lines), y


def _mains(f_hz: float, rate_hz: float, seconds: float) -> float:
    """Return 50 or 60 where one of its first three harmonics, or an alias, is at `f_hz` within 0.05 %; else 0."""
    for mains_hz in (50.0, 60.0):
        harmonics = mains_hz * np.arange(1, 4)
        aliases = np.abs(harmonics - rate_hz * np.rint(harmonics / rate_hz))
        if (np.abs(aliases - f_hz) < 5e-4 * harmonics + 1.0 / seconds).any():
            return mains_hz
    return 0.0


def _autoregression(y: FloatArray) -> tuple[FloatArray, float]:
    """Return (a, s) of (1) by Yule and Walker, the order up to 48 by Schwarz's criterion."""
    n = len(y)
    length = 1 << (2 * n - 1).bit_length()
    covariance = np.fft.irfft(np.abs(np.fft.rfft(y, length)) ** 2)[: HIGHEST_ORDER + 1] / n
    best, variance = np.zeros(0), float(covariance[0])
    least = n * np.log(variance)
    for order in range(1, HIGHEST_ORDER + 1):
        weights = solve_toeplitz(covariance[:order], covariance[1 : order + 1])
        remaining = float(covariance[0] - weights @ covariance[1 : order + 1])
        criterion = n * np.log(remaining) + order * np.log(n)
        if criterion < least:
            best, variance, least = weights, remaining, criterion
    return best, float(np.sqrt(variance))


def _walk(y: FloatArray, rate_hz: float, at_zero: float) -> float:
    """Return q of (2) from the steps between means of blocks: their variance is 2 S0 / T + 2 q² T / 3.

    Zero where the steps are within two standard deviations of what the colour alone makes.
    """
    block = round(_BLOCK_S * rate_hz)
    if len(y) < 3 * block:
        return 0.0
    means = y[: len(y) // block * block].reshape(-1, block).mean(axis=1)
    expected = 2.0 * at_zero / _BLOCK_S
    excess = float(np.mean(np.diff(means) ** 2)) - expected
    if excess < 2.0 * expected * np.sqrt(3.0 / (len(means) - 1)):
        return 0.0
    return float(np.sqrt(excess * 1.5 / _BLOCK_S))
