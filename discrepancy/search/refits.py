"""Fits and linear scores of candidates beside what is in already, under one whitening that may be made anew."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import combinations
from typing import TypeVar

import numpy as np

from discrepancy.evidence.whitening import White, unfiltered
from discrepancy.problem import Problem
from discrepancy.search.candidates import Candidate, library, noise_beneath
from discrepancy.search.fit import MOST_STEPS, Fit, Fitter, base_fit, columns_of
from discrepancy.search.scores import PENALTY, Products, drops, products
from messages.arrays import FloatArray

_BASE_ROUNDS = 2
"""Fits of the base model, each whitened by what the one before left: the first whitening holds its misfit."""
_TRAPPED = 1.0
"""Of −2 log likelihood for each sample: by so much a base fit may be worse than one that was begun otherwise."""
_OTHER_COLOUR = 0.01
"""Nats of log likelihood per sample by which the noise that a fit leaves must differ to be whitened by anew."""
_UNLIKE = 2.0
"""χ² of each sample, from which on the noise whitened by is not the one that a fit leaves."""
_BASE_STEPS, _RECOLOURED_STEPS = 3, 4
"""Steps of a fit that begins where it converged under another whitening."""
_UNDONE = 0.65
"""Of what either of two effects changes: where they change less together, one undoes the other."""
_NO_CHANGE = 1e-9
"""Of what was measured at most: less is the last digits of an integrator, which hang on where its method begins."""
_OF_GAIN = 0.005
"""Of the gain in χ², for each parameter more: what it must bring beside its price."""
_RECOLOURING_ROUNDS = 1
"""Estimates of the noise beneath the library when it is whitened anew: the fit's own residual is little but noise."""


T = TypeVar("T")


def base_of(problem: Problem, begun: dict[str, float] | None = None) -> tuple[Fit, FloatArray]:
    """Return the base model's fit, whitened by its own residual, and its columns (q, c, n) there; `begun` where it is
    known about.

    Elsewhere it is begun under the noise that the starting values leave, and under white noise, which is taken where it
    ends far likelier: a model that is far off leaves so much that its colour hides which way it is off.
    """
    values = begun or problem.start()
    start = Fit(values, problem.residual(values), 0.0, ())
    found, columns = _base_fitted(problem, start, problem.whitening(start.residual))
    if begun is None and problem.base:
        white = unfiltered(start.residual, problem.valid)
        other, beside = _base_fitted(problem, start, white)
        if deviance(problem, found) - deviance(problem, other) > _TRAPPED * white.count:
            return other, beside
    return found, columns


def _base_fitted(problem: Problem, found: Fit, white: White) -> tuple[Fit, FloatArray]:
    columns = np.zeros((0, problem.c, problem.n))
    for _ in range(_BASE_ROUNDS if problem.base else 0):
        columns = columns_of(problem, found.values, problem.base)
        found = base_fit(problem, white, found.values, columns)
        white = problem.whitening(found.residual)
    return found, columns


def deviance(problem: Problem, fit: Fit) -> float:
    """Return −2 log likelihood of a fit under the noise that its own residual tells."""
    own = problem.whitening(fit.residual)
    return own.log_det + float(np.sum(own(fit.residual) ** 2))


def price(keys: Sequence[str]) -> float:
    """Return by what effects' parameters must lower χ² to be worth naming."""
    return PENALTY * len(keys)


def cost(fit: Fit) -> float:
    """Return the penalised χ² of a fit, by which sets of causes are compared."""
    return fit.chi2 + price(fit.keys)


def simplest_first(best: Fit, found: Iterable[T], fit_of: Callable[[T], Fit]) -> list[T]:
    """Return what was found, the best penalised first, but before it what has fewer parameters and gains nearly as much
    on `best`: many parameters imitate anything a little better on data that no model fits to the last digit.
    """
    ranked = sorted(found, key=lambda each: cost(fit_of(each)))
    if not ranked:
        return []
    first = fit_of(ranked[0])
    gained = best.chi2 - first.chi2

    def nearly(fit: Fit) -> bool:
        fewer = len(first.keys) - len(fit.keys)
        return fewer > 0 and best.chi2 - fit.chi2 >= (1.0 - _OF_GAIN * fewer) * gained

    simpler = sorted((each for each in ranked[1:] if nearly(fit_of(each))), key=lambda each: len(fit_of(each).keys))
    return [*simpler, *(each for each in ranked if each not in simpler)]


