"""Which of the terms made at the ports a recording needs: forward selection with score tests, and pruning.

At each step every term, at each of its starts, is scored by the columns of its amounts at the fit so far: trajectories
bend, and a column taken at the base model says little of them once a term is in. The best few are refitted whole, and
one is taken in where it gains more than chance gives the best of all, plus its price.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np

from discrepancy.construct.columns import Ports
from discrepancy.construct.learned import learned
from discrepancy.construct.terms import MadeTerm
from discrepancy.evidence.whitening import White
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.problem import Problem
from discrepancy.search.candidates import Candidate, Library, library, noise_beneath
from discrepancy.search.equivalents import SAME_CHI2
from discrepancy.search.fit import Fit, Fitter, columns_of
from discrepancy.search.refits import base_of, cost, price, simplest_first
from discrepancy.search.scores import Products, chance_maximum, drops, products, threshold
from discrepancy.search.search import Found
from discrepancy.search.singles import Single
from discrepancy.verdict import MOST_EQUIVALENTS
from messages.arrays import FloatArray

MOST_TERMS = 3
"""Terms in a construction: each takes a round, and one that does not pay ends them before."""
_TRIED, _LED, _FINISHED = 6, 4, 2
"""Effects that are refitted in a round, followed further, and finished: where trajectories bend, linear scores are but
promises."""
_STARTS = 9
"""Of one effect, that are refitted in a round: the one with the best score may lead astray."""
_FINISHED_FROM = 0.7
"""Of the gain of the best of them after its first steps: one that gained less is not finished."""
_FIRST_STEPS, _SECOND_STEPS = 2, 8
"""Steps of a fit that only has to show whether it is worth following, and finishing."""
_PROMISING = 0.05
"""Of the best linear score: a term with a lower one is not refitted."""
_OF_EXCESS = 0.03
"""Of the excess that is left: what a further term must remove. Less may be the first ones' own inexactness."""
_RIVALS, _RIVAL_STEPS = 3, 10
"""Terms that are refitted in the place of each of those found, and for how long."""
_NEAR = 2.0
"""Times the best χ² that a rival has after its first steps, at most, to be finished."""


@dataclass(frozen=True)
class Round:
    """All candidates at one fit, under the noise beneath them."""

    library: Library
    white: White
    fitter: Fitter
    found: Products
    drop: FloatArray


