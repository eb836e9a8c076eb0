"""Noise of unknown level and colour, made white: a filter for each channel, then one mixing of the channels.

The filter predicts a residual from its own past,

    e_t = r_t − Σ_i a_i r_{t−i} − Σ_j b_j mean(r over the lags of band j)                                           (1)

with single lags where colour is fine, and bands of lags twice as long each beyond (a heterogeneous autoregression,
Corsi 2009), so that slow drift of the 1/f kind is met with two dozen numbers. The channels' innovations are then
mixed by the inverse Cholesky factor of their covariance. After that the likelihood of a model is that of independent
unit noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from scipy import fft
from scipy.ndimage import binary_dilation

from messages.arrays import BoolArray, ComplexArray, FloatArray

_MOST_LAGS = 32
"""Single lags, in samples: beyond, colour is slow enough for bands of them."""
_LEAST_LAGS = 2
"""Likewise, of a short recording: the least that tells a resonance."""
_SAMPLES_OF_A_LAG = 60
"""Of the recording, for each single lag: each weight is estimated from so many."""
_LONGEST_LAG_SHARE = 12
"""The longest lag is at most this fraction of the recording: slower noise is seen too few times."""
LOADING = 1e-5
"""Of a residual's power: white noise assumed below it, so that bands without any noise cannot outweigh all."""
_RUN_IN = 8
"""Samples after a gap that do not count: by then the filter, whose first lags weigh most, sees mostly true ones."""
_MIXED_SHARE = 0.9
"""Of the channel with most samples, those that all have: channels are mixed only where few samples are lost by it."""
_MOST_MIXED = 16
"""Channels: the covariance of more has too many entries for a short recording."""
_COVARIANCE_LOADING = 1e-9
"""Of each channel's innovation: channels that hold the same noise leave their covariance invertible."""
_LEAST_RESPONSE = 1e-300
"""Of a filter, squared: where it takes all away, the density stays finite."""


class White(Protocol):
    """What makes the noise of one recording, or of several one after another, white, and tells its likelihood."""

    @property
    def count(self) -> int:
        """Return how many whitened samples count."""

    @property
    def log_det(self) -> float:
        """Return the logarithm of the noise's determinant: −2 log likelihood = `log_det` + ‖whitened‖²."""

    def __call__(self, values: FloatArray) -> FloatArray:
        """Return `values` (..., c, n) whitened, zero where they do not count."""


@dataclass(frozen=True)
class Whitening:
    """Filters and mixing for a recording of n samples and c channels.

    `kernels` (c, l) are the filters, 1 first, `response` (c, k) their frequency response on the padded transform,
    `reach` their longest lag, `mix` (c, c) turns innovations into unit noise, `kept` (c, n) tells which whitened
    samples count, `log_det` is the logarithm of the noise's determinant per sample, summed over what counts: −2 log
    likelihood = `log_det` + ‖whitened‖².
    """

    kernels: FloatArray
    response: ComplexArray
    reach: int
    mix: FloatArray
    kept: BoolArray
    log_det: float

    @property
    def count(self) -> int:
        """Return how many whitened samples count."""
        return int(self.kept.sum())

    def __call__(self, values: FloatArray) -> FloatArray:
        """Return `values` (..., c, n) whitened, zero where they do not count."""
        white: FloatArray = np.matmul(self.mix, _filtered(values, self.response, self.reach))
        white *= self.kept
        return white

    def innovations(self, values: FloatArray) -> FloatArray:
        """Return `values` (..., c, n) less what their own past tells of them, in the channels' units."""
        return _filtered(values, self.response, self.reach)

    def noise_density(self, f_hz: FloatArray, rate_hz: float) -> FloatArray:
        """Return the one-sided power density (k, c) of the noise at `f_hz`, unit² / Hz."""
        grid = np.linspace(0.0, 0.5 * rate_hz, self.response.shape[1])
        innovation = np.diag(np.linalg.inv(self.mix) @ np.linalg.inv(self.mix).T)
        density = 2.0 / rate_hz * innovation[:, None] / np.maximum(np.abs(self.response) ** 2, _LEAST_RESPONSE)
        return np.column_stack([np.interp(f_hz, grid, row) for row in density])


@dataclass(frozen=True)
class Unfiltered:
    """Noise taken for white: `weight` (c, n) is one over its deviation, 0 where a sample does not count."""

    weight: FloatArray

    @property
    def count(self) -> int:
        """Return how many samples count."""
        return int(np.sum(self.weight > 0.0))

    @property
    def log_det(self) -> float:
        """Return the logarithm of the noise's determinant."""
        return -2.0 * float(np.log(self.weight[self.weight > 0.0]).sum())

    def __call__(self, values: FloatArray) -> FloatArray:
        """Return `values` (..., c, n) in deviations of the noise."""
        return np.asarray(values * self.weight, dtype=np.float64)


def unfiltered(residual: FloatArray, valid: BoolArray) -> Unfiltered:
    """Return what takes a `residual` (c, n), for want of anything better, for white noise in each channel.

    A filter would take a constant error for slow noise, and a fit under it would leave it there.
    """
    power = np.sum(residual**2 * valid, axis=1) / np.maximum(valid.sum(axis=1), 1)
    return Unfiltered(valid / np.sqrt(np.where(power > 0.0, power, 1.0))[:, None])


