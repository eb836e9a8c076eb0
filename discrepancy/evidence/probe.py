"""What of a residual follows from the inputs, out of sample.

The whitened residual is predicted from the functions of `features` by ridge regression, fitted on four fifths of the
recording's stretches and judged on the others: only what holds out of sample counts. Its law under noise alone is had
from the residual itself with random signs, one for each stretch (a wild bootstrap, Wu 1986): they keep the noise's
colour and changing level and break what follows from the inputs. Everything is done on sums over stretches, so that a
draw costs no pass over the samples, and in the band where the functions have power.

What a system's own dynamics make of a missing force is as smooth as coloured noise, and an autoregression

    r_t = Σ_i a_i r_{t−i} + e_t                                                                                    (1)

takes it for that. The curves of `features` are therefore held against the innovations themselves,

    r_t = Σ_i a_i r_{t−i} + Σ_j w_j g_j(u_t, ŷ_t) + e_t                                                            (2)

with ŷ the predicted output. The a_i are as free in (2) as in (1): the lags are projected out of
every g_j (Frisch and Waugh 1933), so that only what they cannot say for it counts. So is whatever is linear in u and ŷ:
noise of a measured input is in the innovations too.
"""

from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.signal import lfilter

from discrepancy.evidence.features import curves, features
from discrepancy.evidence.whitening import Whitening, past
from discrepancy.problem import Problem
from messages.arrays import BoolArray, ComplexArray, FloatArray

_STRETCHES = 40
"""Of a long recording, each with a sign of its own: eight for each fold, and each long beside the noise's memory."""
_LEAST_STRETCHES = 10
"""Of a short recording: two for each fold."""
_LEAST_LENGTH = 10
"""Samples of a stretch: in a shorter one neighbours' random signs would break the noise's own colour too."""
_FOLDS = 5
"""Parts of the stretches: each is predicted from the other four fifths."""
_DRAWS = 150
"""Of signs: the least chance that they can tell, 1 / 151, lies below `_CHANCE`."""
_RIDGES = (0.01, 0.3)
"""Of a function's power: little where few functions tell much, much where many tell a little each."""
_KEPT_POWER = 0.999
"""Of the functions' whitened power, which the band holds: beyond it they can predict next to nothing."""
_SPECTRA = 24
"""Functions of a group, at least, whose spectra tell its band: the others' are like theirs."""
_LEAST_POINTS, _MOST_POINTS = 512, 6000
"""Of the band: fewer would be a dozen for each stretch; memory and time grow with their number."""
_LEAST_SPREAD = 1e-12
"""Of a gain over the draws: a smaller one is rounding, and would make any gain stand out."""
_CHANCE = 0.01
"""Of noise being predicted as well by the best group and ridge: what is likelier is not believed."""
_AVERAGED = (1, 8)
"""Past samples over which curves are averaged: the autoregression spreads over many what acted at one."""
_LOADING = 1e-6
"""Of a signal's power: lags that say the same share one weight."""
_MOST_GROUPS = 3
"""Groups of functions used, one on what the other leaves: each costs as much as the first, and finds less."""


@dataclass(frozen=True)
class Predictable:
    """What of a residual follows from the inputs out of sample: `signal` (c, n), `share` (c,) of the whitened power in
    the band, and its `chance` under noise alone; `groups` are the kinds of functions that tell it.
    """

    signal: FloatArray
    share: FloatArray
    chance: float
    groups: tuple[str, ...]


@dataclass(frozen=True)
class _Group:
    name: str
    raw: FloatArray  # (c, f, n)
    white: FloatArray  # (c, f, d)
    gram: FloatArray  # (stretches, c, f, f)
    inside: bool  # whether the functions tell innovations, as in (2), and not the residual


