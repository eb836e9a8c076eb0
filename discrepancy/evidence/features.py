"""What might follow from the inputs in a way nobody thought of: a bank of plain functions of inputs and predictions.

Five groups, each judged by itself, so that a few telling functions are not drowned by many others: the inputs and their
neighbourhood in time, their products, their odd and even distortions, distortions of the predicted outputs, and time.
Beside them, curves of single signals, for what acts inside the system and shows only behind its dynamics.
"""

from dataclasses import dataclass

import numpy as np

from messages.arrays import FloatArray

_MOST_INPUTS = 12
"""Principal components of inputs, or of outputs, of which functions are made: the largest group holds seven of each."""
_MOST_MULTIPLIED = 8
"""The strongest of these, which are multiplied in pairs: 36 products, where twelve would make 78."""
_CORRELATED = 0.7
"""Autocorrelation at a lag: after a shorter one an input still says much the same."""
_LONGEST_LAG_SHARE = 8
"""The longest lag is this fraction of the recording, as an autocorrelation needs several of them."""
_SHIFTS = (-4, -1, 1, 4)
"""Lags by which inputs are shifted: next to the present, and well away from it, before and after."""
_HIGH = 0.9
"""Quantile of an output's magnitude: what lies above may be cut off by a limit."""
_CURVES = 60
"""Functions in all that make curves of the signals: as many as the other groups have."""
_LEAST_OF_A_CURVE, _MOST_OF_A_CURVE = 4, 20
"""Of these for one signal: a bend at the least, three teeth of a cogging motor at the most."""
_SAMPLES_OF_A_CURVE = 20
"""Of the recording, for each of these functions: in a shorter one a few samples at an end would weigh all."""
_ENDS = (0.005, 0.995)
"""Quantiles of a signal between which its curve is free: beyond them hardly a sample tells it."""
_NEIGHBOURS = (-2, -1, 0, 1, 2)
"""Samples by which a signal is shifted so that whatever is linear in it is said without a curve."""
_VARIES = 1e-12
"""Of a row's largest magnitude: what varies less is a constant, but for rounding."""


def features(inputs: FloatArray, predicted: FloatArray) -> dict[str, FloatArray]:
    """Return the groups (f, n) of functions of `inputs` (k, n) and `predicted` outputs (c, n), each of unit power."""
    u = _principal(_standard(inputs), _MOST_INPUTS)
    y = _principal(_standard(predicted), _MOST_INPUTS)
    n = predicted.shape[1]
    tau = np.linspace(-1.0, 1.0, n)
    groups = {"time": [tau, tau**2 - 1.0 / 3.0, *(y * tau)]}
    if len(u):
        lag = _lag(u)
        shifts = [np.roll(u, k * lag, axis=1) for k in _SHIFTS]
        rate = np.gradient(u, axis=1)
        few = _principal(u, _MOST_MULTIPLIED)
        rows, columns = np.triu_indices(len(few))
        groups |= {
            "lags": [*u, *rate, *np.gradient(rate, axis=1), *np.concatenate(shifts)],
            "products": [*(few[rows] * few[columns])],
            "distortions": [*np.sign(rate), *np.abs(u), *(u**3), *np.sign(u)],
        }
    if len(y):
        high = np.quantile(np.abs(y), _HIGH, axis=1)[:, None]
        slope = np.gradient(y, axis=1)
        groups["outputs"] = [*y, *(y**2), *(y**3), *(y - np.clip(y, -high, high)), *slope, *np.sign(slope)]
    return {name: _standard(np.array(rows_)) for name, rows_ in groups.items()}


@dataclass(frozen=True)
class Curves:
    """Functions (f, n) that add up to any piecewise linear curve of one input, of one predicted output, or of its rate
    of change, and the signals themselves (s, n) beside their neighbours in time, all of unit power.
    """

    bent: FloatArray
    straight: FloatArray


def curves(inputs: FloatArray, predicted: FloatArray) -> Curves:
    """Return curves of inputs (k, n) and predicted outputs (c, n).

    A friction, a cogging, a spring that hardens is such a curve, whatever its formula.
    """
    u = _principal(_standard(inputs), _MOST_INPUTS)
    y = _principal(_standard(predicted), _MOST_INPUTS)
    signals = np.concatenate((u, y, _standard(np.gradient(y, axis=1))))
    n = predicted.shape[1]
    most = min(_CURVES, n // _SAMPLES_OF_A_CURVE)
    knots = int(np.clip(most // max(len(signals), 1), _LEAST_OF_A_CURVE, _MOST_OF_A_CURVE))
    rows = [np.zeros((0, n))]
    for each in signals:
        low, high = np.quantile(each, _ENDS)
        place = np.clip((each - low) / max(high - low, _VARIES), 0.0, 1.0) * (knots - 1)
        rows.append(np.clip(1.0 - np.abs(place - np.arange(knots)[:, None]), 0.0, None))
    straight = [np.roll(np.concatenate((u, y)), shift, axis=1) for shift in _NEIGHBOURS]
    return Curves(_standard(np.concatenate(rows)), _standard(np.concatenate(straight)))


def _standard(values: FloatArray) -> FloatArray:
    """Return the rows (k, n) that vary, without gaps, mean 0 and power 1."""
    kept = []
    for row in values:
        there = np.isfinite(row)
        if there.sum() < 2:
            continue
        filled = row if there.all() else np.interp(np.arange(len(row)), np.flatnonzero(there), row[there])
        spread = float(np.std(filled))
        if spread > _VARIES * float(np.max(np.abs(filled))):
            kept.append((filled - np.mean(filled)) / spread)
    return np.array(kept).reshape(len(kept), values.shape[-1])


def _principal(u: FloatArray, most: int) -> FloatArray:
    """Return `u` (k, n), or its `most` strongest principal components where it has more rows."""
    if len(u) <= most:
        return u
    _, vectors = np.linalg.eigh(u @ u.T)
    return _standard(vectors[:, ::-1][:, :most].T @ u)


def _lag(u: FloatArray) -> int:
    """Return the samples in which the inputs' autocorrelation falls to `_CORRELATED`, the median over inputs."""
    n = u.shape[1]
    power = np.abs(np.fft.rfft(u, 2 * n, axis=1)) ** 2
    correlation = np.fft.irfft(power, axis=1)[:, : max(n // _LONGEST_LAG_SHARE, 2)] / n
    falls = [int(np.argmax(row < _CORRELATED)) or len(row) - 1 for row in correlation]
    return max(int(np.median(falls)), 1)
