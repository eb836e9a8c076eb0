"""Solves the steps of an integrator for many samples at once, which is what a Python loop over them gives, but faster.

The states at the samples of a window, x₁ … x_w, are those for which all steps hold together:

    xᵢ₊₁ = Φ(xᵢ)                                                                                                   (1)

Newton's method linearises all steps at once, and what corrects the states follows from one recursion:

    δᵢ₊₁ = Aᵢ δᵢ + Φ(xᵢ) − xᵢ₊₁,   Aᵢ = ∂Φ/∂x (xᵢ)                                                                  (2)

which is a triangular band of equations (Lim et al., Parallelizing non-linear sequential models, 2024).
"""

from collections.abc import Callable

import numpy as np
from scipy.linalg.blas import dtbsv

from messages.arrays import BoolArray, FloatArray, IntArray

_AT_ONCE = 4096
"""Samples of all sets of parameters in a window: fewer leave Python's own cost, more the processor's memory."""
_WIDEST, _NARROWEST = 2048, 16
"""Samples of a window: where a wide one does not converge, one a quarter as wide may, at last a loop over samples."""
_ROUNDS = 16
"""Of Newton's method: it converges sooner, or the window is too wide."""
_NEAR, _FALLS = 0.01, 0.1
"""Of a state's size: once a round moves it by less, and each by a tenth of the one before, the slopes are kept."""
_CONVERGED = 1e-11
"""Of a state's size: what a whitening filter makes of smaller errors is below any noise."""
_STEP = 1e-6
"""Of a state's size, for its derivative."""

Step = Callable[[FloatArray, int], FloatArray]
"""From states (s, k, w) at w samples and the first one's number: the states one sample later."""


def march(step_of: Callable[[IntArray], Step], begun: FloatArray, n: int) -> FloatArray:
    """Return the states (s, k, n) of all samples from those `begun` (s, k) with; not finite where they diverged.

    `step_of` gives the step of some of the k sets of parameters. Those for which the method does not converge are left
    behind, and go on by themselves in narrower windows: one that strikes a stop must not hold up the others.
    """
    s, k = begun.shape
    path = np.full((s, k, n), np.nan)
    path[:, :, 0] = begun
    rows = np.arange(k)
    width = _WIDEST
    while len(rows):
        wide = min(width, 1 << max(_AT_ONCE // len(rows), 4 * _NARROWEST).bit_length() - 1)
        own = path[:, rows]
        behind = _marched(step_of(rows), own, wide if width >= _NARROWEST else 1)
        path[:, rows] = own
        rows = rows[behind]
        width = min(width, wide) // 4
    return path


def _marched(step: Step, path: FloatArray, widest: int) -> BoolArray:
    """Fill in the states (s, k, n) of all samples but the first, and return which sets are left behind."""
    n = path.shape[2]
    size = np.maximum(np.abs(path[:, :, 0]), 1.0)
    behind = np.zeros(path.shape[1], bool)
    i = 0
    while i < n - 1:
        alive = np.isfinite(path[:, :, i]).all(axis=0) & ~behind
        if not alive.any():
            break
        w = min(widest, n - 1 - i)
        if w > 1:
            found, converged = _window(step, path[:, :, i], i, w, size, alive)
            behind |= alive & ~converged
            path[:, :, i + 1 : i + 1 + w] = np.where(converged[:, None], found, np.nan)
        else:
            path[:, :, i + 1 : i + 2] = step(path[:, :, i : i + 1], i)
        i += w
        size = np.maximum(size, np.where(alive & ~behind, np.abs(path[:, :, i]), 0.0))
    return behind


def _window(
    step: Step, before: FloatArray, first: int, w: int, size: FloatArray, alive: BoolArray
) -> tuple[FloatArray, BoolArray]:
    """Return the states (s, k, w) of the samples after `first`, and for which of the sets that are `alive` the method
    converges.
    """
    x = np.repeat(before[:, :, None], w + 1, axis=2)
    x[:, ~alive] = 0.0
    alive = alive.copy()
    slope: FloatArray | None = None
    far = np.inf
    for _ in range(_ROUNDS):
        there = step(x[:, :, :-1], first)
        left = there - x[:, :, 1:]
        if slope is None:
            slope = slopes(step, x[:, :, :-1], there, first, size)
        delta = _corrections(slope, left, alive)
        x[:, :, 1:] += delta
        if not alive.any():
            break
        size = np.maximum(size, np.where(alive, np.abs(x).max(axis=2), 0.0))
        before_that = far
        by_set = (np.abs(delta) / size[:, :, None]).max(axis=(0, 2))
        far = float(by_set[alive].max())
        if far <= _CONVERGED:
            return x[:, :, 1:], alive
        if far > _NEAR or far > _FALLS * before_that:
            slope = None
    return x[:, :, 1:], alive & (by_set <= _CONVERGED) if alive.any() else alive


def _corrections(slope: FloatArray, left: FloatArray, alive: BoolArray) -> FloatArray:
    """Return δ (s, k, w) of (2), zero for sets that are not `alive`; those whose corrections are not finite are so no
    more.
    """
    alive &= np.isfinite(left).all(axis=(0, 2)) & np.isfinite(slope).all(axis=(0, 1, 3))
    while True:
        slope[:, :, ~alive] = 0.0
        left[:, ~alive] = 0.0
        delta = _recursion(slope, left)
        lost = ~np.isfinite(delta).all(axis=(0, 2))
        if not lost.any():
            return delta
        alive[int(np.argmax(lost))] = False  # those behind it may be lost only because it is


def slopes(step: Step, x: FloatArray, there: FloatArray, first: int, size: FloatArray) -> FloatArray:
    """Return A (s, s, k, w) of (2) at states (s, k, w) whose steps lead `there`, by finite differences."""
    slope = np.empty((len(x), *x.shape))
    for column in range(len(x)):
        moved = x.copy()
        moved[column] += _STEP * size[column][:, None]
        slope[:, column] = (step(moved, first) - there) / (_STEP * size[column][:, None])
    return slope


def _recursion(slope: FloatArray, left: FloatArray) -> FloatArray:
    """Return δ (s, k, w) of (2) for A (s, s, k, w) and what is left of each step; the first δ before is zero."""
    s, k, w = left.shape
    band = np.zeros((2 * s, k, w, s))
    for row in range(s):
        for column in range(s):
            band[s + row - column, :, :-1, column] -= slope[row, column, :, 1:]
    found = dtbsv(
        2 * s - 1,
        np.asfortranarray(band.reshape(2 * s, -1)),
        np.moveaxis(left, 0, 2).reshape(-1),
        lower=1,
        diag=1,
    )
    return np.moveaxis(np.asarray(found, dtype=np.float64).reshape(k, w, s), 2, 0)
