"""Integrals of what is known at samples, and values between them."""

import numpy as np

from messages.arrays import FloatArray


def integral(t_s: FloatArray, rates: FloatArray) -> FloatArray:
    """Return ∫ rates dt (m, c) from the first time on, by the trapezoidal rule."""
    total = np.zeros_like(rates)
    np.cumsum(0.5 * np.diff(t_s)[:, None] * (rates[1:] + rates[:-1]), axis=0, out=total[1:])
    return total


def interpolated(times_s: FloatArray, t_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return `values` (m, c), known at `t_s` (m,), at `times_s` (...), between them: (..., c)."""
    after = np.clip(np.searchsorted(t_s, times_s), 1, len(t_s) - 1)
    share = ((times_s - t_s[after - 1]) / (t_s[after] - t_s[after - 1]))[..., None]
    between: FloatArray = values[after - 1] + share * (values[after] - values[after - 1])
    return between
