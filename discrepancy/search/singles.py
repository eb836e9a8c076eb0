"""All candidates, each by itself: scored linearly, and the best few refitted."""

from dataclasses import dataclass

import numpy as np

from discrepancy.evidence.whitening import White
from discrepancy.search.candidates import Candidate
from discrepancy.search.fit import Fit
from discrepancy.search.refits import Refits, cost, price
from discrepancy.search.scores import Products
from messages.arrays import FloatArray

FIRST_STEPS = 3
"""Steps of a fit that only has to show whether it is worth finishing."""
FINISHED = 3
"""Fits, the best after their first steps, that are finished: one that was third by then may still win."""
NEAR = 0.4
"""Of the gain in χ² to be reached: a candidate with a lower linear score is not refitted; few refits make up for it."""
_MOST_EFFECTS = 6
"""Effects that are refitted alone, at neutral and at starts each: a refit costs dozens of predictions, a score none."""
_MOST_OF_AN_EFFECT = 2
"""Candidates of one effect that are refitted: one more chance where the first began badly."""
_MOST_STARTED = 12
"""Started candidates that are refitted, whether or not they gain what they promised."""
_FULFILLED = 0.1
"""Of a started candidate's linear score, which is only a promise: a refit that gains less tells nothing of the effect's
other starts."""


@dataclass(frozen=True)
class Single:
    """A candidate alone: by how much it lowers χ², which is `base` without it, and its refit if it was worth one."""

    candidate: Candidate
    drop: float
    fit: Fit | None
    base: float

    def left(self, white: White, base: float) -> float:
        """Return the χ² that the candidate leaves under another noise, where the base model's is `base`; without a
        refit the same share of that as under the noise that it was scored with.
        """
        if self.fit is not None:
            return float(np.sum(white(self.fit.residual) ** 2))
        return base * max(1.0 - self.drop / self.base, 0.0) if self.base > 0.0 else base


def singles(refits: Refits, at_base: Products) -> tuple[Single, ...]:
    """Return all candidates alone, best first, the best few neutral ones and the best few started ones refitted."""
    candidates = refits.candidates
    drop = refits.drops(at_base, [(each,) for each in candidates], refits.base)
    fits = _refitted(refits, drop - np.array([price(each.keys) for each in candidates]))
    base = refits.rated(refits.base)
    found = []
    for index, each in enumerate(candidates):
        fit = fits.get(index)
        gained = float(drop[index]) if fit is None else base.chi2 - fit.chi2
        found.append(Single(each, gained, fit, base.chi2))
    return tuple(sorted(found, key=lambda each: price(each.candidate.keys) - each.drop))


def _refitted(refits: Refits, worth: FloatArray) -> dict[int, Fit]:
    """Return refits by index of the candidates whose linear `worth` comes near the best, two of an effect at most.

    A started candidate's linear worth is no measure for others: the measure is what refits gain.
    """
    candidates = refits.candidates
    base = refits.rated(refits.base).chi2
    order = [int(index) for index in np.argsort(-worth)]
    fits: dict[int, Fit] = {}
    reached = 0.0
    for started in (False, True):
        counts: dict[str, int] = {}
        tried = 0
        for index in order:
            each = candidates[index]
            if (each.offset is not None) != started or counts.get(each.effect, 0) >= _MOST_OF_AN_EFFECT:
                continue
            enough = sum(counts.values()) >= _MOST_EFFECTS or tried >= _MOST_STARTED
            if enough or (tried and worth[index] < NEAR * reached):
                break
            tried += 1
            fits[index] = refits.joined(refits.base, each, FIRST_STEPS)
            gained = base - fits[index].chi2 - price(each.keys)
            reached = max(reached, gained)
            if not started or gained > _FULFILLED * worth[index]:
                counts[each.effect] = counts.get(each.effect, 0) + 1
    fits = {index: fit for index, fit in fits.items() if refits.matters(fit, candidates[index])}
    first = sorted(fits, key=lambda k: cost(fits[k]))[:FINISHED]
    return fits | dict(zip(first, refits.finished_each([fits[index] for index in first]), strict=True))
