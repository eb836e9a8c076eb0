"""The search for the set of effects that a recording needs: forward selection with swapping and pruning.

At each size all candidates, and at size two all pairs of them, are scored linearly; the best few are refitted
nonlinearly from each start. A cause is taken in only where χ² falls by more than chance gives the best of all
candidates, plus a penalty for each parameter; then each cause is offered to its rivals, and leaves if it does not pay
any more.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from discrepancy.fit import MOST_STEPS, Fit, Fitter, base_fit, columns_of
from discrepancy.library import Candidate, Library, library, noise_beneath
from discrepancy.problem import Problem
from discrepancy.scores import (
    PENALTY,
    Products,
    chance_maximum,
    drops,
    inflation_of,
    pairs,
    products,
    threshold,
)
from discrepancy.simulation import FloatArray
from discrepancy.whitening import Whitening, whitening

_BASE_ROUNDS = 2
_SHORT = 8
_SHORT_JOINT = 5
_LEADING = 10
_FIRST_STEPS = 3
_FINISHED = 3
_NEAR = 0.4
_MOST_CAUSES = 3
_OTHER_COLOUR = 0.01


@dataclass(frozen=True)
class Single:
    """A candidate alone: by how much it lowers χ², and its refit if it was worth one."""

    candidate: Candidate
    drop: float
    fit: Fit | None


@dataclass(frozen=True)
class Found:
    """What the search found: `base` and `best` fits with residuals, under the noise `white`.

    `causes` are the effects of `best` with the candidates they came by, `chance` the sorted draws of what noise gives
    the best of all candidates, `library` the columns at the base fit.
    """

    base: Fit
    best: Fit
    causes: tuple[Candidate, ...]
    singles: tuple[Single, ...]
    white: Whitening
    chance: FloatArray
    library: Library


def base_of(problem: Problem) -> tuple[Fit, FloatArray]:
    """Return the base model's fit, whitened by its own residual, and its columns (q, c, n) there."""
    values = problem.start()
    residual = problem.residual(values)
    columns = np.zeros((0, problem.c, problem.n))
    white = whitening(residual, problem.valid)
    found = Fit(values, residual, 0.0, ())
    for _ in range(_BASE_ROUNDS if problem.base else 0):
        columns = columns_of(problem, found.values, problem.base)
        found = base_fit(problem, white, found.values, columns)
        white = whitening(found.residual, problem.valid)
    return found, columns


