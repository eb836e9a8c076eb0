"""What is known of a recording's noise beside any model: as stated, from repeats, from a periodic input, from a rest.

Two measurements y, y' of the same motion differ by their noise alone, whatever the model lacks, so that

    σ² = ½ mean (y − y')²                                                                                          (1)

Repeats are recordings with the same inputs, or the periods of one periodic input. At rest a measurement varies by its
noise alone, but only by that part of it that motion does not make.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import fft

from discrepancy.simulation import Channels
from messages.arrays import BoolArray, FloatArray

Source = Literal["stated", "repeats", "period", "rest"]

_SAME = 1e-4
"""Of an input's mean square: by what it may differ between repeats, squared."""
_AWAY = 0.5
"""Likewise: by what it must have differed before a period is over, or a slow input would repeat at once."""
_LEAST_PERIOD = 16
"""Samples of a period: a shorter one is a tone, in which repeats tell nothing of slow noise."""
_PERIODS = 3
"""In the record, at least: one in which the system settles, two that are compared."""
_LEAST_PAIRS = 50
"""Of samples of a channel that are compared, or that rest."""
_STILL = 1e-6
"""Of an input's spread: what changes less from sample to sample stands still."""
_SETTLED = 3.0
"""Standard errors by which two parts of a rest may differ: more, and something still moves."""
_ALIKE = 1.3
"""Times by which their noise may differ."""


@dataclass(frozen=True)
class Noise:
    """Standard deviation `std` (c,) of one sample of measured minus predicted under the right model, and its source."""

    std: FloatArray
    source: Source

    @property
    def whole(self) -> bool:
        """Return whether it is all the noise there is; a rest does not hold what motion makes."""
        return self.source != "rest"


def known_noise(channels: Channels) -> Noise | None:
    """Return what one recording tells of its noise, None if it tells nothing."""
    if channels.noise_std is not None:
        return Noise(channels.noise_std, "stated")
    inputs = _varying(channels.inputs)
    if inputs is None:
        return None
    lag = _period(inputs)
    if lag is not None:
        std = _difference(channels.values[2 * lag :], channels.values[lag:-lag])
        if std is not None:
            return Noise(std, "period")
    std = _resting(channels.values, inputs)
    return None if std is None else Noise(std, "rest")


def repeated(first: Channels, second: Channels) -> Noise | None:
    """Return the noise of two recordings that repeat each other, None where their inputs differ."""
    if first.noise_std is not None or first.inputs.shape != second.inputs.shape:
        return None
    inputs = _varying(first.inputs)
    if inputs is None or not np.isfinite(second.inputs).all():
        return None
    spread = first.inputs.std(axis=0)
    apart = ((second.inputs - first.inputs) ** 2).mean(axis=0)
    if np.any(apart > _SAME * spread**2):
        return None
    std = _difference(first.values, second.values)
    return None if std is None else Noise(std, "repeats")


def _varying(inputs: FloatArray) -> FloatArray | None:
    """Return the inputs (n, k) that vary, of unit spread about zero; None if none does, or one has gaps."""
    if not inputs.size or not np.isfinite(inputs).all():
        return None
    spread = inputs.std(axis=0)
    moving = spread > 0.0
    return (inputs[:, moving] - inputs[:, moving].mean(axis=0)) / spread[moving] if moving.any() else None


def _period(inputs: FloatArray) -> int | None:
    """Return the samples after which all inputs (n, k) repeat themselves, None if they do not `_PERIODS` times."""
    n = len(inputs)
    longest = n // _PERIODS
    if longest <= _LEAST_PERIOD:
        return None
    power = (inputs**2).sum(axis=1)
    ahead = np.concatenate(([0.0], np.cumsum(power)))
    spectrum = fft.rfft(inputs, fft.next_fast_len(2 * n, real=True), axis=0)
    product = fft.irfft(np.abs(spectrum) ** 2, fft.next_fast_len(2 * n, real=True), axis=0)[: longest + 1].sum(axis=1)
    lags = np.arange(longest + 1)
    apart = (ahead[n - lags] + (ahead[n] - ahead[lags]) - 2.0 * product) / np.maximum(power.sum(), np.finfo(float).tiny)
    away = int(np.argmax(apart > _AWAY))
    if not apart[away] > _AWAY:
        return None
    back = np.flatnonzero(apart[max(away, _LEAST_PERIOD) :] < _SAME)
    return int(back[0]) + max(away, _LEAST_PERIOD) if len(back) else None


def _difference(first: FloatArray, second: FloatArray) -> FloatArray | None:
    """Return σ (c,) of (1) from two measurements (n, c), None where a channel has too few samples in both."""
    apart = first - second
    there = np.isfinite(apart)
    if there.sum(axis=0).min() < _LEAST_PAIRS:
        return None
    std = np.sqrt(0.5 * np.nanmean(apart**2, axis=0))
    return np.asarray(std, dtype=np.float64) if np.all(std > 0.0) else None


def _resting(values: FloatArray, inputs: FloatArray) -> FloatArray | None:
    """Return the deviation (c,) of measurements (n, c) in the longest time in which no input (n, k) moves."""
    still = np.concatenate(([True], np.all(np.abs(np.diff(inputs, axis=0)) < _STILL, axis=1)))
    first, last = _longest(still)
    rest = values[(first + last) // 2 : last]  # by then the system has settled
    if len(rest) < _LEAST_PAIRS or not np.isfinite(rest).all():
        return None
    early, late = rest[: len(rest) // 2], rest[len(rest) // 2 :]
    std = np.maximum(early.std(axis=0), late.std(axis=0))
    least = np.minimum(early.std(axis=0), late.std(axis=0))
    apart = np.abs(early.mean(axis=0) - late.mean(axis=0))
    settled = np.all(apart <= _SETTLED * std * np.sqrt(4.0 / len(rest))) and np.all(std <= _ALIKE * least)
    return np.asarray(rest.std(axis=0), dtype=np.float64) if settled and np.all(least > 0.0) else None


def _longest(true: BoolArray) -> tuple[int, int]:
    """Return first and one after last of the longest run of what is true (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], true.astype(int), [0]))))
    starts, ends = edges[::2], edges[1::2]
    if not len(starts):
        return 0, 0
    longest = int(np.argmax(ends - starts))
    return int(starts[longest]), int(ends[longest])
