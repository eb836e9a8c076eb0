"""Lines in a residual's spectrum: one frequency, as of a mains hum, that a filter of few lags would take for colour.

A bin of the periodogram is held against the median of the bins about it. In noise the bin is exponential and the median
of m bins about gamma with a = m / 4 degrees (the taper leaves half of them independent, and the relative variance of an
exponential's median is 2 / m), so that the largest ratio of K bins exceeds x with a probability of at most

    K (1 + x ln 2 / a)⁻ᵃ                                                                                           (1)

"""

from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.ndimage import median_filter

from messages.arrays import FloatArray

SHARE = 0.25
"""Of a channel's power over its running median: what one frequency alone does not hold in noise, however coloured."""
FAINT_SHARE = 0.02
"""Likewise, of a line that is at the same frequency on another recording too."""
_CHANCE = 0.001
"""Of noise reaching as high a bin anywhere in a channel: a line alone condemns a model."""
_MOST_AROUND = 101
"""Bins about a line that tell the level there: it changes over more."""
_LEAST_AROUND = 21
"""Likewise: fewer tell none."""
_LEAST_CYCLES = 8
"""In the record: slower, no line can be told from drift."""
_BESIDE = 1
"""Bins to either side of a line's that belong to it: a frequency between two bins shows in both."""
_PERIODOGRAM_SHARE = 4
"""The bins about a line are at most this fraction of all, for a spectrum is level over no more."""


@dataclass(frozen=True)
class Line:
    """The strongest line: its channel `row`, its frequency as a `bin` of the record, the `share` of the channel's
    levelled power, and the `signal` (c, n) of it and of the lines in other channels.
    """

    row: int
    bin: int
    share: float
    signal: FloatArray


def strongest_line(residual: FloatArray, share: float = SHARE) -> Line | None:
    """Return the strongest line of `residual` (c, n) that holds this `share` of a channel's levelled power, or None
    where none does, chance gives as much, or the record is too short to tell.
    """
    n = residual.shape[1]
    power = np.abs(fft.rfft(residual * np.hanning(n), axis=1)) ** 2
    around = min(_MOST_AROUND, power.shape[1] // _PERIODOGRAM_SHARE)
    if around < _LEAST_AROUND:
        return None
    level = median_filter(power, size=(1, around), mode="reflect")
    over = power / np.maximum(level, np.finfo(float).tiny)
    over[:, : max(around // 2, _LEAST_CYCLES)] = 0.0
    shares = over.max(axis=1) / np.maximum(over.sum(axis=1), np.finfo(float).tiny)
    found = (shares >= share) & (over.max(axis=1) >= _reached_by_chance(int(np.sum(over > 0.0)), around))
    if not found.any():
        return None
    row = int(np.argmax(np.where(found, shares, 0.0)))
    bins = fft.rfft(residual, axis=1)
    near = np.abs(np.arange(bins.shape[1]) - np.argmax(over, axis=1)[:, None]) <= _BESIDE
    signal: FloatArray = fft.irfft(np.where(near & found[:, None], bins, 0.0), n, axis=1)
    return Line(row, int(np.argmax(over[row])), float(shares[row]), signal)


def _reached_by_chance(bins: int, around: int) -> float:
    """Return x of (1)."""
    a = around / 4.0
    return float(a / np.log(2.0) * ((max(bins, 1) / _CHANCE) ** (1.0 / a) - 1.0))
