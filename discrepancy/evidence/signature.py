"""Where a remainder is: in which channels, at which frequencies, and when, if it is confined to some time."""

import numpy as np
from scipy import signal

from discrepancy.evidence.whitening import Whitening
from discrepancy.problem import Problem
from discrepancy.verdict import Signature, number
from messages.arrays import ComplexArray, FloatArray

_OF_MOST = 0.25
"""Of the strongest channel's power over the noise's: a channel with less is not named."""
_IN_BAND = (0.05, 0.95)
"""Of the power over the noise's: the shares below the band's two ends, nine tenths between them."""
_STRETCHES = 40
"""Of the recording: how finely the time of a remainder is told."""
_HELD = 0.9
"""Of a remainder's power: what the time that is told holds."""
_CONFINED = 0.4
"""Of the recording: a remainder whose time is longer is there throughout."""
_SEGMENT = 1024
"""Samples of a segment of a spectrum: a bin is about a thousandth of the rate."""
_LEAST_SEGMENTS = 4
"""Of a coherence: a recording of fewer is cut into `_SHORT_SEGMENTS`."""
_SHORT_SEGMENTS = 8
"""Of a short recording, and the fewest samples of each: with overlap, fifteen of them."""
_SEGMENTS_OF_AN_INPUT = 4
"""Segments for each input of a coherence: its bias, inputs over segments, stays below a quarter."""
_RIDGE = 1e-9
"""Of the inputs' power: inputs that say the same leave the products solvable."""


def nothing_left() -> Signature:
    """Return the signature of no remainder."""
    return Signature([], (None, None), None)


def signature(problem: Problem, white: Whitening, structured: FloatArray) -> Signature:
    """Return the signature of what is left that is not noise, `structured` (c, n) in the channels' units.

    Channels count by their power over the noise's, the band holds nine tenths of it, and `when_s` is told where nine
    tenths of it lie within two fifths of the recording.
    """
    f_hz, density = power_density(structured, problem.rate_hz)
    noise = np.maximum(white.noise_density(f_hz, problem.rate_hz), np.finfo(float).tiny)
    over = density / noise
    by_channel = over.sum(axis=0)
    if not by_channel.max() > 0.0:
        return nothing_left()
    chosen = by_channel >= _OF_MOST * by_channel.max()
    share = np.cumsum(over[:, chosen].sum(axis=1))
    low, high = (f_hz[min(np.searchsorted(share, each * share[-1]), len(f_hz) - 1)] for each in _IN_BAND)
    names = [name for name, here in zip(problem.channels.names, chosen, strict=True) if here]
    return Signature(names, (number(low), number(high)), _when(problem, white(structured)[chosen]))


def power_density(values: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Return frequencies (k,) and one-sided power densities (k, c) of `values` (c, n), unit² / Hz."""
    f_hz, density = signal.welch(values, rate_hz, nperseg=min(_SEGMENT, values.shape[1]), axis=1, detrend=False)
    return np.asarray(f_hz, dtype=np.float64), np.asarray(density.T, dtype=np.float64)


def coherence(problem: Problem, residual: FloatArray, f_hz: FloatArray) -> FloatArray:
    """Return the multiple coherence (k, c) of `residual` (c, n) with the inputs at `f_hz`, free of its bias."""
    inputs = np.nan_to_num(problem.channels.inputs.T)
    inputs = inputs[inputs.std(axis=1) > 0.0] if len(inputs) else inputs
    length = 2 * (len(f_hz) - 1)
    if not len(inputs) or problem.n < _LEAST_SEGMENTS * length:
        length = max(problem.n // _SHORT_SEGMENTS, _SHORT_SEGMENTS)
    starts = np.arange(0, problem.n - length + 1, max(length // 2, 1))
    taper = np.hanning(length)

    def pieces(rows: FloatArray) -> ComplexArray:
        stack = np.stack([rows[:, a : a + length] for a in starts])
        return np.asarray(np.fft.rfft((stack - stack.mean(axis=2, keepdims=True)) * taper, axis=2).transpose(2, 1, 0))

    own = np.fft.rfftfreq(length, 1.0 / problem.rate_hz)
    k = min(len(inputs), max(len(starts) // _SEGMENTS_OF_AN_INPUT, 0))
    if not k:
        return np.zeros((len(f_hz), problem.c))
    u, r = pieces(inputs[:k]), pieces(residual)
    cross = r @ u.conj().transpose(0, 2, 1)
    inner = u @ u.conj().transpose(0, 2, 1)
    trace = np.trace(inner, axis1=1, axis2=2).real[:, None, None] + np.finfo(float).tiny
    told = np.linalg.solve(inner + _RIDGE * trace * np.eye(k), cross.conj().transpose(0, 2, 1))
    power = np.maximum(np.sum(np.abs(r) ** 2, axis=2), np.finfo(float).tiny)
    share = np.einsum("fcu,fuc->fc", cross, told).real / power
    chance = k / len(starts)
    out = np.clip((share - chance) / (1.0 - chance), 0.0, 1.0)
    return np.column_stack([np.interp(f_hz, own, column) for column in out.T])


def _when(problem: Problem, white: FloatArray) -> tuple[float, float] | None:
    """Return the shortest time that holds nine tenths of the power of rows (c, n), if it is confined."""
    edges = np.linspace(0, problem.n, _STRETCHES + 1).astype(int)
    power = np.add.reduceat(np.sum(white**2, axis=0), edges[:-1])
    running = np.concatenate(([0.0], np.cumsum(power))) / power.sum()
    ends = np.searchsorted(running, running[:-1] + _HELD)
    lengths = np.where(ends <= _STRETCHES, ends - np.arange(_STRETCHES), _STRETCHES)
    first = int(np.argmin(lengths))
    if lengths[first] > _CONFINED * _STRETCHES:
        return None
    t_s = problem.channels.t_s
    return float(t_s[edges[first]]), float(t_s[edges[first + lengths[first]] - 1])
