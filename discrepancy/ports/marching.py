"""Solves the steps of an integrator for many samples at once, which is what a Python loop over them gives, but faster.

The states at the samples of a window, x₁ … x_w, are those for which all steps hold together:

    xᵢ₊₁ = Φ(xᵢ)                                                                                                   (1)

Newton's method linearises all steps at once, and what corrects the states follows from one recursion:

    δᵢ₊₁ = Aᵢ δᵢ + Φ(xᵢ) − xᵢ₊₁,   Aᵢ = ∂Φ/∂x (xᵢ)                                                                  (2)

which is a triangular band of equations (Lim et al., Parallelizing non-linear sequential models, 2024).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg.blas import dtbsv

from messages.arrays import BoolArray, FloatArray, IntArray

_AT_ONCE = 4096
"""Samples of all sets of parameters in a window: fewer leave Python's own cost, more the processor's memory."""
_WIDEST, _NARROWEST = 2048, 16
"""Samples of a window: where a wide one does not converge, a narrower one does, and at last a loop over samples."""
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


class Near(NamedTuple):
    """Where Newton's method begins for k sets: states (s, l, n) that are solved, which of the l each set is near to,
    (k,), and the slopes A (s, s, l, n - 1) of (2) there, where these are known."""

    path: FloatArray
    of: IntArray
    slopes: FloatArray | None = None

    @classmethod
    def to(cls, path: FloatArray, step: Step, of: IntArray) -> "Near":
        """Return what is near to a `path` (s, l, n) that `step` solves."""
        s, k, n = path.shape
        slopes = np.empty((s, s, k, n - 1))
        size = np.maximum(np.abs(path).max(axis=2), 1.0)
        w = _widest(k)
        for i in range(0, n - 1, w):
            x = path[:, :, i : min(i + w, n - 1)]
            slopes[:, :, :, i : i + w] = _slopes(step, x, step(x, i), i, size)
        return cls(path, of, slopes)

    def window(self, first: int, w: int) -> tuple[FloatArray, FloatArray | None]:
        """Return the states (s, k, w + 1) from a sample on, and the slopes (s, s, k, w) where they are known."""
        slopes = None if self.slopes is None else self.slopes[:, :, self.of, first : first + w]
        return self.path[:, self.of, first : first + w + 1], slopes


def march(step: Step, begun: FloatArray, n: int, near: Near | None = None) -> FloatArray:
    """Return the states (s, k, n) of all samples from those `begun` (s, k) with; not finite where they diverged.

    What they are `near` to is where the method begins: it then needs few rounds, and no slopes of its own where those
    are known.
    """
    s, k = begun.shape
    path = np.full((s, k, n), np.nan)
    path[:, :, 0] = begun
    size = np.maximum(np.abs(begun), 1.0)
    widest = width = _widest(k)
    i = 0
    while i < n - 1:
        alive = np.isfinite(path[:, :, i]).all(axis=0)
        if not alive.any():
            break
        w = min(width, n - 1 - i)
        guess = None if near is None else near.window(i, w)
        found = _window(step, path[:, :, i], i, w, size, alive, guess) if w > 1 else step(path[:, :, i : i + 1], i)
        if found is None and near is not None:
            near = None
            continue
        if found is None:
            width = width // 4 if width > _NARROWEST else 1
            continue
        path[:, :, i + 1 : i + 1 + w] = found
        i += w
        if i % widest == 0:
            size = np.maximum(size, np.where(alive, np.abs(path[:, :, i]), 0.0))
            width = widest
    return path


def _widest(k: int) -> int:
    """Return how many samples a window of k sets has at most, a power of two."""
    return min(_WIDEST, 1 << max(_AT_ONCE // k, 4 * _NARROWEST).bit_length() - 1)


def _window(
    step: Step,
    before: FloatArray,
    first: int,
    w: int,
    size: FloatArray,
    alive: BoolArray,
    guess: tuple[FloatArray, FloatArray | None] | None,
) -> FloatArray | None:
    """Return the states (s, k, w) of the samples after `first`, or None where the method does not converge for those
    sets that are `alive`. A `guess` is of the states, with `before` (s, k), and of the slopes there, if known.
    """
    slope: FloatArray | None = None
    if guess is None:
        x = np.repeat(before[:, :, None], w + 1, axis=2)
    else:
        x, slope = guess
        x[:, :, 0] = before
        if slope is not None:
            slope[:, :, ~alive] = 0.0
    far = np.inf
    for _ in range(_ROUNDS):
        there = step(x[:, :, :-1], first)
        left = there - x[:, :, 1:]
        if slope is None:
            slope = _slopes(step, x[:, :, :-1], there, first, size)
            slope[:, :, ~alive] = 0.0
        left[:, ~alive] = 0.0
        delta = _recursion(slope, left)
        if not np.isfinite(delta).all():
            return None
        x[:, :, 1:] += delta
        size = np.maximum(size, np.where(alive, np.abs(x).max(axis=2), 0.0))
        before_that, far = far, float((np.abs(delta) / size[:, :, None]).max())
        if far <= _CONVERGED:
            return x[:, :, 1:]
        if far > _NEAR or far > _FALLS * before_that:
            slope = None
    return None


def _slopes(step: Step, x: FloatArray, there: FloatArray, first: int, size: FloatArray) -> FloatArray:
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
