"""The search by the simulated error: for causes that gain only together, and whose misfit is slow.

Under noise of unknown colour what slow causes leave passes for noise: none of them gains much alone, and a refit stays
where it begins. Sets of causes are therefore grown by the error of the simulation alone, from the power P of each
channel's n samples,

    D = Σ n ln P                                                                                                   (1)

several sets at a time, since the best one may lead astray. White noise makes far too much of slow errors: whether a
set is believed, its likelihood tells, refitted under the noise that it leaves itself,

    L = ln det V + ‖e‖² + 8 p, e the residual whitened by its own colour, p parameters                              (2)
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.evidence.whitening import LOADING, White, unfiltered
from discrepancy.problem import Problem
from discrepancy.search.candidates import Candidate, library
from discrepancy.search.fit import Fit, Fitter, Intervals, columns_of, intervals
from discrepancy.search.pruning import deciding
from discrepancy.search.refits import Refits, price
from discrepancy.search.scores import drops, products
from messages.arrays import FloatArray

_MOST_CAUSES = 3
"""In a set: each takes a round of refits beside every set that is followed."""
_FOLLOWED, _NEAR = 3, 0.5
"""Sets of equal size, one of which alone may lead astray, that gain at least this share of what the best gains."""
_SMOOTH = 10
"""Candidates without a start that are refitted beside a set: their linear scores tell which. A start's tells nothing
where trajectories bend."""
_LED, _FIRST_STEPS, _FURTHER_STEPS = 5, 4, 12
"""Effects that are followed after their first steps, and steps of a fit."""
_LOADINGS = (1e-1, 1e-2, 1e-3, 1e-4)
"""Of white noise assumed beside a set's own, one after another: its colour comes by degrees, or a refit stays where it
begins."""
_ROUNDS, _OWN_STEPS = 4, 6
"""Refits under a set's own noise alone, made anew after each, and their steps."""
_ENDED = 0.5
"""In (2): a refit under a set's own noise that brings less is the last."""
_SURE = 10.0
"""In (2): what a set must gain at least, which other refits of it may differ by."""
_SAME_ERROR = 0.001
"""Of the simulated error's power: two fits whose errors differ by less say the same."""
_OF_POWER = 0.03
"""Likewise: what a cause must remove. Less may be the others' own inexactness."""


@dataclass(frozen=True)
class CauseSet:
    """Causes and their `fit` by the simulated error alone, with its `deviance` (1) and price."""

    fit: Fit
    causes: tuple[Candidate, ...]
    deviance: float

    @property
    def effects(self) -> frozenset[str]:
        """Return the causes' names."""
        return frozenset(each.effect for each in self.causes)

    @property
    def cost(self) -> float:
        """Return the penalised deviance."""
        return self.deviance + price(self.fit.keys)


