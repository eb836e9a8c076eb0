"""Fits of base model and effects: Levenberg-Marquardt within bounds, and intervals of what was fitted.

The residual is whitened, so that χ² = ‖e‖². The base model's parameters move along in every fit: their columns are
taken once and kept as long as the fit converges fast (they hardly change with a small effect), those of the effects
are taken anew at each step.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from discrepancy.evidence.whitening import White
from discrepancy.problem import MOST_LOST, Problem
from discrepancy.simulation import Values
from messages.arrays import FloatArray
from messages.constants import NORMAL_95

MOST_STEPS = 20
"""Of one fit: one that has not converged by then creeps along a ridge, which tells no set of causes from another."""
_SLOW = 0.1
"""Of the last step's promise: where a step promises more than that, the kept columns hold the fit back."""
_GAIN_ENOUGH = 0.05
"""In χ²: a step that promises or brings less ends a fit, as no decision turns on so little."""
_DAMPING = 1e-6
"""Of each parameter's own curvature: next to none, where a fit begins and as far as it is eased."""
_MOST_DAMPING = 1e3
"""Likewise: a step this short is none, and the fit ends."""
_EASED, _RAISED = 0.1, 10.0
"""Times the damping, after a step that brings what it promised, and after one that does not."""
_LEAST_RAISED = 1e-4
"""Of the curvature, before it is raised: less would not shorten the next step."""
_RIDGE = 1e-10
"""Of each parameter's own curvature: parameters that say the same leave the matrix invertible."""
_FAITHFUL = 0.5
"""Of the fall in χ² that the columns promise: where less comes, they are stale or the step is too long."""
_FELT = 1e-3
"""Of a noise's deviation, over all samples: what a parameter must change on its whole way to its bounds. One that does
not, such as the width of a dead band while its spring has no stiffness, has a column of last digits.
"""
BLOCKS = 32
"""Stretches of a recording whose scores are compared: enough for their spread, each long beside the noise's memory."""
_NUMERICAL = 0.1
"""Of a parameter's step: what a simulation's own numerics may be off by, and no interval claims to exclude."""
_TAKEN = 0.5
"""Of the way to an interval's end: where bounds leave less of it, the profile there tells nothing."""
_LEAST_RISE = 1e-3
"""Of the rise of χ² that an interval's end must show: a smaller one, or a fall, counts as this."""
_MOST_MOVED = 3.0
"""Times the interval's half width: a profile along one line tells no more of an end further out."""


@dataclass(frozen=True)
class Fit:
    """A fit: `values` of what was fitted, all else neutral, the raw `residual` (c, n), and χ² under the whitening it
    was made with. `keys` are the effects' parameters that moved along with the base model's.
    """

    values: dict[str, float]
    residual: FloatArray
    chi2: float
    keys: tuple[str, ...]


@dataclass(frozen=True)
class Intervals:
    """Covariance (p, p) of `keys`, in units of their scales, and their 95 % intervals (p, 2) in their own units."""

    keys: tuple[str, ...]
    covariance: FloatArray
    bounds: FloatArray

    def of(self, key: str) -> tuple[float, float]:
        """Return the interval of one parameter."""
        low, high = self.bounds[self.keys.index(key)]
        return float(low), float(high)


