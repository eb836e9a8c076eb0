"""A learned term where no formula fits: a smooth curve of one signal at a port, penalised for bending.

    f = Σ_i a_i B_i(x),   minimise ‖e‖² + λ Σ_i (a_{i−1} − 2 a_i + a_{i+1})²                                        (1)

with cubic B-splines B_i on even knots (a P-spline, Eilers and Marx 1996); it is the mean of a Gaussian process whose
second derivative is white. Port, signal and λ are those that predict best the last part of the recording from the
first, in the linear problem; then all of it is fitted, by Gauss and Newton's method with the base model.
"""

from collections.abc import Sequence

import numpy as np

from discrepancy.construct.terms import MadeTerm
from discrepancy.evidence.whitening import White
from discrepancy.problem import MOST_LOST, Problem
from discrepancy.search.fit import Fit
from messages.arrays import FloatArray

_PENALTIES = tuple(10.0**k for k in range(-6, 5))
"""λ, times the mean information on an amount."""
_FITTED = 0.7
"""Of the recording: what predicts the rest when port, signal and λ are chosen."""
_STEPS = 8
"""Of the fit."""
_HALVINGS = 4
"""Of a step that does not lower (1)."""
_ENOUGH = 0.05
"""Of χ²: a step that lowers (1) by less ends the fit."""
_RIDGE = 1e-9
"""Of each parameter's own information: what the motion does not tell stays solvable."""


def learned(
    problem: Problem, base: Fit, base_columns: FloatArray, terms: Sequence[tuple[MadeTerm, FloatArray]]
) -> tuple[MadeTerm, Fit] | None:
    """Return the curve that predicts best, with its fit; None where none predicts better than the base model.

    `terms` are curves with the columns (K, c, n) of their amounts at the base fit.
    """
    white = problem.whitening(base.residual)
    e = white(base.residual)
    own = white(base_columns)
    cut = round(_FITTED * problem.n)
    best: tuple[float, MadeTerm, float] | None = None
    least = _predicted(own, e, 0, 0.0, cut)
    for made, columns in terms:
        rows = np.concatenate((own, white(columns)))
        for penalty in _PENALTIES:
            left = _predicted(rows, e, len(columns), penalty, cut)
            if left < least and (best is None or left < best[0]):
                best = (left, made, penalty)
    if best is None:
        return None
    _, made, penalty = best
    return made, _fitted(problem, white, base, made, penalty)


def _predicted(rows: FloatArray, e: FloatArray, bent: int, penalty: float, cut: int) -> float:
    """Return the squares left of the last part of e (c, n) by rows (m, c, n), fitted to the first."""
    if not len(rows):
        return float(np.sum(e[:, cut:] ** 2))
    early = rows[:, :, :cut].reshape(len(rows), -1)
    weight = _solved(early @ early.T, early @ e[:, :cut].reshape(-1), np.zeros(len(rows)), bent, penalty)
    late = e[:, cut:] - np.tensordot(weight, rows[:, :, cut:], axes=1)
    return float(np.sum(late**2))


def _bending(count: int) -> FloatArray:
    second = np.diff(np.eye(count), 2, axis=0)
    return np.asarray(second.T @ second)


def _weighted(gram: FloatArray, bent: int, penalty: float) -> FloatArray:
    """Return λ times the penalty of (1) on the last `bent` of the parameters."""
    out = np.zeros_like(gram)
    if bent:
        out[-bent:, -bent:] = penalty * float(np.mean(np.diag(gram)[-bent:])) * _bending(bent)
    return out


def _solved(gram: FloatArray, score: FloatArray, at: FloatArray, bent: int, penalty: float) -> FloatArray:
    """Return the step that minimises (1), `at` being where the parameters are."""
    bending = _weighted(gram, bent, penalty)
    whole = gram + bending
    size = np.sqrt(np.maximum(np.diag(whole), np.finfo(float).tiny))
    whole /= np.outer(size, size)
    whole[np.diag_indices(len(size))] += _RIDGE
    step: FloatArray = np.linalg.solve(whole, (score - bending @ at) / size) / size
    return step


def _fitted(problem: Problem, white: White, base: Fit, made: MadeTerm, penalty: float) -> Fit:
    keys = made.keys
    moving = (*problem.base, *keys)
    values = {**base.values, **dict.fromkeys(keys, 0.0)}
    scale = np.array([problem.parameters[key].scale for key in moving])
    predicted = problem.predicted(values)
    e = white(problem.difference(predicted)).reshape(-1)
    bending: FloatArray | None = None
    for _ in range(_STEPS):
        J = np.stack([white(row).reshape(-1) for row in problem.columns([(values, predicted, key) for key in moving])])
        gram = J @ J.T
        at = np.array([problem.value(values, key) for key in moving]) / scale
        if bending is None:
            bending = _weighted(gram, len(keys), penalty)
        step = _solved(gram, J @ e, at, len(keys), penalty)
        before = float(e @ e + at @ bending @ at)
        fell = 0.0
        for _ in range(_HALVINGS):
            moved = problem.shifted(values, moving, step)
            tried = problem.predicted(moved)
            left = white(problem.difference(tried)).reshape(-1)
            there = np.array([problem.value(moved, key) for key in moving]) / scale
            fell = before - float(left @ left + there @ bending @ there)
            if fell > 0.0 and problem.lost(tried) <= MOST_LOST:
                values, predicted, e = moved, tried, left
                break
            step = 0.5 * step
        if fell < _ENOUGH:
            break
    residual = problem.difference(predicted)
    return Fit(values, residual, float(np.sum(white(residual) ** 2)), keys)
