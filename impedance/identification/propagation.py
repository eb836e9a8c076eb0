"""Errors of what was measured, carried through any function to first order."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from messages.arrays import FloatArray

_STEP = 1e-4


@dataclass(frozen=True)
class Propagated:
    """Results (k,) and their covariance (k, k) from independent errors of what was measured."""

    value: FloatArray
    covariance: FloatArray

    @property
    def deviation(self) -> FloatArray:
        """Return the standard deviations (k,)."""
        return np.sqrt(np.diag(self.covariance))


def propagated(function: Callable[[FloatArray], FloatArray], measured: FloatArray, deviation: FloatArray) -> Propagated:
    """Return function(measured) and J diag(σ²) Jᵀ, J by central differences of a ten-thousandth of each deviation.

    `measured` and `deviation` (n,); a deviation of zero means exact.
    """
    slopes = np.zeros((len(function(measured)), len(measured)))
    for column in np.flatnonzero(deviation > 0.0):
        step = np.zeros(len(measured))
        step[column] = _STEP * deviation[column]
        slopes[:, column] = (function(measured + step) - function(measured - step)) / (2.0 * step[column])
    return Propagated(function(measured), slopes @ np.diag(deviation**2) @ slopes.T)