class Search:
    """One search, with what it shares between steps."""

    def __init__(self, problem: Problem, names: Sequence[str], seed: int) -> None:
        self._problem = problem
        self._rng = np.random.default_rng(seed)
        base, columns = base_of(problem)
        self._library = library(problem, base.values, columns, tuple(names))
        base = replace(base, residual=problem.residual(base.values))
        self._use(noise_beneath(problem, base.residual, self._library.columns))
        self._base = self._fitter.fit(base.values, (), steps=3) if problem.base else self._rated(base)

    def found(self) -> Found:
        """Return what the recording needs."""
        problem, candidates = self._problem, self._library.candidates
        found = self._products(self._base, ())
        chance = chance_maximum(problem, found, candidates, self._q, self._base.values, self._rng)
        least = threshold(chance)
        singles = self._singles(found)
        best = self._base
        causes: tuple[Candidate, ...] = ()
        tried = [(single.fit, (single.candidate,)) for single in singles if single.fit is not None]
        first = self._best_of(tried, self._rated(best), found, least)
        if first is not None:
            best, causes = first
            best, causes = self._grown(best, causes, found, singles, least)
        return Found(self._rated(self._base), best, causes, singles, self.white, chance, self._library)

    def forced(self, names: Iterable[str]) -> Found:
        """Return the fit with exactly these effects, the choice within each by evidence."""
        best = self._base
        causes: tuple[Candidate, ...] = ()
        found = self._products(best, ())
        singles = self._singles(found)
        left = list(dict.fromkeys(names))
        while left:
            proposals = []
            for candidate, _ in self._ranked(best, [c for c in self._library.candidates if c.effect in left])[:_SHORT]:
                fit = self._joined(best, candidate)
                proposals.append((fit.chi2 + self._price(fit.keys), fit, candidate))
            _, best, candidate = min(proposals, key=lambda each: each[0])
            causes = (*causes, candidate)
            left.remove(candidate.effect)
            best = self._recoloured(best)
        for candidate in self._wider(causes):
            fit = self._joined(best, candidate)
            if fit.chi2 + self._price(fit.keys) < best.chi2 + self._price(best.keys):
                best = fit
        return Found(self._rated(self._base), best, causes, singles, self.white, np.zeros(1), self._library)

    def rivals(self, best: Fit, causes: tuple[Candidate, ...], most: int) -> list[tuple[int, Candidate, Fit]]:
        """Return other sets of equal size, refitted: the cause replaced, by what, and the fit; `most` for each
        cause.
        """
        out = []
        for place, cause in enumerate(causes):
            without = self._without(best, cause)
            others = [c for c in self._library.candidates if c.effect not in {each.effect for each in causes}]
            seen: set[str] = set()
            reach = best.chi2 + self._price(best.keys)
            need = max(without.chi2 - best.chi2, 0.0)
            for candidate, drop in self._ranked(without, others):
                if len(seen) >= most or drop < _NEAR * need:
                    break
                if candidate.effect in seen:
                    continue
                seen.add(candidate.effect)
                fit = self._joined(without, candidate, _FIRST_STEPS)
                if fit.chi2 + self._price(fit.keys) < reach + 0.2 * need:
                    fit = self._fitter.fit(fit.values, fit.keys)
                if fit.chi2 + self._price(fit.keys) < reach + 0.5 * need:
                    out.append((place, candidate, fit))
        return out

    def rated(self, fit: Fit) -> Fit:
        """Return a fit with its χ² under the present whitening."""
        return self._rated(fit)

    def without(self, best: Fit, cause: Candidate) -> Fit:
        """Return the fit without one cause."""
        return self._without(best, cause)

    @property
    def base_columns(self) -> FloatArray:
        """Return the base model's columns (q, c, n)."""
        return self._library.columns[: self._q]

    def _grown(
        self, best: Fit, causes: tuple[Candidate, ...], at_base: Products, singles: Sequence[Single], least: float
    ) -> tuple[Fit, tuple[Candidate, ...]]:
        problem = self._problem
        couples = pairs([single.candidate for single in singles[:_LEADING]], self._library.candidates)
        linear = drops(problem, at_base, couples, self._q, self._base.values)
        price = np.array([self._price(a.keys + b.keys) for a, b in couples])
        order = np.argsort(price - linear)
        while len(causes) < _MOST_CAUSES:
            best = self._recoloured(best)
            proposals: list[tuple[Fit, tuple[Candidate, ...]]] = []
            others = [c for c in self._library.candidates if c.effect not in {each.effect for each in causes}]
            for candidate, drop in self._ranked(best, [*others, *self._wider(causes)])[:_SHORT_JOINT]:
                if drop - self._price(candidate.keys) > 0.5 * least:
                    proposals.append((self._joined(best, candidate, _FIRST_STEPS), (*causes, candidate)))
            if len(causes) == 1:
                proposals += self._pairs_from_base(couples, order, best, least, linear - price)
            improved = self._best_of(proposals, best, at_base, least)
            if improved is None:
                return best, causes
            best, causes = self._swapped(*improved)
            best, causes = self._pruned(best, causes, least)
        return self._recoloured(best), causes

    def _pairs_from_base(
        self,
        couples: Sequence[tuple[Candidate, Candidate]],
        order: Iterable[int],
        best: Fit,
        least: float,
        worth: FloatArray,
    ) -> list[tuple[Fit, tuple[Candidate, ...]]]:
        """Return refits of the best linear pairs, of which several may share one effect but not both."""
        gained = self._rated(self._base).chi2 - best.chi2 - self._price(best.keys)
        out: list[tuple[Fit, tuple[Candidate, ...]]] = []
        seen: set[frozenset[str]] = set()
        for index in order:
            a, b = couples[index]
            if len(out) >= 3 or worth[index] < 0.5 * gained + 0.5 * least:
                break
            names = frozenset((a.effect, b.effect))
            if names in seen:
                continue
            seen.add(names)
            keys = tuple(dict.fromkeys((*a.keys, *b.keys)))
            begun = {**self._base.values, **a.start, **b.start}
            out.append((self._fitter.fit(begun, keys, _FIRST_STEPS), (a, b)))
        return out

    def _best_of(
        self,
        proposals: Sequence[tuple[Fit, tuple[Candidate, ...]]],
        best: Fit,
        at_base: Products,
        least: float,
    ) -> tuple[Fit, tuple[Candidate, ...]] | None:
        """Return the best proposal, finished, if its gain on `best` is more than chance gives; else None."""
        proposals = [(fit, causes) for fit, causes in proposals if all(self._matters(fit, each) for each in causes)]
        if not proposals:
            return None
        ranked = sorted(proposals, key=lambda each: each[0].chi2 + self._price(each[0].keys))[:_FINISHED]
        finished = [(self._fitter.fit(fit.values, fit.keys), causes) for fit, causes in ranked]
        fit, causes = min(finished, key=lambda each: each[0].chi2 + self._price(each[0].keys))
        price = self._price(fit.keys) - self._price(best.keys)
        surely = (best.chi2 - fit.chi2) / inflation_of(at_base, causes, self._q) - price > least
        return (fit, causes) if surely and self._likelier(fit, best) else None

    def _matters(self, fit: Fit, cause: Candidate) -> bool:
        """Return whether a parameter of a cause is further from neutral than its scale, or has no finite neutral."""
        for key in cause.keys:
            p = self._problem.parameters[key]
            if not abs(fit.values.get(key, p.neutral) - p.neutral) <= p.scale:
                return True
        return False

    def _likelier(self, fit: Fit, than: Fit) -> bool:
        """Return whether a fit pays for its parameters also under the noise that its own residual tells.

        What is beneath the whole library may be taken for less than the noise is, where the library is large.
        """
        own = whitening(fit.residual, self._problem.valid)
        fell = float(np.sum(own(than.residual) ** 2) - np.sum(own(fit.residual) ** 2))
        return fell > self._price(fit.keys) - self._price(than.keys)

    def _swapped(self, best: Fit, causes: tuple[Candidate, ...]) -> tuple[Fit, tuple[Candidate, ...]]:
        for place, candidate, fit in self.rivals(best, causes, 2):
            if fit.chi2 + self._price(fit.keys) < best.chi2 + self._price(best.keys):
                best, causes = fit, tuple(candidate if k == place else each for k, each in enumerate(causes))
        return best, causes

    def _pruned(self, best: Fit, causes: tuple[Candidate, ...], least: float) -> tuple[Fit, tuple[Candidate, ...]]:
        for cause in causes:
            if len({each.effect for each in causes}) < 2:
                break
            without = self._without(best, cause)
            if without.chi2 + self._price(without.keys) - best.chi2 - self._price(best.keys) < least:
                best, causes = without, tuple(each for each in causes if each.effect != cause.effect)
        return best, causes

    def _singles(self, found: Products) -> tuple[Single, ...]:
        """Return all candidates alone, the best few of them refitted, two starts or choices of an effect at most."""
        problem, candidates = self._problem, self._library.candidates
        drop = drops(problem, found, [(each,) for each in candidates], self._q, self._base.values)
        worth = drop - np.array([self._price(each.keys) for each in candidates])
        refits: dict[int, Fit] = {}
        counts: dict[str, int] = {}
        base = self._rated(self._base)
        for index in np.argsort(-worth):
            each = candidates[index]
            if len(refits) >= _SHORT or (refits and worth[index] < _NEAR * max(worth.max(), 0.0)):
                break
            counts[each.effect] = counts.get(each.effect, 0) + 1
            if counts[each.effect] <= 2:
                refits[int(index)] = self._joined(self._base, each, _FIRST_STEPS)
        refits = {index: fit for index, fit in refits.items() if self._matters(fit, candidates[index])}
        for index in sorted(refits, key=lambda k: refits[k].chi2 + self._price(refits[k].keys))[:_FINISHED]:
            refits[index] = self._fitter.fit(refits[index].values, refits[index].keys)
        singles = []
        for index, each in enumerate(candidates):
            fit = refits.get(index)
            gained = float(drop[index]) if fit is None else base.chi2 - fit.chi2
            singles.append(Single(each, gained, fit))
        return tuple(sorted(singles, key=lambda each: self._price(each.candidate.keys) - each.drop))

    def _ranked(self, fit: Fit, candidates: Sequence[Candidate]) -> list[tuple[Candidate, float]]:
        """Return candidates with their linear drop beside a fit, the best penalised first."""
        if not candidates:
            return []
        found = self._products(fit, fit.keys)
        drop = drops(self._problem, found, [(each,) for each in candidates], self._q, fit.values)
        worth = drop - np.array([self._price(each.keys) for each in candidates])
        return [(candidates[k], float(drop[k])) for k in np.argsort(-worth)]

    def _wider(self, causes: tuple[Candidate, ...]) -> list[Candidate]:
        """Return what further choices of the causes' effects would add to them."""
        out = []
        for effect in dict.fromkeys(each.effect for each in causes):
            held = {key for each in causes if each.effect == effect for key in each.keys}
            allowed = [set(c.keys) for c in self._library.candidates if c.effect == effect]
            for c in self._library.candidates:
                new = [key for key in c.keys if key not in held]
                if c.effect == effect and new and any(held | set(new) <= each for each in allowed):
                    rows = tuple(row for key, row in zip(c.keys, c.columns, strict=True) if key in new)
                    start = {key: value for key, value in c.start.items() if key in new}
                    choice = tuple(p for p, key in zip(c.choice, c.keys, strict=True) if key in new)
                    out.append(Candidate(effect, choice, tuple(new), start, rows, c.offset if start else None))
        return out

    def _joined(self, fit: Fit, candidate: Candidate, steps: int = MOST_STEPS) -> Fit:
        keys = tuple(dict.fromkeys((*fit.keys, *candidate.keys)))
        return self._fitter.fit({**fit.values, **candidate.start}, keys, steps)

    def _without(self, best: Fit, cause: Candidate) -> Fit:
        keys = tuple(key for key in best.keys if key.split(".")[0] != cause.effect)
        values = {key: value for key, value in best.values.items() if key.split(".")[0] != cause.effect}
        return self._fitter.fit(values, keys)

    def _recoloured(self, best: Fit) -> Fit:
        """Whiten anew where the colour of what is left differs, and return the fit under it."""
        own = whitening(best.residual, self._problem.valid)
        e_own, e_now = own(best.residual), self.white(best.residual)
        told = own.log_det + float(np.sum(e_own**2))
        now = self.white.log_det * own.count / self.white.count + float(np.sum(e_now**2))
        if now - told < _OTHER_COLOUR * own.count:
            return best
        columns = np.concatenate((self._library.columns, columns_of(self._problem, best.values, best.keys)))
        self._use(noise_beneath(self._problem, best.residual, columns, rounds=1))
        return self._fitter.fit(best.values, best.keys, steps=4)

    def _use(self, white: Whitening) -> None:
        self.white = white
        self._stack = self._library.whitened(white)
        self._fitter = Fitter(self._problem, white, self.base_columns)

    def _products(self, fit: Fit, keys: Sequence[str]) -> Products:
        extra = None
        if keys:
            raw = columns_of(self._problem, fit.values, keys)
            extra = np.stack([self.white(column).reshape(-1) for column in raw])
        return products(self._stack, self._q, self.white(fit.residual).reshape(-1), self._problem.n, extra)

    def _rated(self, fit: Fit) -> Fit:
        return replace(fit, chi2=float(np.sum(self.white(fit.residual) ** 2)))

    @property
    def _q(self) -> int:
        return self._library.base

    def _price(self, keys: Sequence[str]) -> float:
        return PENALTY * len(keys)
