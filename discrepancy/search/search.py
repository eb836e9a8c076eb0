"""The search for the set of effects that a recording needs: forward selection with swapping and pruning.

At each size all candidates, and at size two all pairs of them, are scored linearly; the best few are refitted
nonlinearly from each start. A cause is taken in only where χ² falls by more than chance gives the best of all
candidates, plus a penalty for each parameter; then each cause is offered to its rivals, and leaves if it does not pay
any more.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.evidence.whitening import White
from discrepancy.problem import Problem
from discrepancy.search.candidates import Candidate, Library
from discrepancy.search.fit import Fit
from discrepancy.search.refits import Refits, cost, price, simplest_first
from discrepancy.search.scores import Products, chance_maximum, inflation_of, pairs, threshold
from discrepancy.search.singles import FINISHED, FIRST_STEPS, NEAR, Single, singles
from discrepancy.search.smallest import Smallest, smallest
from messages.arrays import FloatArray

_MOST_CAUSES = 8
"""Effects in a verdict: each takes a round of refits, and one that does not pay ends them long before."""
_MOST_JOINED = 5
"""Candidates that are refitted beside the causes so far: a refit costs dozens of predictions, a score none."""
_MOST_FORCED = 10
"""Candidates that are refitted to choose the next of the effects that were asked for."""
_LEADING = 10
"""Single candidates whose pairs with all others are scored: the better half of a pair stands out alone too."""
_MOST_PAIRS = 3
"""Pairs that are refitted from the base model."""
_PROMISING = 0.5
"""Of what must be gained: a candidate whose linear score is lower is not refitted; a refit that gains more than twice
its score is rare."""
_SWAPS = 2
"""Rivals of each cause that may take its place."""
_SECONDS = 2
"""Candidates that are refitted beside a rival in a cause's place, to see whether both are better than the cause."""
_RIVAL_FINISHED, _RIVAL_TOLD = 0.2, 0.5
"""Of what χ² rises by without a cause: a rival that fits worse by less is fitted to the end, then told."""
_OF_EXCESS = 0.03
"""Of the excess that is left: what a further cause must remove. Less may be the first ones' own inexactness."""

_MANY, _OF_EXPLAINED = 3, 3e-4
"""Causes, from which on a further one must bring this share of what all explain: their formulas are no better."""

Proposal = tuple[Fit, tuple[Candidate, ...]]
"""A fit with the candidates that it holds."""


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
    white: White
    chance: FloatArray
    library: Library


