"""Which causes the data cannot tell apart, and which would have been better."""

from discrepancy.search.candidates import Candidate
from discrepancy.search.fit import Fit
from discrepancy.search.refits import cost
from discrepancy.search.search import Search
from discrepancy.verdict import MOST_EQUIVALENTS

SAME_CHI2 = 10.0
"""By how much χ² may be higher with a rival that counts as the same: little more than one parameter's price."""
_TRIED = 6
"""Rivals that are refitted for each cause: more than a verdict names."""
_MORE_PARAMETERS = 1
"""That a rival may need beyond the cause's own: with more, it fits as well only by being freer."""


def equivalents(
    search: Search, best: Fit, causes: tuple[Candidate, ...]
) -> tuple[dict[str, dict[str, float]], dict[str, float]]:
    """Return for each cause the effects that fit as well in its place, best first, with the rise of χ² that each makes,
    and the rise of the best one that does not.

    A rival is the same if the refitted set is within `SAME_CHI2`, neither better nor worse by more, and needs at most
    one parameter more. Where no rival came near enough to be refitted its χ² is missing.
    """
    best = search.rated(best)
    same: dict[str, list[tuple[float, str]]] = {each.effect: [] for each in causes}
    other: dict[str, float] = {}
    for place, candidate, fit in search.rivals(best, causes, _TRIED):
        name = causes[place].effect
        worse = fit.chi2 - best.chi2
        if abs(worse) < SAME_CHI2 and len(fit.keys) <= len(best.keys) + _MORE_PARAMETERS:
            same[name].append((worse, candidate.effect))
        else:
            other[name] = min(other.get(name, worse), worse)
    as_good = {name: {each: worse for worse, each in sorted(found)[:MOST_EQUIVALENTS]} for name, found in same.items()}
    return as_good, other


def better(search: Search, best: Fit, causes: tuple[Candidate, ...]) -> tuple[Fit, tuple[Candidate, ...]] | None:
    """Return the causes with one of them replaced by the rival that fits better by more than `SAME_CHI2` and the price
    of its parameters, and under the noise that each leaves too, the best one; None if there is none.
    """
    best = search.rated(best)
    found = [
        (fit, tuple(candidate if k == place else each for k, each in enumerate(causes)))
        for place, candidate, fit in search.rivals(best, causes, _TRIED)
        if min(best.chi2 - fit.chi2, cost(best) - cost(fit)) > SAME_CHI2 and search.refits.outdoes(fit, best)
    ]
    return min(found, key=lambda each: cost(each[0])) if found else None
