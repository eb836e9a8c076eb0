"""Which causes the data cannot tell apart, and which stand on nothing."""

from collections.abc import Sequence
from math import isfinite

from discrepancy.fit import Fit, Intervals
from discrepancy.library import Candidate
from discrepancy.problem import Problem
from discrepancy.search import Search
from discrepancy.verdict import MOST_EQUIVALENTS

SAME_CHI2 = 10.0
_TRIED = 6
_MORE_PARAMETERS = 1


def equivalents(
    search: Search, best: Fit, causes: tuple[Candidate, ...]
) -> tuple[dict[str, dict[str, float]], dict[str, float]]:
    """Return for each cause the effects that fit as well in its place, best first, with the rise of χ² that each makes,
    and the rise of the best one that does not.

    A rival is the same if the refitted set is within 10 in χ² and needs at most one parameter more. Where no rival
    came near enough to be refitted its χ² is missing.
    """
    best = search.rated(best)
    same: dict[str, list[tuple[float, str]]] = {each.effect: [] for each in causes}
    other: dict[str, float] = {}
    for place, candidate, fit in search.rivals(best, causes, _TRIED):
        name = causes[place].effect
        worse = fit.chi2 - best.chi2
        if worse < SAME_CHI2 and len(fit.keys) <= len(best.keys) + _MORE_PARAMETERS:
            same[name].append((worse, candidate.effect))
        else:
            other[name] = min(other.get(name, worse), worse)
    as_good = {name: {each: worse for worse, each in sorted(found)[:MOST_EQUIVALENTS]} for name, found in same.items()}
    return as_good, other


def immaterial(problem: Problem, found: Intervals, causes: Sequence[Candidate], keys: Sequence[str]) -> list[str]:
    """Return the causes none of whose parameters is surely further from neutral than its `scale`.

    One with a parameter whose neutral value is infinite is judged by χ² alone.
    """
    out = []
    for name in dict.fromkeys(each.effect for each in causes):
        own = [key for key in keys if key.split(".")[0] == name]
        sure = any(not isfinite(problem.parameters[key].neutral) for key in own)
        for key in own:
            p = problem.parameters[key]
            low, high = found.of(key)
            sure = sure or low > p.neutral + p.scale or high < p.neutral - p.scale
        if not sure:
            out.append(name)
    return out