class SimulatedSearch:
    """One search among the effects `names`, with the base model's fit and what `refits` know of causes in general;
    `least` is by how much (2) must fall beyond chance.
    """

    def __init__(self, problem: Problem, refits: Refits, names: Sequence[str], least: float) -> None:
        self._problem, self._refits, self._names, self._least = problem, refits, tuple(names), least
        self._order = {name: place for place, name in enumerate(self._names)}
        self._likelihoods: dict[frozenset[str], float] = {}
        self._tried: dict[frozenset[str], CauseSet] = {}

    def found(self) -> CauseSet:
        """Return the set of causes that the recording needs; an empty one where none is believed."""
        best = self._base()
        followed = [best]
        while len(followed[0].causes) < _MOST_CAUSES:
            before = followed[0]
            white = unfiltered(before.fit.residual, self._problem.valid)
            grown = distinct((each for parent in followed for each in self._grown(parent, white)), self._order)
            if not grown or not self._material(grown[0], before):
                break
            near = _NEAR * (before.cost - grown[0].cost)
            chosen = [self._finished(each) for each in grown[:_FOLLOWED] if before.cost - each.cost > near]
            followed = sorted(chosen, key=lambda each: each.cost)
            self._tried |= {each.effects: each for each in followed}
            best = next((each for each in followed if self._believed(each, best)), best)
        return self._pruned(best)

    def likelihood(self, found: CauseSet) -> float:
        """Return (2) of a set of causes."""
        if found.effects not in self._likelihoods:
            self._likelihoods[found.effects] = self._refitted(found.fit)
        return self._likelihoods[found.effects]

    def rated(self, fit: Fit) -> float:
        """Return (2) of a fit as it is."""
        return self._refits.deviance(fit) + price(fit.keys)

    def without(self, found: CauseSet, effect: str) -> CauseSet:
        """Return the set without one cause, fitted anew by the simulated error."""
        left = found.effects - {effect}
        if left not in self._tried:
            keys = tuple(key for key in found.fit.keys if key.split(".")[0] != effect)
            values = {key: value for key, value in found.fit.values.items() if key.split(".")[0] != effect}
            fit = self._fitter(found.fit, values).fit(values, keys)
            self._tried[left] = self._set(fit, tuple(each for each in found.causes if each.effect != effect))
        return self._tried[left]

    def rise(self, found: CauseSet, cause: Candidate) -> float:
        """Return by how much χ² rises without a cause, under the noise that the set leaves."""
        own = self._problem.whitening(found.fit.residual)
        without = self.without(found, cause.effect).fit
        return float(np.sum(own(without.residual) ** 2) - np.sum(own(found.fit.residual) ** 2))

    def alike(self, found: CauseSet, effect: str) -> dict[str, float]:
        """Return by how much (2) rises with each effect in a cause's place that was followed there."""
        rest = found.effects - {effect}
        rivals = [each for each in self._tried.values() if len(each.effects - rest) == 1 and each.effects > rest]
        told = self.likelihood(found)
        return {
            next(iter(each.effects - rest)): self.likelihood(each) - told
            for each in rivals
            if each.effects != found.effects
        }

    def intervals(self, found: CauseSet) -> Intervals:
        """Return the intervals of a set's parameters: of a fit by the simulated error, whose scores' spread from
        stretch to stretch tells how slow the errors are.
        """
        problem, fit = self._problem, found.fit
        white = unfiltered(fit.residual, problem.valid)
        rated = Fit(fit.values, fit.residual, float(np.sum(white(fit.residual) ** 2)), fit.keys)
        return intervals(problem, white, rated, columns_of(problem, fit.values, (*problem.base, *fit.keys)))

    def _finished(self, found: CauseSet) -> CauseSet:
        """Return a set that was stopped after some steps, to the end."""
        fit = self._fitter(found.fit, found.fit.values).fit(found.fit.values, found.fit.keys)
        return self._set(fit, found.causes)

    def _base(self) -> CauseSet:
        begun = self._refits.base
        return self._set(self._fitter(begun, begun.values).fit(begun.values, ()), ())

    def _set(self, fit: Fit, causes: tuple[Candidate, ...]) -> CauseSet:
        return CauseSet(fit, causes, deviance(self._problem, fit))

    def _fitter(self, near: Fit, values: dict[str, float]) -> Fitter:
        """Return what fits by the simulated error that is `near`, from `values` on."""
        problem = self._problem
        columns = columns_of(problem, values, problem.base)
        return Fitter(problem, unfiltered(near.residual, problem.valid), columns, fresh=True)

    def _grown(self, parent: CauseSet, white: White) -> list[CauseSet]:
        """Return a set with one cause more, for each of the effects that gain most."""
        problem, fit = self._problem, parent.fit
        base = columns_of(problem, fit.values, problem.base)
        names = tuple(name for name in self._names if name not in parent.effects)
        pool = library(problem, fit.values, base, names)
        if not pool.candidates:
            return []
        own = [white(row).reshape(-1) for row in columns_of(problem, fit.values, fit.keys)]
        e = white(fit.residual).reshape(-1)
        beside = products(pool.whitened(white), pool.base, e, problem.n, np.stack(own) if own else None)
        drop = drops(problem, beside, [(each,) for each in pool.candidates], pool.base, fit.values)
        worth = drop - np.array([price(each.keys) for each in pool.candidates])
        fitter = Fitter(problem, white, base, fresh=True)
        begun = [({**fit.values, **each.start}, each) for each in _leading(pool.candidates, worth)]
        first = self._fitted(fitter, parent, begun, _FIRST_STEPS)
        further = [
            (each.fit.values, choice)
            for each in _best_of_each(first)[:_LED]
            for choice in (each.causes[-1], *_narrower(each.causes[-1], pool.candidates))
        ]
        return _best_of_each(self._fitted(fitter, parent, further, _FURTHER_STEPS))

    def _fitted(
        self, fitter: Fitter, parent: CauseSet, begun: Sequence[tuple[dict[str, float], Candidate]], steps: int
    ) -> list[CauseSet]:
        """Return the sets of a parent and each candidate, begun at values, a few steps on."""
        asked = []
        for values, each in begun:
            keys = (*parent.fit.keys, *each.keys)
            asked.append(({key: value for key, value in values.items() if key in (*self._problem.base, *keys)}, keys))
        fits = fitter.fit_each(asked, steps)
        return [
            self._set(fit, (*parent.causes, candidate))
            for (_, candidate), fit in zip(begun, fits, strict=True)
            if np.isfinite(fit.chi2)
        ]

    def _material(self, more: CauseSet, fewer: CauseSet) -> bool:
        """Return whether each cause more removes what it must of the simulated error."""
        least = _OF_POWER * self._problem.valid.sum() * (len(more.effects) - len(fewer.effects))
        return bool(fewer.cost - more.cost > least)

    def _believed(self, proposed: CauseSet, best: CauseSet) -> bool:
        """Return whether a set's causes may all be there, and pay beside those of the best so far."""
        refits, fit = self._refits, proposed.fit
        if not self._material(proposed, best) or not all(refits.matters(fit, each) for each in proposed.causes):
            return False
        if self._bounded(proposed) or refits.cancel(fit, proposed.causes):
            return False
        return self.likelihood(best) - self.likelihood(proposed) > max(self._least, _SURE)

    def _bounded(self, proposed: CauseSet) -> bool:
        """Return whether a parameter that tells whether a cause is there lies on a bound that is not its own."""
        for effect in sorted(proposed.effects):
            for key in deciding(self._problem, proposed.fit, effect):
                p, value = self._problem.parameters[key], proposed.fit.values[key]
                if not p.own_bounds and value in (p.low, p.high) and value != p.neutral:
                    return True
        return False

    def _pruned(self, best: CauseSet) -> CauseSet:
        """Return the set without causes that the others have made needless."""
        for cause in best.causes:
            if len(best.causes) < 2:
                break
            without = self.without(best, cause.effect)
            if not self._material(best, without):
                best = without
        return best

    def _refitted(self, fit: Fit) -> float:
        """Return (2) of the refit under the noise that it leaves itself."""
        problem, least = self._problem, self.rated(fit)
        for loading in (*_LOADINGS, *(LOADING,) * _ROUNDS):
            columns = columns_of(problem, fit.values, problem.base)
            white = problem.whitening(fit.residual, loading)
            fit = Fitter(problem, white, columns, fresh=True).fit(fit.values, fit.keys, _OWN_STEPS)
            now = self.rated(fit)
            if loading == LOADING and not now < least - _ENDED:
                break
            least = min(least, now)
        return least