class Selection:
    """One selection among made terms and the effects of a library, `names`, for the simulations `wholes` of a problem's
    recordings; `seed` draws what chance gives.
    """

    def __init__(
        self,
        problem: Problem,
        ports: Ports,
        wholes: Sequence[PortedSimulation],
        made: Sequence[MadeTerm],
        names: Sequence[str],
        start: dict[str, float],
        seed: int,
    ) -> None:
        self._problem, self._ports, self._wholes = problem, ports, wholes
        self._made = {each.effect.name: each for each in made}
        self._names = tuple(names)
        self._rng = np.random.default_rng(seed)
        self._base, self._base_columns = base_of(problem, start)
        self._fitter: Fitter | None = None
        self._first_tried: list[tuple[Candidate, Fit]] = []

    def _exchanged(self, here: Round, best: Fit) -> tuple[Fit, tuple[Candidate, ...]] | None:
        """Return the rival of the first cause that fits better under the noise as it looks now; None without one.

        The noise beneath all columns holds what bends too far for them: it makes rivals alike that are not.
        """
        before = replace(best, chi2=_chi2(here.white, best))
        rivals = [each for each in self._first_tried if each[1].keys != best.keys]
        fits = here.fitter.fit_each([(fit.values, fit.keys) for _, fit in rivals])
        found = _best_of_each([candidate for candidate, _ in rivals], fits)
        if found and cost(before) - cost(found[0][1]) > SAME_CHI2:
            return found[0][1], (found[0][0],)
        return None

    @property
    def base(self) -> Fit:
        """Return the base model's fit."""
        return self._base

    def found(self, adequate: Callable[[Fit], bool], most: int = MOST_TERMS) -> Found:
        """Return what the recording needs, `most` terms; nothing more is taken in once a fit is `adequate`."""
        best = self._base
        causes: tuple[Candidate, ...] = ()
        while len(causes) < most:
            here = self._round(best, causes)
            if len(causes) == 1 and (exchanged := self._exchanged(here, best)) is not None:
                best, causes = exchanged
                if adequate(best):
                    break
                here = self._round(best, causes)
            draws = self._chance(here, best)
            tried = self._tried(here, best)
            if not causes:
                first, self._first_tried, chance = here, tried, draws
                singles = self._singles(here, best, tried)
            improved = self._improved(here, best, causes, tried, threshold(draws))
            if improved is None:
                break
            best, causes = self._pruned(*improved, threshold(draws))
            if adequate(best):
                break
        base = replace(self._base, chi2=_chi2(here.white, self._base))
        return Found(base, best, causes, singles, here.white, chance, first.library)

    def curve(self) -> tuple[MadeTerm, Found] | None:
        """Return the learned curve that predicts best, as what was found; None where none predicts anything."""
        problem, base = self._problem, self._base
        here = self._round(base, ())
        rows = here.library.columns[here.library.base :]
        terms = [
            (self._made[each.effect], rows[np.array(each.columns) - here.library.base])
            for each in here.library.candidates
        ]
        best = learned(problem, base, self._base_columns, terms)
        if best is None:
            return None
        made, fit = best
        cause = next(each for each in here.library.candidates if each.effect == made.effect.name)
        draws = self._chance(here, base)
        rated = replace(base, chi2=_chi2(here.white, base))
        singles = (Single(cause, rated.chi2 - _chi2(here.white, fit), fit, rated.chi2),)
        return made, Found(rated, fit, (cause,), singles, here.white, draws, here.library)

    def without(self, best: Fit, cause: Candidate) -> Fit:
        """Return the fit without one cause, under the noise of the last round; where the simulation diverges without
        it, begun at the base model's own values.
        """
        assert self._fitter is not None
        keys = tuple(key for key in best.keys if key.split(".")[0] != cause.effect)
        values = {key: value for key, value in best.values.items() if key.split(".")[0] != cause.effect}
        fit = self._fitter.fit(values, keys)
        return fit if isfinite(fit.chi2) else self._fitter.fit({**values, **self._base.values}, keys)

    def rise(self, best: Fit, cause: Candidate) -> float:
        """Return by how much χ² rises without a cause, under the noise that the whole fit leaves."""
        white = self._problem.whitening(best.residual)
        others = [each for each in best.keys if each.split(".")[0] != cause.effect]
        without = self.without(best, cause) if others else self._base
        return _chi2(white, without) - _chi2(white, best)

    def alike(self, best: Fit, causes: Sequence[Candidate]) -> tuple[dict[str, dict[str, float]], dict[str, float]]:
        """Return for each cause what fits as well in its place, with the rise of χ² that each makes, and the rise of
        the best one that does not.
        """
        same: dict[str, dict[str, float]] = {}
        other: dict[str, float] = {}
        for cause in causes:
            if len(causes) == 1:
                tried = [each for each in self._first_tried if each[0].effect != cause.effect]
            else:
                without = self.without(best, cause)
                tried = self._tried(self._round(without, causes), without) if isfinite(without.chi2) else []
            assert self._fitter is not None
            white = self._fitter.white
            rated = replace(best, chi2=_chi2(white, best))
            tried = [each for each in tried if _chi2(white, each[1]) < _NEAR * rated.chi2][:_RIVALS]
            as_good: list[tuple[float, str]] = []
            fits = self._fitter.fit_each([(fit.values, fit.keys) for _, fit in tried], _RIVAL_STEPS)
            for (candidate, _), fit in zip(tried, fits, strict=True):
                worse = fit.chi2 - rated.chi2
                if abs(worse) < SAME_CHI2 and len(fit.keys) <= len(best.keys) + 1:
                    as_good.append((worse, candidate.effect))
                else:
                    other[cause.effect] = min(other.get(cause.effect, worse), worse)
            same[cause.effect] = {name: worse for worse, name in sorted(as_good)[:MOST_EQUIVALENTS]}
        return same, other

    def _round(self, best: Fit, causes: Sequence[Candidate]) -> Round:
        """Return all candidates that are not in yet, scored beside a fit."""
        problem = self._problem
        held = {each.effect for each in causes}
        known = library(problem, best.values, self._base_columns, tuple(n for n in self._names if n not in held))
        free = [each for name, each in self._made.items() if name not in held]
        made, rows = self._columns(best, free, len(known.columns))
        columns = np.concatenate((known.columns, rows))
        candidates = (*known.candidates, *made)
        pool = Library(columns, known.base, candidates)
        own = columns_of(problem, best.values, best.keys)
        white = noise_beneath(problem, best.residual, np.concatenate((columns, own)))
        stack = pool.whitened(white)
        extra = np.stack([white(row).reshape(-1) for row in own]) if len(own) else None
        found = products(stack, pool.base, white(best.residual).reshape(-1), problem.n, extra)
        drop = drops(problem, found, [(each,) for each in candidates], pool.base, best.values)
        self._fitter = Fitter(problem, white, self._base_columns, fresh=True)
        return Round(pool, white, self._fitter, found, drop)

    def _columns(self, best: Fit, made: Sequence[MadeTerm], first: int) -> tuple[list[Candidate], FloatArray]:
        """Return the candidates of made terms at all their starts, and the columns (m, c, n) of their amounts."""
        problem = self._problem
        candidates: list[Candidate] = []
        for each in made:
            effect, form = each.effect, each.form
            for start in effect.starts or ({},):
                begun = {effect.qualified(name): float(value) for name, value in start.items()}
                rows = tuple(range(first, first + len(form.amounts)))
                first += len(form.amounts)
                candidates.append(Candidate(effect.name, form.amounts, each.keys, begun, rows, None))
        columns = [
            self._ports.columns(whole, part.completed(problem.values_of(place, best.values)), made)[:, :, : part.n]
            for place, (part, whole) in enumerate(zip(problem.parts, self._wholes, strict=True))
        ]
        rows_ = np.concatenate(columns, axis=2)
        return candidates, np.stack([problem.filled(np.ascontiguousarray(row)) for row in rows_])

    def _chance(self, here: Round, best: Fit) -> FloatArray:
        candidates = here.library.candidates
        return chance_maximum(self._problem, here.found, candidates, here.library.base, best.values, self._rng)

    def _price(self, candidate: Candidate) -> float:
        return price(self._keys(candidate))

    def _keys(self, candidate: Candidate) -> tuple[str, ...]:
        """Return all parameters that are fitted with a candidate: of a made term its shape too."""
        made = self._made.get(candidate.effect)
        if made is None:
            return candidate.keys
        return made.all_keys

    def _tried(self, here: Round, best: Fit) -> list[tuple[Candidate, Fit]]:
        """Return the best few effects, each at its best start, refitted a few steps beside a fit, best first.

        Their shapes are held at first: each start is then as good as its amounts make it.
        """
        worth = here.drop - np.array([self._price(each) for each in here.library.candidates])
        order = [int(k) for k in np.argsort(-worth)]
        seen: Counter[str] = Counter()
        chosen: list[Candidate] = []
        for k in order:
            candidate = here.library.candidates[k]
            if candidate.effect not in seen and (
                len(seen) >= _TRIED or (chosen and worth[k] < _PROMISING * worth[order[0]])
            ):
                continue
            if seen[candidate.effect] >= _STARTS:
                continue
            seen[candidate.effect] += 1
            chosen.append(candidate)
        held = [({**best.values, **each.start}, (*best.keys, *each.keys)) for each in chosen]
        first = _best_of_each(chosen, here.fitter.fit_each(held, _FIRST_STEPS))[:_LED]
        freed = [(fit.values, (*best.keys, *self._keys(each))) for each, fit in first]
        fits = here.fitter.fit_each(freed, _SECOND_STEPS)
        return _best_of_each([candidate for candidate, _ in first], fits)

    def _singles(self, here: Round, best: Fit, tried: Sequence[tuple[Candidate, Fit]]) -> tuple[Single, ...]:
        """Return all candidates alone, each effect at its best start, strongest first."""
        fits = {candidate.effect: (candidate, fit) for candidate, fit in tried}
        base = _chi2(here.white, best)
        out: dict[str, Single] = {}
        for k in np.argsort(-here.drop):
            candidate = here.library.candidates[int(k)]
            if candidate.effect in out:
                continue
            if candidate.effect in fits:
                began, fit = fits[candidate.effect]
                out[candidate.effect] = Single(began, base - fit.chi2, fit, base)
            else:
                out[candidate.effect] = Single(candidate, float(here.drop[int(k)]), None, base)
        return tuple(sorted(out.values(), key=lambda each: price(each.candidate.keys) - each.drop))

    def _improved(
        self,
        here: Round,
        best: Fit,
        causes: tuple[Candidate, ...],
        tried: Sequence[tuple[Candidate, Fit]],
        least: float,
    ) -> tuple[Fit, tuple[Candidate, ...]] | None:
        """Return the fit with the term that gains most, if that is more than chance gives; else None."""
        before = replace(best, chi2=_chi2(here.white, best))
        reached = before.chi2 - tried[0][1].chi2 if tried else 0.0
        near = [each for each in tried[:_FINISHED] if before.chi2 - each[1].chi2 > _FINISHED_FROM * reached]
        fits = here.fitter.fit_each([(fit.values, fit.keys) for _, fit in near])
        finished = [(candidate, fit) for (candidate, _), fit in zip(near, fits, strict=True)]
        material = _OF_EXCESS * max(before.chi2 - here.white.count, 0.0)
        for candidate, fit in simplest_first(before, finished, lambda each: each[1]):
            gain = before.chi2 - fit.chi2 - (price(fit.keys) - price(best.keys))
            if gain > max(least, material):
                return fit, (*causes, candidate)
        return None

    def _pruned(self, best: Fit, causes: tuple[Candidate, ...], least: float) -> tuple[Fit, tuple[Candidate, ...]]:
        """Return the causes without those that do not pay beside the others any more."""
        for cause in causes[:-1]:
            without = self.without(best, cause)
            if cost(without) - cost(best) < least:
                best, causes = without, tuple(each for each in causes if each.effect != cause.effect)
        return best, causes


def _best_of_each(candidates: Sequence[Candidate], fits: Sequence[Fit]) -> list[tuple[Candidate, Fit]]:
    """Return each effect's best candidate with its fit, best first."""
    best: dict[str, tuple[Candidate, Fit]] = {}
    for each in sorted(zip(candidates, fits, strict=True), key=lambda each: cost(each[1])):
        best.setdefault(each[0].effect, each)
    return list(best.values())


def _chi2(white: White, fit: Fit) -> float:
    return float(np.sum(white(fit.residual) ** 2))