@dataclass(frozen=True)
class JointWhitening:
    """Several recordings one after another, each with its own noise; the p-th has the samples from `edges[p]` on."""

    parts: Sequence[Whitening]
    edges: Sequence[int]

    @property
    def count(self) -> int:
        """Return how many whitened samples count."""
        return sum(part.count for part in self.parts)

    @property
    def log_det(self) -> float:
        """Return the logarithm of the noise's determinant."""
        return sum(part.log_det for part in self.parts)

    def __call__(self, values: FloatArray) -> FloatArray:
        """Return `values` (..., c, n) whitened, zero where they do not count."""
        ends = pairwise(self.edges)
        return np.concatenate([part(values[..., a:b]) for part, (a, b) in zip(self.parts, ends, strict=True)], axis=-1)


def whitening(residual: FloatArray, valid: BoolArray, loading: float = LOADING) -> Whitening:
    """Return the whitening under which `residual` (c, n), filled where not `valid`, is unit noise, with white noise
    of the share `loading` of its power beside it.
    """
    c, n = residual.shape
    bands = _bands(n)
    reach = bands[-1][1]
    padded = fft.next_fast_len((n + reach + 1) // 2, real=True) * 2
    kept = valid & ~_after_gap(valid)
    kernels = np.zeros((c, reach + 1))
    for row in range(c):
        if kept[row].any():
            kernels[row] = _kernel(residual[row], kept[row], bands, loading)
    response = fft.rfft(kernels, padded, axis=1)
    innovations = _filtered(residual, response, reach)
    together = kept.all(axis=0)
    if c <= _MOST_MIXED and together.sum() >= _MIXED_SHARE * kept.sum(axis=1).max():
        kept = np.broadcast_to(together, kept.shape).copy()
        counted = innovations[:, together]
        covariance = counted @ counted.T / counted.shape[1]
        covariance[np.diag_indices(c)] *= 1.0 + _COVARIANCE_LOADING
        covariance[np.diag_indices(c)] += np.finfo(float).tiny
        lower = np.linalg.cholesky(covariance)
        mix = np.linalg.inv(lower)
    else:
        power = (innovations**2 * kept).sum(axis=1) / np.maximum(kept.sum(axis=1), 1)
        mix = np.diag(1.0 / np.sqrt(np.where(power > 0.0, power, 1.0)))
    log_det = -2.0 * float(np.log(np.diag(mix)) @ kept.sum(axis=1))
    return Whitening(kernels, response, reach, mix, kept, log_det)


def past(residual: FloatArray) -> FloatArray:
    """Return what the filter of (1) predicts a residual (n,) from, (b, n): its single lags and its bands of them."""
    return _past(residual, _bands(len(residual)))


def _past(r: FloatArray, bands: list[tuple[int, int]]) -> FloatArray:
    n, longest = len(r), bands[-1][1]
    total = np.concatenate(([0.0], np.cumsum(np.concatenate((r[longest:0:-1], r)))))
    at = np.arange(n) + longest
    rows = np.empty((len(bands), n))
    for row, (first, last) in enumerate(bands):
        rows[row] = (total[at - first + 1] - total[at - last]) / (last - first + 1)
    return rows


def _filtered(values: FloatArray, response: ComplexArray, reach: int) -> FloatArray:
    """Return `values` (..., c, n) through the filters; before its beginning a record is taken for its own mirror image.

    The transform's wrap reaches into the mirror image only.
    """
    padded = 2 * (response.shape[1] - 1)
    spectrum = fft.rfft(np.concatenate((values[..., reach:0:-1], values), axis=-1), padded, axis=-1)
    spectrum *= response
    out: FloatArray = fft.irfft(spectrum, padded, axis=-1)[..., reach : reach + values.shape[-1]]
    return out


def _bands(n: int) -> list[tuple[int, int]]:
    """Return first and last lag of each regressor of (1)."""
    single = int(np.clip(n // _SAMPLES_OF_A_LAG, _LEAST_LAGS, _MOST_LAGS))
    bands = [(lag, lag) for lag in range(1, single + 1)]
    while 2 * bands[-1][1] <= n // _LONGEST_LAG_SHARE:
        first = bands[-1][1] + 1
        bands.append((first, 2 * (first - 1)))
    return bands


def _after_gap(valid: BoolArray) -> BoolArray:
    """Return the samples (c, n) that follow a gap, or the beginning, too soon for the filter."""
    missing = np.concatenate((np.ones((len(valid), 1), bool), ~valid), axis=1)
    reach = np.zeros((1, 2 * _RUN_IN + 1), bool)
    reach[:, _RUN_IN:] = True
    soon: BoolArray = binary_dilation(missing, structure=reach)[:, 1:]
    return soon


def _kernel(r: FloatArray, kept: BoolArray, bands: list[tuple[int, int]], loading: float) -> FloatArray:
    """Return the filter of (1) for one channel (n,): 1, then minus the weight of every lag."""
    use = _past(r, bands)[:, kept]
    gram = use @ use.T
    gram[np.diag_indices(len(bands))] += loading * float(r[kept] @ r[kept]) + np.finfo(float).tiny
    weight = np.linalg.solve(gram, use @ r[kept])
    kernel = np.zeros(bands[-1][1] + 1)
    kernel[0] = 1.0
    for value, (first, last) in zip(weight, bands, strict=True):
        kernel[first : last + 1] = -value / (last - first + 1)
    return kernel