def deviance(problem: Problem, fit: Fit) -> float:
    """Return (1) of a fit."""
    count = problem.valid.sum(axis=1)
    power = np.sum(fit.residual**2 * problem.valid, axis=1) / np.maximum(count, 1)
    return float(count @ np.log(np.maximum(power, np.finfo(float).tiny)))


def _leading(candidates: Sequence[Candidate], worth: FloatArray) -> list[Candidate]:
    """Return the candidates that have a start, of each start the widest choice, and the best few of those that have
    none, by their linear worth.
    """
    smooth = [candidates[k] for k in np.argsort(-worth, kind="stable") if candidates[k].offset is None][:_SMOOTH]
    widest: dict[tuple[str, tuple[tuple[str, float], ...]], Candidate] = {}
    for each in candidates:
        mark = each.effect, tuple(sorted(each.start.items()))
        if each.offset is not None and (mark not in widest or len(each.keys) > len(widest[mark].keys)):
            widest[mark] = each
    return [*smooth, *widest.values()]


def _narrower(candidate: Candidate, candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the narrower choices of a candidate's effect, each once."""
    found = {each.keys: each for each in candidates if set(each.keys) < set(candidate.keys)}
    return list(found.values())


def _best_of_each(sets: Iterable[CauseSet]) -> list[CauseSet]:
    """Return the best fit of each set of effects, best first."""
    best: dict[frozenset[str], CauseSet] = {}
    for each in sorted(sets, key=lambda each: each.cost):
        best.setdefault(each.effects, each)
    return list(best.values())


def _same(one: CauseSet, other: CauseSet) -> bool:
    """Return whether two fits of as many parameters leave the same, to what is of no matter."""
    apart = float(np.sum((one.fit.residual - other.fit.residual) ** 2))
    return len(one.fit.keys) == len(other.fit.keys) and apart < _SAME_ERROR * float(np.sum(one.fit.residual**2))


def distinct(sets: Iterable[CauseSet], order: dict[str, int]) -> list[CauseSet]:
    """Return the sets, best first, and of those whose error is the same the one whose effects come first in `order`, so
    that no last bit decides.
    """
    out: list[CauseSet] = []
    for each in _best_of_each(sets):
        twin = next((k for k, other in enumerate(out) if _same(each, other)), None)
        if twin is None:
            out.append(each)
        elif sorted(map(order.__getitem__, each.effects)) < sorted(map(order.__getitem__, out[twin].effects)):
            out[twin] = each
    return out