class Refits:
    """Fits and linear scores beside what is in already, and what they share: the library's columns, whitened.

    `base` is the base model's fit, `library` holds the columns there, `white` is the present whitening.
    """

    white: White

    def __init__(self, problem: Problem, names: Sequence[str]) -> None:
        self._problem = problem
        base, columns = base_of(problem)
        self.library = library(problem, base.values, columns, tuple(names))
        base = replace(base, residual=problem.residual(base.values))
        self._use(noise_beneath(problem, base.residual, self.library.columns))
        self.base = self._fitter.fit(base.values, (), steps=_BASE_STEPS) if problem.base else self.rated(base)

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """Return all candidates of the library."""
        return self.library.candidates

    @property
    def base_columns(self) -> FloatArray:
        """Return the base model's columns (q, c, n)."""
        return self.library.columns[: self.library.base]

    def fitted(self, values: dict[str, float], keys: Sequence[str], steps: int = MOST_STEPS) -> Fit:
        """Return the fit of base model and `keys`, begun at `values`."""
        return self._fitter.fit(values, keys, steps)

    def finished(self, fit: Fit) -> Fit:
        """Return a fit that was stopped after its first steps, to the end."""
        return self.finished_each([fit])[0]

    def joined(self, fit: Fit, candidate: Candidate, steps: int = MOST_STEPS) -> Fit:
        """Return the fit with a candidate more."""
        return self.joined_each([(fit, candidate)], steps)[0]

    def joined_each(self, pairs: Sequence[tuple[Fit, Candidate]], steps: int = MOST_STEPS) -> list[Fit]:
        """Return each of the fits with its candidate more, side by side where that is faster."""
        keys = [tuple(dict.fromkeys((*fit.keys, *candidate.keys))) for fit, candidate in pairs]
        begun = [{**fit.values, **candidate.start} for fit, candidate in pairs]
        return self._fitter.fit_each(list(zip(begun, keys, strict=True)), steps)

    def finished_each(self, fits: Sequence[Fit]) -> list[Fit]:
        """Return fits that were stopped after their first steps, to the end, side by side where that is faster."""
        return self._fitter.fit_each([(fit.values, fit.keys) for fit in fits])

    def without(self, best: Fit, cause: Candidate) -> Fit:
        """Return the fit without one cause."""
        asked = (tuple(best.values.items()), best.keys, cause.effect)
        if asked not in self._withouts:
            keys = tuple(key for key in best.keys if key.split(".")[0] != cause.effect)
            values = {key: value for key, value in best.values.items() if key.split(".")[0] != cause.effect}
            self._withouts[asked] = self._fitter.fit(values, keys)
        return self._withouts[asked]

    def rated(self, fit: Fit) -> Fit:
        """Return a fit with its χ² under the present whitening."""
        return replace(fit, chi2=float(np.sum(self.white(fit.residual) ** 2)))

    def ranked(self, fit: Fit, candidates: Sequence[Candidate]) -> list[tuple[Candidate, float]]:
        """Return candidates with their linear drop beside a fit, the best penalised first."""
        if not candidates:
            return []
        found = self.products(fit)
        drop = self.drops(found, [(each,) for each in candidates], fit)
        worth = drop - np.array([price(each.keys) for each in candidates])
        return [(candidates[k], float(drop[k])) for k in np.argsort(-worth, kind="stable")]

    def wider(self, causes: tuple[Candidate, ...]) -> list[Candidate]:
        """Return what further choices of the causes' effects would add to them."""
        out = []
        for effect in dict.fromkeys(each.effect for each in causes):
            held = {key for each in causes if each.effect == effect for key in each.keys}
            allowed = [set(c.keys) for c in self.library.candidates if c.effect == effect]
            for c in self.library.candidates:
                new = [key for key in c.keys if key not in held]
                if c.effect == effect and new and any(held | set(new) <= each for each in allowed):
                    rows = tuple(row for key, row in zip(c.keys, c.columns, strict=True) if key in new)
                    start = {key: value for key, value in c.start.items() if key in new}
                    choice = tuple(p for p, key in zip(c.choice, c.keys, strict=True) if key in new)
                    out.append(Candidate(effect, choice, tuple(new), start, rows, c.offset if start else None))
        return out

    def begun_beside(self, fit: Fit, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Return those of the started candidates that begin best beside a fit, one for each set of parameters.

        The difference that a start makes at the base model, with the effect's other parameters at starts too, says
        nothing of the one that it makes where these are fitted already.
        """
        begun: dict[tuple[str, ...], tuple[float, Candidate]] = {}
        for each in candidates:
            chi2 = float(np.sum(self.white(self._problem.residual({**fit.values, **each.start})) ** 2))
            if each.keys not in begun or chi2 < begun[each.keys][0]:
                begun[each.keys] = (chi2, each)
        return [each for _, each in begun.values()]

    def matters(self, fit: Fit, cause: Candidate) -> bool:
        """Return whether a cause changes what is predicted, and a parameter of it is further from neutral than matters,
        or has no finite neutral.
        """
        problem = self._problem

        def far(key: str) -> bool:
            p = problem.parameters[key]
            return not abs(problem.value(fit.values, key) - p.neutral) <= p.least

        if not any(map(far, cause.keys)):
            return False
        without = {key: value for key, value in fit.values.items() if key not in cause.keys}
        before, after = (problem.predicted(values) / problem.reach for values in (without, fit.values))
        return not np.allclose(before, after, rtol=0.0, atol=_NO_CHANGE, equal_nan=True)

    def cancel(self, fit: Fit, causes: Sequence[Candidate]) -> bool:
        """Return whether two of the causes undo each other: together they change the prediction by less than two
        thirds of what either does.

        A delay and an advance that cancel leave a smoother of what both act on, which lowers the misfit of a reference
        with noise in it though nothing is delayed.
        """
        problem = self._problem
        effects = list(dict.fromkeys(each.effect for each in causes))
        if len(effects) < 2:
            return False
        base = {key: value for key, value in fit.values.items() if key in problem.base}
        before = problem.predicted(base)
        spread = np.nanstd(np.where(problem.valid, problem.measured, np.nan), axis=1)
        weight = np.where(spread > 0.0, 1.0 / np.maximum(spread, np.finfo(float).tiny), 0.0)[:, None]

        def changed(*names: str) -> float:
            values = {key: value for key, value in fit.values.items() if key.split(".")[0] in names}
            change = (problem.predicted({**base, **values}) - before) * weight
            return float(np.sum(change[problem.valid & np.isfinite(change)] ** 2))

        alone = {name: changed(name) for name in effects}
        return any(
            changed(a, b) < _UNDONE**2 * min(alone[a], alone[b])
            for a, b in combinations(effects, 2)
            if _UNDONE**2 * alone[a] < alone[b] < alone[a] / _UNDONE**2
        )

    def likelier(self, fit: Fit, than: Fit) -> bool:
        """Return whether a fit pays for its parameters also under the noise that its own residual tells.

        What is beneath the whole library may be taken for less than the noise is, where the library is large.
        """
        own = self._problem.whitening(fit.residual)
        fell = float(np.sum(own(than.residual) ** 2) - np.sum(own(fit.residual) ** 2))
        return fell > price(fit.keys) - price(than.keys)

    def deviance(self, fit: Fit) -> float:
        """Return −2 log likelihood of a fit under the noise that its own residual tells."""
        return deviance(self._problem, fit)

    def outdoes(self, fit: Fit, than: Fit) -> bool:
        """Return whether a fit is better than another, beside the price of each, under the present whitening and where
        each has its own noise: a whitening that is neither's weighs slow misfit by what neither leaves.
        """
        penalised = [self.deviance(each) + price(each.keys) for each in (fit, than)]
        return cost(fit) < cost(than) and penalised[0] < penalised[1]

    def unlike_all(self, fits: Iterable[Fit]) -> bool:
        """Return whether the noise whitened by is unlike what each of the fits leaves, and so tells none better."""
        return all(fit.chi2 > _UNLIKE * self.white.count for fit in fits)

    def recoloured(self, best: Fit) -> Fit:
        """Whiten anew where the colour of what is left differs, and return the fit under it."""
        count = self._problem.whitening(best.residual).count
        now = self.white.log_det * count / self.white.count + float(np.sum(self.white(best.residual) ** 2))
        if now - self.deviance(best) < _OTHER_COLOUR * count:
            return best
        columns = np.concatenate((self.library.columns, columns_of(self._problem, best.values, best.keys)))
        self._use(noise_beneath(self._problem, best.residual, columns, _RECOLOURING_ROUNDS))
        return self._fitter.fit(best.values, best.keys, _RECOLOURED_STEPS)

    def _use(self, white: White) -> None:
        self.white = white
        self._withouts: dict[tuple[object, ...], Fit] = {}  # the same is asked by swaps, pruning and look-alikes
        self._stack = self.library.whitened(white)
        self._fitter = Fitter(self._problem, white, self.base_columns, fresh=self._problem.side_by_side)

    def products(self, fit: Fit) -> Products:
        """Return the products of the library's columns with what a fit leaves, its own parameters projected out."""
        extra = None
        if fit.keys:
            raw = columns_of(self._problem, fit.values, fit.keys)
            extra = np.stack([self.white(column).reshape(-1) for column in raw])
        e = self.white(fit.residual).reshape(-1)
        return products(self._stack, self.library.base, e, self._problem.n, extra)

    def drops(self, found: Products, sets: Sequence[Sequence[Candidate]], fit: Fit) -> FloatArray:
        """Return the linear fall of χ² that each set of candidates promises beside a fit."""
        return drops(self._problem, found, sets, self.library.base, fit.values)
