"""The search for the set of effects that a recording needs: forward selection with swapping and pruning.

At each size all candidates, and at size two all pairs of them, are scored linearly; the best few are refitted
nonlinearly from each start. A cause is taken in only where χ² falls by more than chance gives the best of all
candidates, plus a penalty for each parameter; then each cause is offered to its rivals, and leaves if it does not pay
any more.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.evidence.whitening import Whitening
from discrepancy.problem import Problem
from discrepancy.search.candidates import Candidate, Library
from discrepancy.search.fit import Fit
from discrepancy.search.refits import Refits
from discrepancy.search.scores import Products, chance_maximum, drops, inflation_of, pairs, threshold
from messages.arrays import FloatArray

_SHORT = 6
"""Of neutral candidates, and as many of started ones, that are refitted alone."""
_SHORT_JOINT = 5
_LEADING = 10
_FIRST_STEPS = 3
_FINISHED = 3
_NEAR = 0.4
_MOST_CAUSES = 3
_FULFILLED = 0.1
"""Of a started candidate's linear score, which is only a promise: a refit that gains less tells nothing of the effect's
other starts."""
_MOST_STARTED = 12
_OF_EXCESS = 0.03
"""Of the excess that is left: what a further cause must remove. Less may be the first ones' own inexactness."""


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


class Search(Refits):
    """One search, with what it shares between steps."""

    def __init__(self, problem: Problem, names: Sequence[str], seed: int) -> None:
        super().__init__(problem, names)
        self._rng = np.random.default_rng(seed)

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
            for candidate, _ in self._ranked(best, [c for c in self._library.candidates if c.effect in left])[
                :_LEADING
            ]:
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

    def _grown(
        self, best: Fit, causes: tuple[Candidate, ...], at_base: Products, singles: Sequence[Single], least: float
    ) -> tuple[Fit, tuple[Candidate, ...]]:
        problem = self._problem
        leading = [each.candidate for each in singles if each.fit is not None or each.candidate.offset is None]
        couples = pairs(leading[:_LEADING], self._library.candidates)
        linear = drops(problem, at_base, couples, self._q, self._base.values)
        price = np.array([self._price(a.keys + b.keys) for a, b in couples])
        order = np.argsort(price - linear)
        while len(causes) < _MOST_CAUSES:
            best = self._recoloured(best)
            proposals: list[tuple[Fit, tuple[Candidate, ...]]] = []
            others = [c for c in self._library.candidates if c.effect not in {each.effect for each in causes}]
            wider = self._wider(causes)
            neutral = [c for c in wider if c.offset is None]
            for candidate, drop in self._ranked(best, [*others, *neutral])[:_SHORT_JOINT]:
                if drop - self._price(candidate.keys) > 0.5 * least:
                    proposals.append((self._joined(best, candidate, _FIRST_STEPS), (*causes, candidate)))
            proposals += [
                (self._joined(best, candidate, _FIRST_STEPS), (*causes, candidate))
                for candidate in self._begun_beside(best, [c for c in wider if c.offset is not None])
            ]
            if len(causes) == 1:
                proposals += self._pairs_from_base(couples, order, best, least, linear - price)
            material = _OF_EXCESS * max(best.chi2 - self.white.count, 0.0)
            improved = self._best_of(proposals, best, at_base, max(least, material))
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
        for fit, causes in sorted(finished, key=lambda each: each[0].chi2 + self._price(each[0].keys)):
            price = self._price(fit.keys) - self._price(best.keys)
            surely = (best.chi2 - fit.chi2) / inflation_of(at_base, causes, self._q) - price > least
            if surely and self._likelier(fit, best):
                return fit, causes
        return None

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
        """Return all candidates alone, the best few neutral ones and the best few started ones refitted."""
        candidates = self._library.candidates
        drop = drops(self._problem, found, [(each,) for each in candidates], self._q, self._base.values)
        refits = self._refitted(drop - np.array([self._price(each.keys) for each in candidates]))
        base = self._rated(self._base)
        singles = []
        for index, each in enumerate(candidates):
            fit = refits.get(index)
            gained = float(drop[index]) if fit is None else base.chi2 - fit.chi2
            singles.append(Single(each, gained, fit))
        return tuple(sorted(singles, key=lambda each: self._price(each.candidate.keys) - each.drop))

    def _refitted(self, worth: FloatArray) -> dict[int, Fit]:
        """Return refits by index of the candidates whose linear `worth` comes near the best, two of an effect at most.

        A started candidate's linear worth is no measure for others: the measure is what refits gain.
        """
        candidates = self._library.candidates
        base = self._rated(self._base).chi2
        order = [int(index) for index in np.argsort(-worth)]
        refits: dict[int, Fit] = {}
        reached = 0.0
        for started in (False, True):
            counts: dict[str, int] = {}
            tried = 0
            for index in order:
                each = candidates[index]
                if (each.offset is not None) != started or counts.get(each.effect, 0) >= 2:
                    continue
                enough = sum(counts.values()) >= _SHORT or tried >= _MOST_STARTED
                if enough or (tried and worth[index] < _NEAR * reached):
                    break
                tried += 1
                refits[index] = self._joined(self._base, each, _FIRST_STEPS)
                gained = base - refits[index].chi2 - self._price(each.keys)
                reached = max(reached, gained)
                if not started or gained > _FULFILLED * worth[index]:
                    counts[each.effect] = counts.get(each.effect, 0) + 1
        refits = {index: fit for index, fit in refits.items() if self._matters(fit, candidates[index])}
        for index in sorted(refits, key=lambda k: refits[k].chi2 + self._price(refits[k].keys))[:_FINISHED]:
            refits[index] = self._fitter.fit(refits[index].values, refits[index].keys)
        return refits