class Fitter:
    """Fits under one whitening. `base_columns` (q, c, n) are raw columns of the base model's parameters, which may be
    taken `fresh` at each step, as costs nothing where predictions are made side by side.
    """

    def __init__(self, problem: Problem, white: White, base_columns: FloatArray, *, fresh: bool = False) -> None:
        self._problem, self.white, self._fresh = problem, white, fresh
        self._base = [white(column).reshape(-1) for column in base_columns]

    def fit(self, values: dict[str, float], keys: Sequence[str], steps: int = MOST_STEPS) -> Fit:
        """Return the fit of base model and `keys`, begun at `values`."""
        return self.fit_each([(values, keys)], steps)[0]

    def fit_each(self, begun: Sequence[tuple[dict[str, float], Sequence[str]]], steps: int = MOST_STEPS) -> list[Fit]:
        """Return the fit of base model and keys for each of `begun`, values and keys; what they ask for is predicted
        side by side where that is faster.
        """
        fits = [self._fitted(values, keys, steps) for values, keys in begun]
        asked = {place: next(each) for place, each in enumerate(fits)}
        found: dict[int, Fit] = {}
        while asked:
            told = iter(self._problem.predicted_many([values for sets in asked.values() for values in sets]))
            further: dict[int, list[Values]] = {}
            for place, sets in asked.items():
                answer = _answered(fits[place], [next(told) for _ in sets])
                if isinstance(answer, Fit):
                    found[place] = answer
                else:
                    further[place] = answer
            asked = further
        return [found[place] for place in range(len(fits))]

    def _fitted(self, values: dict[str, float], keys: Sequence[str], steps: int) -> "_Fitting":
        """Fit, yielding the values at which predictions are needed."""
        problem = self._problem
        begun = problem.shifted(values, keys, np.zeros(len(keys)))
        (predicted,) = yield [begun]
        residual = problem.difference(predicted)
        e, chi2 = self._rated(predicted, residual)
        found = Fit(begun, residual, chi2, tuple(keys))
        if not np.isfinite(chi2):
            return found
        damping, base, refreshed, expected = _DAMPING, self._base, found, np.inf
        moving = (*problem.base, *keys)
        for _ in range(steps):
            if self._fresh:
                J = np.array((yield from self._whitened(found.values, predicted, moving)))
            else:
                J = np.array([*base, *(yield from self._whitened(found.values, predicted, keys))])
            if not len(J):
                return found
            gram, score = J @ J.T, J @ e
            share = 0.0
            while share <= 0.0:
                delta = self._step(found.values, moving, gram, score, damping)
                promised = float(2.0 * delta @ score - delta @ gram @ delta)
                if not promised >= _GAIN_ENOUGH or damping > _MOST_DAMPING:
                    break
                values = problem.shifted(found.values, moving, delta)
                (tried,) = yield [values]
                residual = problem.difference(tried)
                left, chi2 = self._rated(tried, residual)
                share = (found.chi2 - chi2) / promised
                if share > 0.0:
                    found, e, predicted = Fit(values, residual, chi2, tuple(keys)), left, tried
                kept = share > _FAITHFUL
                damping = max(damping * _EASED, _DAMPING) if kept else max(damping, _LEAST_RAISED) * _RAISED
            stale = refreshed is not found and bool(problem.base) and bool(keys) and not self._fresh
            slow = share < _FAITHFUL or promised > _SLOW * expected
            expected = promised
            if stale and slow and promised >= _GAIN_ENOUGH:
                base = yield from self._whitened(found.values, predicted, problem.base)
                refreshed = found
            elif share <= 0.0 or share * promised < _GAIN_ENOUGH:
                return found
        return found

    def _rated(self, predicted: FloatArray, residual: FloatArray) -> tuple[FloatArray, float]:
        """Return a residual whitened, and its χ²: infinite where the simulation diverged."""
        with np.errstate(over="ignore", invalid="ignore"):
            e = self.white(residual).reshape(-1)
            chi2 = float(e @ e)
        return e, chi2 if np.isfinite(chi2) and self._problem.lost(predicted) <= MOST_LOST else np.inf

    def _whitened(
        self, values: dict[str, float], predicted: FloatArray, keys: Sequence[str]
    ) -> Generator[list[Values], list[FloatArray], list[FloatArray]]:
        asked = [(values, predicted, key) for key in keys]
        after = yield self._problem.moved(asked)
        return [self.white(column).reshape(-1) for column in self._problem.changes(asked, after)]

    def _step(
        self, values: dict[str, float], keys: Sequence[str], gram: FloatArray, score: FloatArray, damping: float
    ) -> FloatArray:
        """Return the damped step within the bounds: what would leave them stays on them, the rest is solved again. A
        parameter that is not felt stays where it is.
        """
        problem = self._problem
        p = [problem.parameters[key] for key in keys]
        at = np.array([problem.value(values, key) for key in keys])
        scale = np.array([each.scale for each in p])
        low = (np.array([each.low for each in p]) - at) / scale
        high = (np.array([each.high for each in p]) - at) / scale
        size = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
        scaled = gram / np.outer(size, size)
        scaled[np.diag_indices(len(size))] += damping + _RIDGE
        delta = np.zeros(len(keys))
        free = ~(size * np.maximum(high, -low) <= _FELT)
        for _ in range(len(keys)):
            if not free.any():
                break
            rhs = score - gram[:, ~free] @ delta[~free]
            solved = np.linalg.solve(scaled[np.ix_(free, free)], rhs[free] / size[free]) / size[free]
            inside = np.clip(solved, low[free], high[free])
            delta[free] = inside
            out = inside != solved
            if not out.any():
                break
            free[np.flatnonzero(free)[out]] = False
        return delta


_Fitting = Generator[list[Values], list[FloatArray], Fit]
"""A fit under way: it asks for predictions at values, and returns what it found."""


def _answered(fit: _Fitting, predicted: list[FloatArray]) -> list[Values] | Fit:
    """Return what a fit asks for next, or what it found."""
    try:
        return fit.send(predicted)
    except StopIteration as end:
        found: Fit = end.value
        return found


def base_fit(problem: Problem, white: White, values: dict[str, float], columns: FloatArray) -> Fit:
    """Return the base model's fit with the columns given, or fresh ones where those cost nothing."""
    return Fitter(problem, white, columns, fresh=problem.side_by_side).fit(values, ())