class Probe:
    """Functions of the inputs of one recording, whitened for each channel: what residuals are searched with.

    `predicted` and `residual` (c, n) are those of the model whose noise `white` tells.
    """

    def __init__(
        self, problem: Problem, white: Whitening, predicted: FloatArray, residual: FloatArray, seed: int
    ) -> None:
        self._problem = problem
        self._c, self._n = problem.c, problem.n
        inputs = np.ascontiguousarray(problem.channels.inputs.T)
        finite = np.where(np.isfinite(predicted) & (not problem.channels.shared_noise), predicted, np.nan)
        inputs = inputs.reshape(-1, self._n)
        groups = features(inputs, finite)
        self._reach = min(white.reach, self._n - 1)
        self._padded = fft.next_fast_len((self._n + self._reach + 1) // 2, real=True) * 2
        self._response = fft.rfft(white.kernels[:, : self._reach + 1], self._padded, axis=1)
        self._stretches = int(np.clip(self._n // _LEAST_LENGTH, _LEAST_STRETCHES, _STRETCHES))
        self._points = self._band(groups)
        spacing = self._padded / self._points
        at = np.arange(self._points) * spacing - self._reach
        self._inside = (at >= 0.0) & (at <= self._n - 1)
        self._at = at[self._inside]
        kept = problem.valid[:, np.round(self._at).astype(int)]
        self._kept: BoolArray = kept
        self._stretch = np.minimum((self._at * self._stretches / self._n).astype(int), self._stretches - 1)
        self._edges = np.searchsorted(self._stretch, np.arange(self._stretches + 1))
        self._kernels = white.kernels
        self._groups = [self._group(name, raw) for name, raw in groups.items()]
        found = curves(inputs, finite)
        if len(found.bent):
            straight = [_averaged(found.straight, each) for each in _AVERAGED]
            self._groups += [
                self._inside_group("curves", _averaged(found.bent, each), np.concatenate(straight), residual)
                for each in _AVERAGED
            ]
        rng = np.random.default_rng(seed)
        self._signs = np.concatenate(
            (np.ones((1, self._stretches)), rng.choice((-1.0, 1.0), (_DRAWS, self._stretches)))
        )

    def predictable(self, residual: FloatArray) -> Predictable:
        """Return what of `residual` (c, n) follows from the inputs."""
        left = residual.copy()
        signal = np.zeros_like(residual)
        power = self._power(residual)
        used: list[str] = []
        least = 1.0
        for _ in range(_MOST_GROUPS):
            chance, group, ridge_, gain = self._best(left)
            least = min(least, chance)
            if chance > _CHANCE or group.name in used:
                break
            part = self._predicted(left, group, ridge_)
            part[gain <= 0.0] = 0.0
            signal += part
            left -= part
            used.append(group.name)
        share = np.clip(1.0 - self._power(left) / np.maximum(power, np.finfo(float).tiny), 0.0, 1.0)
        return Predictable(signal, share if used else np.zeros(self._c), least, tuple(used))

    def _band(self, groups: dict[str, FloatArray]) -> int:
        """Return how many points hold the band with all but a thousandth of the functions' whitened power."""
        bins = self._padded // 2 + 1
        power = np.zeros(bins)
        for raw in groups.values():
            density = np.abs(fft.rfft(raw[:: max(1, len(raw) // _SPECTRA)], self._padded, axis=1)) ** 2
            for response in self._response:
                filtered = density * np.abs(response) ** 2
                power += (filtered / np.maximum(filtered.sum(axis=1, keepdims=True), np.finfo(float).tiny)).sum(axis=0)
        held = np.searchsorted(np.cumsum(power), _KEPT_POWER * power.sum()) + 1
        return int(np.clip(2 * held, min(_LEAST_POINTS, self._padded), min(self._padded, _MOST_POINTS))) // 2 * 2

    def _white(self, values: FloatArray, response: ComplexArray) -> FloatArray:
        """Return rows (f, n) through filters (f or 1, k), at the band's points, so that unit white noise stays so."""
        padded = np.concatenate((values[:, self._reach : 0 : -1], values), axis=1)
        spectrum = fft.rfft(padded, self._padded, axis=1)[:, : self._points // 2 + 1]
        spectrum = spectrum * response[:, : self._points // 2 + 1]
        out: FloatArray = fft.irfft(spectrum, self._points, axis=1) * np.sqrt(self._points / self._padded)
        return out[:, self._inside]

    def _group(self, name: str, raw: FloatArray) -> _Group:
        white = np.stack(
            [self._white(raw, response[None]) * kept for response, kept in zip(self._response, self._kept, strict=True)]
        )
        return self._grouped(name, np.broadcast_to(raw, (self._c, *raw.shape)), white, inside=False)

    def _inside_group(self, name: str, raw: FloatArray, straight: FloatArray, residual: FloatArray) -> _Group:
        """Return functions (f, n) that act on the innovations, without what the residual's own past and the signals
        (s, n) can say for them.
        """
        free = np.empty((self._c, *raw.shape))
        for row, r in enumerate(residual):
            lags = past(r) / max(float(np.sqrt(r @ r / len(r))), np.finfo(float).tiny)
            told = np.concatenate((lags, straight)) * self._problem.valid[row]
            inner = told @ told.T
            inner[np.diag_indices(len(told))] += _LOADING * len(r)
            free[row] = raw - np.linalg.solve(inner, told @ raw.T).T @ told
        plain = np.ones((1, self._response.shape[1]), dtype=np.complex128)
        white = np.stack([self._white(each, plain) * kept for each, kept in zip(free, self._kept, strict=True)])
        return self._grouped(name, free, white, inside=True)

    def _grouped(self, name: str, raw: FloatArray, white: FloatArray, *, inside: bool) -> _Group:
        size = np.sqrt(np.maximum((white**2).mean(axis=2, keepdims=True), np.finfo(float).tiny))
        white /= size
        gram = np.empty((self._stretches, self._c, raw.shape[1], raw.shape[1]))
        for row, (a, b) in enumerate(zip(self._edges[:-1], self._edges[1:], strict=True)):
            part = white[:, :, a:b]
            gram[row] = part @ part.transpose(0, 2, 1)
        return _Group(name, raw / size, white, gram, inside)

    def _scores(self, residual: FloatArray, group: _Group) -> FloatArray:
        """Return the functions' scores with the unit residual, (stretches, c, f)."""
        e = self._white(residual, self._response) * self._kept
        e /= np.sqrt(np.maximum((e**2).sum(axis=1) / np.maximum(self._kept.sum(axis=1), 1), np.finfo(float).tiny))[
            :, None
        ]
        return np.stack(
            [
                np.einsum("cft,ct->cf", group.white[:, :, a:b], e[:, a:b], optimize=True)
                for a, b in zip(self._edges[:-1], self._edges[1:], strict=True)
            ]
        )

    def _best(self, residual: FloatArray) -> tuple[float, _Group, float, FloatArray]:
        """Return chance, group and ridge of the best prediction, and its gain by channel (c,)."""
        gains, which = [], []
        for group in self._groups:
            gains.append(self._gains(self._scores(residual, group), group))
            which += [(group, ridge_) for ridge_ in _RIDGES]
        table = np.concatenate(gains)  # (methods, channels, draws)
        table = np.concatenate((table, table.sum(axis=1, keepdims=True)), axis=1)
        mean, spread = table[:, :, 1:].mean(axis=2), table[:, :, 1:].std(axis=2)
        standing = (table - mean[:, :, None]) / np.maximum(spread, _LEAST_SPREAD)[:, :, None]
        standing = np.where(table > 0.0, standing, -np.inf)
        top = standing.reshape(-1, standing.shape[2]).max(axis=0)
        chance = float((1 + np.sum(top[1:] >= top[0])) / len(top))
        by_method = table[:, -1, 0] if np.any(table[:, -1, 0] > 0.0) else table[:, :-1, 0].max(axis=1)
        method = int(np.argmax(by_method))
        return chance, *which[method], table[method, :-1, 0]

    def _gains(self, scores: FloatArray, group: _Group) -> FloatArray:
        """Return by how much the out-of-sample square falls, (ridges, c, draws), for the residual and its sign
        flips.
        """
        out = np.zeros((len(_RIDGES), self._c, len(self._signs)))
        fold = np.arange(self._stretches) % _FOLDS
        whole = self._flipped(scores, np.ones(self._stretches, bool), self._signs)
        gram_whole = group.gram.sum(axis=0)
        for k in range(_FOLDS):
            z = self._flipped(scores, fold == k, self._signs)
            gram = group.gram[fold == k].sum(axis=0)
            for row, ridge_ in enumerate(_RIDGES):
                weights = self._weights(whole - z, gram_whole - gram, ridge_)
                out[row] += np.sum(weights * (2.0 * z - gram @ weights), axis=1)
        return out

    def _flipped(self, scores: FloatArray, here: BoolArray, signs: FloatArray) -> FloatArray:
        """Return the scores (c, f, draws) of some stretches under the signs (draws, stretches)."""
        return np.asarray(np.tensordot(scores[here], signs[:, here], axes=(0, 1)), dtype=np.float64)

    def _weights(self, z: FloatArray, gram: FloatArray, ridge_: float) -> FloatArray:
        return np.asarray(np.linalg.solve(gram + ridge_ * len(self._at) * np.eye(gram.shape[1]), z), dtype=np.float64)

    def _predicted(self, residual: FloatArray, group: _Group, ridge_: float) -> FloatArray:
        """Return the out-of-sample prediction (c, n) of a residual in its own units."""
        scores = self._scores(residual, group)
        e = self._white(residual, self._response) * self._kept
        level = np.sqrt((e**2).sum(axis=1) / np.maximum(self._kept.sum(axis=1), 1))
        fold = np.minimum(np.arange(self._n) * self._stretches // self._n, self._stretches - 1) % _FOLDS
        out = np.zeros_like(residual)
        ones = np.ones((1, self._stretches))
        for k in range(_FOLDS):
            train = np.arange(self._stretches) % _FOLDS != k
            z = self._flipped(scores, train, ones)
            weights = self._weights(z, group.gram[train].sum(axis=0), ridge_)[:, :, 0]
            here = fold == k
            for row in range(self._c):
                out[row, here] = level[row] * (weights[row] @ group.raw[row][:, here])
        return self._coloured(out, residual) if group.inside else out

    def _coloured(self, innovations: FloatArray, residual: FloatArray) -> FloatArray:
        """Return what innovations (c, n) become in the residual behind the lags of (1), no louder than it is."""
        out = np.zeros_like(innovations)
        for row, kernel in enumerate(self._kernels):
            if innovations[row].any():
                with np.errstate(all="ignore"):
                    told = np.asarray(lfilter([1.0], kernel, innovations[row]), dtype=np.float64)
                loud = np.sqrt((residual[row] @ residual[row]) / max(float(told @ told), np.finfo(float).tiny))
                out[row] = told * min(float(loud), 1.0) if np.isfinite(loud) else innovations[row]
        return out

    def _power(self, residual: FloatArray) -> FloatArray:
        return np.asarray(np.sum((self._white(residual, self._response) * self._kept) ** 2, axis=1), dtype=np.float64)


def _averaged(rows: FloatArray, samples: int) -> FloatArray:
    """Return rows (f, n), each the mean of its last `samples`; before its beginning a row is its first value."""
    held = np.concatenate((np.repeat(rows[:, :1], samples, axis=1), rows), axis=1)
    total = np.cumsum(held, axis=1)
    return np.asarray((total[:, samples:] - total[:, :-samples]) / samples, dtype=np.float64)
