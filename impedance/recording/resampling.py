"""Band-limited values of a uniform stream at other times."""

from typing import Final

import numpy as np

from messages.arrays import FloatArray

_HALF_WIDTH: Final = 24
"""Zero crossings of the sinc on either side."""
_KAISER_BETA: Final = 8.0
_SAME_TIME: Final = 1e-4
"""Of a sample period: below it two grids count as one."""
_CHUNK: Final = 4096


def resampled(t_s: FloatArray, values: FloatArray, at_s: FloatArray) -> FloatArray:
    """Return `values` (n, c), known on the uniform grid `t_s` (n,), at the times `at_s` (k,) of a uniform grid: (k, c).

    A Kaiser-windowed sinc, cut off at nine tenths of the lower Nyquist frequency, without delay. NaN wherever a sample
    within its width is missing or lies beyond the ends. Equal grids return the samples as they are.
    """
    period_s = (t_s[-1] - t_s[0]) / (len(t_s) - 1)
    at_period_s = (at_s[-1] - at_s[0]) / (len(at_s) - 1)
    position = (at_s - t_s[0]) / period_s
    if np.abs(position - np.rint(position)).max() < _SAME_TIME and abs(at_period_s / period_s - 1.0) < _SAME_TIME:
        return _taken(values, np.rint(position).astype(np.int64))
    cutoff = 0.9 * min(1.0, period_s / at_period_s)  # of the stream's own Nyquist frequency
    half = int(np.ceil(_HALF_WIDTH / cutoff))
    offsets = np.arange(-half + 1, half + 1)
    found = np.empty((len(at_s), values.shape[1]))
    for first in range(0, len(at_s), _CHUNK):
        place = position[first : first + _CHUNK]
        below = np.floor(place).astype(np.int64)
        away = place[:, None] - (below[:, None] + offsets)
        window = np.i0(_KAISER_BETA * np.sqrt(np.clip(1.0 - (away / half) ** 2, 0.0, 1.0)))
        weight = np.sinc(cutoff * away) * window
        weight /= weight.sum(axis=1, keepdims=True)
        near = _taken(values, below[:, None] + offsets)
        found[first : first + _CHUNK] = np.einsum("kw,kwc->kc", weight, near)
    return found


def _taken(values: FloatArray, index: np.ndarray[tuple[int, ...], np.dtype[np.int64]]) -> FloatArray:
    """Return `values[index]`, NaN beyond the ends."""
    inside = (index >= 0) & (index < len(values))
    taken: FloatArray = np.where(inside[..., None], values[np.clip(index, 0, len(values) - 1)], np.nan)
    return taken
