"""Integrals of what is known at samples, and values between them."""

import numpy as np

from messages.arrays import FloatArray


def integral(t_s: FloatArray, rates: FloatArray) -> FloatArray:
    """Return ∫ rates dt (m, c) from the first time on, by the trapezoidal rule."""
    total = np.zeros_like(rates)
    np.cumsum((0.5 * (t_s[1:] - t_s[:-1]))[:, None] * (rates[1:] + rates[:-1]), axis=0, out=total[1:])
    return total


def interpolated(times_s: FloatArray, t_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return `values` (m, c), known at `t_s` (m,), at `times_s` (...), between them: (..., c)."""
    after = 1 + t_s[1:-1].searchsorted(times_s)
    before = after - 1
    share = ((times_s - t_s[before]) / (t_s[after] - t_s[before]))[..., None]
    value_before = values.take(before, axis=0)
    between: FloatArray = value_before + share * (values.take(after, axis=0) - value_before)
    return between