def columns_of(problem: Problem, values: dict[str, float], keys: Sequence[str]) -> FloatArray:
    """Return the columns (p, c, n) of `keys` at `values`."""
    before = problem.predicted(values)
    columns = problem.columns([(values, before, key) for key in keys])
    return np.array(columns).reshape(len(columns), problem.c, problem.n)


def intervals(problem: Problem, white: White, found: Fit, columns: FloatArray) -> Intervals:
    """Return the 95 % intervals of base model and effects, whose `columns` (p, c, n) are taken at the fit.

    The covariance is the inverse Fisher matrix F⁻¹ or, where stretches of the recording disagree by more than it
    allows, the sandwich F⁻¹ M F⁻¹ with M = Σ s sᵀ of the stretches' scores. Each interval of an effect's parameter is
    then checked on the profile of χ² at both its ends: all others follow along the ridge and by one linear step, and
    where χ² has not risen as far as it must, the end is moved out. What the formula itself may be off by is added. No
    interval reaches beyond a parameter's bounds.
    """
    keys = (*problem.base, *found.keys)
    if not keys:
        return Intervals((), np.zeros((0, 0)), np.zeros((0, 2)))
    J = np.stack([white(column).reshape(-1) for column in columns])
    e = white(found.residual).reshape(-1)
    gram = J @ J.T
    size = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    scaled = gram / np.outer(size, size)
    scaled[np.diag_indices(len(size))] += _RIDGE
    fisher = np.linalg.inv(scaled) / np.outer(size, size)
    edges = np.linspace(0, problem.n, BLOCKS + 1).astype(int)
    shaped, left = J.reshape(len(keys), problem.c, problem.n), e.reshape(problem.c, problem.n)
    scores = np.stack(
        [np.einsum("pcn,cn->p", shaped[:, :, a:b], left[:, a:b], optimize=True) for a, b in pairwise(edges)]
    )
    sandwich = fisher @ (scores.T @ scores) @ fisher * (BLOCKS / (BLOCKS - 1.0))
    grown = np.sqrt(np.maximum(np.diag(sandwich) / np.diag(fisher), 1.0))
    covariance = fisher * np.outer(grown, grown)
    scale = np.array([problem.parameters[key].scale for key in keys])
    at = np.array([found.values[key] for key in keys])
    inexact = np.array([problem.parameters[key].inexact for key in keys]) * np.abs(at)
    numerical = _NUMERICAL * np.array([problem.parameters[key].difference for key in keys]) / scale
    half = np.hypot(np.hypot(NORMAL_95 * np.sqrt(np.diag(covariance)), numerical) * scale, inexact)
    bounds = np.column_stack((at - half, at + half))
    for row in range(len(problem.base), len(keys)):
        for side in (0, 1):
            out = _profile(problem, white, found, keys, fisher, J, row, (-1.0, 1.0)[side], float(grown[row]))
            bounds[row, side] = at[row] + out * (bounds[row, side] - at[row])
    allowed = np.array([problem.key_bounds(key) for key in keys])
    return Intervals(keys, covariance, np.clip(bounds, allowed[:, :1], allowed[:, 1:]))


def _profile(
    problem: Problem,
    white: White,
    found: Fit,
    keys: Sequence[str],
    fisher: FloatArray,
    J: FloatArray,
    row: int,
    sign: float,
    grown: float,
) -> float:
    """Return by what an interval's end must be multiplied so that χ² rises by `NORMAL_95`² there (times what it was
    grown by).
    """
    wanted = NORMAL_95 * float(np.sqrt(fisher[row, row])) * grown
    along = sign * wanted * fisher[:, row] / fisher[row, row]
    moved = problem.shifted(found.values, keys, along)
    p = problem.parameters[keys[row]]
    taken = abs(moved[keys[row]] - found.values[keys[row]]) / p.scale
    if taken < _TAKEN * wanted:
        return 1.0
    predicted = problem.predicted(moved)
    others = np.delete(np.arange(len(keys)), row)
    with np.errstate(over="ignore", invalid="ignore"):
        e = white(problem.difference(predicted)).reshape(-1)
        chi2 = float(e @ e)
        if len(others):
            score, gram = J[others] @ e, J[others] @ J[others].T
            size = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
            scaled = gram / np.outer(size, size)
            scaled[np.diag_indices(len(size))] += _RIDGE
            chi2 -= float((score / size) @ np.linalg.solve(scaled, score / size))
    if problem.lost(predicted) > MOST_LOST or not np.isfinite(chi2):
        return 1.0
    rise = (chi2 - found.chi2) / (NORMAL_95 * grown * taken / wanted) ** 2
    return float(np.clip(1.0 / np.sqrt(max(rise, _LEAST_RISE)), 1.0, _MOST_MOVED))