class Search:
    """One search among the effects of these `names`; `seed` draws what chance gives."""

    def __init__(self, problem: Problem, names: Sequence[str], seed: int) -> None:
        self._problem = problem
        self.refits = Refits(problem, names)
        self._rng = np.random.default_rng(seed)
        self._asked: tuple[object, ...] | None = None
        self._asked_under: White | None = None
        self._answer: list[tuple[int, Candidate, Fit]] = []

    def found(self) -> Found:
        """Return what the recording needs."""
        refits = self.refits
        base = refits.base
        at_base = refits.products(base)
        chance = chance_maximum(self._problem, at_base, refits.candidates, refits.library.base, base.values, self._rng)
        least = threshold(chance)
        alone = singles(refits, at_base)
        best: Fit = base
        causes: tuple[Candidate, ...] = ()
        tried = [(single.fit, (single.candidate,)) for single in alone if single.fit is not None]
        first = self._best_of(tried, refits.rated(base), at_base, least)
        if first is not None:
            best, causes = self._grown(*first, at_base, alone, least)
        return Found(refits.rated(base), best, causes, alone, refits.white, chance, refits.library)

    def forced(self, names: Iterable[str]) -> Found:
        """Return the fit with exactly these effects, the choice within each by evidence."""
        refits = self.refits
        best = refits.base
        causes: tuple[Candidate, ...] = ()
        alone = singles(refits, refits.products(best))
        left = list(dict.fromkeys(names))
        while left:
            ranked = refits.ranked(best, [c for c in refits.candidates if c.effect in left])[:_MOST_FORCED]
            proposals = [(refits.joined(best, candidate), candidate) for candidate, _ in ranked]
            best, candidate = min(proposals, key=lambda each: cost(each[0]))
            causes = (*causes, candidate)
            left.remove(candidate.effect)
            best = refits.recoloured(best)
        for candidate in refits.wider(causes):
            best = min(best, refits.joined(best, candidate), key=cost)
        return Found(refits.rated(refits.base), best, causes, alone, refits.white, np.zeros(1), refits.library)

    def rivals(self, best: Fit, causes: tuple[Candidate, ...], most: int) -> list[tuple[int, Candidate, Fit]]:
        """Return other sets of equal size, refitted: the cause replaced, by what, and the fit; `most` for each
        cause. The last answer is kept: what could be better and what is as good are both read from it.
        """
        refits = self.refits
        asked = (tuple(best.values.items()), causes, most)
        if asked == self._asked and refits.white is self._asked_under:
            return self._answer
        tried: list[tuple[int, Candidate, float, Fit]] = []
        for place, cause in enumerate(causes):
            without = refits.without(best, cause)
            seen: set[str] = set()
            need = max(without.chi2 - best.chi2, 0.0)
            for candidate, drop in refits.ranked(without, self._others(causes)):
                if len(seen) >= most or drop < NEAR * need:
                    break
                if candidate.effect not in seen:
                    seen.add(candidate.effect)
                    tried.append((place, candidate, need, without))
        fits = refits.joined_each([(without, candidate) for _, candidate, _, without in tried], FIRST_STEPS)
        reach = cost(best)
        near = [k for k, fit in enumerate(fits) if cost(fit) < reach + _RIVAL_FINISHED * tried[k][2]]
        for k, fit in zip(near, refits.finished_each([fits[k] for k in near]), strict=True):
            fits[k] = fit
        out = [
            (place, candidate, fit)
            for (place, candidate, need, _), fit in zip(tried, fits, strict=True)
            if cost(fit) < reach + _RIVAL_TOLD * need
        ]
        self._asked, self._asked_under, self._answer = asked, refits.white, out
        return out

    def smallest(self, chance: FloatArray) -> Smallest:
        """Return from which size effects would have been seen beside the base model, by the draws of `chance`."""
        refits = self.refits
        at_base = refits.products(refits.base)
        return smallest(self._problem, refits.library, at_base, refits.candidates, threshold(chance))

    def rated(self, fit: Fit) -> Fit:
        """Return a fit with its χ² under the present whitening."""
        return self.refits.rated(fit)

    def without(self, best: Fit, cause: Candidate) -> Fit:
        """Return the fit without one cause."""
        return self.refits.without(best, cause)

    def _others(self, causes: tuple[Candidate, ...]) -> list[Candidate]:
        """Return the candidates of effects that are not in yet."""
        names = {each.effect for each in causes}
        return [each for each in self.refits.candidates if each.effect not in names]

    def _grown(
        self, best: Fit, causes: tuple[Candidate, ...], at_base: Products, alone: Sequence[Single], least: float
    ) -> Proposal:
        """Return the first cause with all that join it, as long as each pays."""
        refits = self.refits
        base = refits.base
        couples = _Couples.of(refits, at_base, alone)
        while len(causes) < _MOST_CAUSES:
            best = refits.recoloured(best)
            wider = refits.wider(causes)
            neutral = [c for c in wider if c.offset is None]
            ranked = refits.ranked(best, [*self._others(causes), *neutral])[:_MOST_JOINED]
            further = [c for c, drop in ranked if drop - price(c.keys) > _PROMISING * least]
            further += refits.begun_beside(best, [c for c in wider if c.offset is not None])
            fits = refits.joined_each([(best, candidate) for candidate in further], FIRST_STEPS)
            proposals: list[Proposal] = [
                (fit, (*causes, candidate)) for fit, candidate in zip(fits, further, strict=True)
            ]
            if len(causes) == 1:
                proposals += self._pairs_from_base(couples, best, least)
            material = _OF_EXCESS * max(best.chi2 - refits.white.count, 0.0)
            if len(causes) >= _MANY:
                material = max(material, _OF_EXPLAINED * (refits.rated(base).chi2 - best.chi2))
            enough = max(least, material)
            improved = self._best_of(proposals, best, at_base, enough)
            if improved is None:
                improved = self._best_of(self._exchanged_for_two(best, causes, least), best, at_base, enough)
            if improved is None:
                return best, causes
            best, causes = self._swapped(*improved)
            best, causes = self._pruned(best, causes, least)
        return refits.recoloured(best), causes

    def _pairs_from_base(self, couples: "_Couples", best: Fit, least: float) -> list[Proposal]:
        """Return refits of the best linear pairs, of which several may share one effect but not both."""
        base = self.refits.base
        gained = self.refits.rated(base).chi2 - cost(best)
        out: list[Proposal] = []
        seen: set[frozenset[str]] = set()
        for index in couples.order:
            a, b = couples.couples[index]
            if len(out) >= _MOST_PAIRS or couples.worth[index] < _PROMISING * gained + _PROMISING * least:
                break
            names = frozenset((a.effect, b.effect))
            if names in seen:
                continue
            seen.add(names)
            keys = tuple(dict.fromkeys((*a.keys, *b.keys)))
            begun = {**base.values, **a.start, **b.start}
            out.append((self.refits.fitted(begun, keys, FIRST_STEPS), (a, b)))
        return out

    def _exchanged_for_two(self, best: Fit, causes: tuple[Candidate, ...], least: float) -> list[Proposal]:
        """Return refits with one cause exchanged for a rival and, beside that, what the rival leaves most for.

        One effect that imitates two is taken in before either: neither of them improves the fit beside it, nor alone in
        its place. The second may be the cause itself, begun anew where the rival has taken over what was the rival's.
        Two that gain little for having more parameters imitate the one.
        """
        refits = self.refits
        proposals: list[Proposal] = []
        for place, rival, fit in self.rivals(best, causes, _SWAPS):
            swapped = tuple(rival if k == place else each for k, each in enumerate(causes))
            missing = cost(fit) - cost(best)
            for second, drop in refits.ranked(fit, self._others(swapped))[:_SECONDS]:
                if drop - price(second.keys) > missing + _PROMISING * least:
                    proposals.append((refits.joined(fit, second, FIRST_STEPS), (*swapped, second)))
        before = refits.rated(refits.base)
        return [each for each in proposals if simplest_first(before, (best, each[0]), lambda fit: fit)[0] is not best]

    def _best_of(self, proposals: Sequence[Proposal], best: Fit, at_base: Products, least: float) -> Proposal | None:
        """Return the best proposal, finished, if its gain on `best` is more than chance gives; else None.

        Where the noise beneath the library is that of none of them, all are finished and held against each other, each
        under its own: slow misfit weighs next to nothing under one colour of noise, and all under another.
        """
        refits = self.refits
        proposals = [(fit, causes) for fit, causes in proposals if all(refits.matters(fit, each) for each in causes)]
        leading: dict[frozenset[str], Proposal] = {}
        for fit, causes in sorted(proposals, key=lambda each: cost(each[0])):
            leading.setdefault(frozenset(each.effect for each in causes), (fit, causes))
        ranked = list(leading.values())
        finished = self._finished(ranked[:FINISHED])
        if refits.unlike_all(fit for fit, _ in finished):
            finished += self._finished(ranked[FINISHED:])
            order = sorted(finished, key=lambda each: refits.deviance(each[0]) + price(each[0].keys))
        else:
            order = simplest_first(best, finished, lambda each: each[0])
        for fit, causes in order:
            gain = (best.chi2 - fit.chi2) / inflation_of(at_base, causes, refits.library.base)
            pays = gain - (price(fit.keys) - price(best.keys)) > least
            if pays and refits.likelier(fit, best) and not refits.cancel(fit, causes):
                return fit, causes
        return None

    def _finished(self, proposals: Sequence[Proposal]) -> list[Proposal]:
        fits = self.refits.finished_each([fit for fit, _ in proposals])
        return [(fit, causes) for fit, (_, causes) in zip(fits, proposals, strict=True)]

    def _swapped(self, best: Fit, causes: tuple[Candidate, ...]) -> Proposal:
        """Return the causes, each replaced by a rival that fits better."""
        begun = causes
        for place, candidate, fit in self.rivals(best, begun, _SWAPS):
            swapped = tuple(candidate if k == place else each for k, each in enumerate(begun))
            if self.refits.outdoes(fit, best) and not self.refits.cancel(fit, swapped):
                best, causes = fit, swapped
        return best, causes

    def _pruned(self, best: Fit, causes: tuple[Candidate, ...], least: float) -> Proposal:
        """Return the causes without those that do not pay beside the others any more."""
        for cause in causes:
            if len({each.effect for each in causes}) < 2:
                break
            without = self.refits.without(best, cause)
            if cost(without) - cost(best) < least:
                best, causes = without, tuple(each for each in causes if each.effect != cause.effect)
        return best, causes


@dataclass(frozen=True)
class _Couples:
    """Pairs of candidates with their linear `worth` (χ² less the price of their parameters), and their order by it."""

    couples: Sequence[tuple[Candidate, Candidate]]
    worth: FloatArray
    order: Sequence[int]

    @classmethod
    def of(cls, refits: Refits, at_base: Products, alone: Sequence[Single]) -> "_Couples":
        """Return the pairs of the leading single candidates with all others."""
        leading = [each.candidate for each in alone if each.fit is not None or each.candidate.offset is None]
        couples = pairs(leading[:_LEADING], refits.candidates)
        linear = refits.drops(at_base, couples, refits.base)
        worth = linear - np.array([price(a.keys + b.keys) for a, b in couples])
        return cls(couples, worth, np.argsort(-worth).tolist())
