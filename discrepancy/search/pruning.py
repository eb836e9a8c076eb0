"""Which of the causes found stand on something: larger than what matters, in their bounds, and true elsewhere too."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from math import isfinite

import numpy as np

from discrepancy.evidence.adequacy import LEVEL
from discrepancy.problem import Problem
from discrepancy.search.candidates import Candidate, noise_beneath
from discrepancy.search.carried import carried
from discrepancy.search.fit import Fit, Intervals, columns_of, intervals
from discrepancy.search.refits import price
from discrepancy.search.search import Found, Search
from messages.constants import NORMAL_95

_CHANCE = NORMAL_95**2
"""χ² that a parameter without meaning gains in one of twenty recordings."""


def kept(
    problem: Problem, other: Problem, search: Search, found: Found
) -> tuple[Fit, tuple[Candidate, ...], Intervals]:
    """Return what is left of the found causes, their fit and its intervals, when those are gone that stand on nothing.

    `other` is the recording held out: of several causes each must lower χ² there too, all parameters frozen. The
    weakest goes first.
    """
    best, causes = found.best, found.causes
    while causes:
        interval = intervals_of(problem, best)
        gone = immaterial(problem, best, interval, causes) or _elsewhere_false(other, search, best, causes)
        if not gone:
            return best, causes, interval
        cause = next(each for each in causes if each.effect == gone[-1])
        causes = tuple(each for each in causes if each.effect != cause.effect)
        best = search.without(best, cause) if causes else found.base
    return best, causes, intervals_of(problem, best)


def intervals_of(problem: Problem, fit: Fit) -> Intervals:
    """Return the intervals of a fit, under the noise that its own residual tells."""
    white = problem.whitening(fit.residual)
    rated = replace(fit, chi2=float(np.sum(white(fit.residual) ** 2)))
    return intervals(problem, white, rated, columns_of(problem, fit.values, (*problem.base, *fit.keys)))


def immaterial(
    problem: Problem,
    fit: Fit,
    found: Intervals,
    causes: Sequence[Candidate],
    rise: Callable[[Candidate], float] = lambda _: 0.0,
) -> list[str]:
    """Return the causes none of whose deciding parameters is surely further from neutral than matters, and those
    with a deciding parameter on a bound that is not its own, beyond which the truth may lie.

    A parameter decides that changes the prediction while all others of the effect are neutral: a damping or an onset
    says nothing of an effect's being there. One with an infinite neutral value is judged by χ² alone. So is a cause
    without which χ² would rise by more than the price of its parameters, where `rise` tells by how much: an interval is
    made from slopes at the fit, and where a threshold is steep, as of an overflow, the slopes there say little of what
    would be without it.
    """
    out = []
    for name, cause in {each.effect: each for each in causes}.items():
        sure = bounded = False
        for key in deciding(problem, fit, name):
            p, value = problem.parameters[key], fit.values[key]
            low, high = found.of(key)
            sure = sure or not isfinite(p.neutral) or low > p.neutral + p.least or high < p.neutral - p.least
            bounded = bounded or (not p.own_bounds and value in (p.low, p.high) and value != p.neutral)
        own = [key for key in fit.keys if key.split(".")[0] == name]
        if bounded or not (sure or rise(cause) > price(own)):
            out.append(name)
    return out


def short_of_neutral(problem: Problem, fit: Fit, found: Intervals, causes: Sequence[Candidate]) -> Intervals:
    """Return the intervals of causes that all are there: where one parameter alone decides that, its interval ends at
    its neutral value at the latest.
    """
    bounds = found.bounds.copy()
    for name in dict.fromkeys(each.effect for each in causes):
        keys = deciding(problem, fit, name)
        neutral = problem.parameters[keys[0]].neutral
        if len(keys) == 1 and isfinite(neutral):
            row = found.keys.index(keys[0])
            above = fit.values[keys[0]] > neutral
            bounds[row] = np.maximum(bounds[row], neutral) if above else np.minimum(bounds[row], neutral)
    return replace(found, bounds=bounds)


def deciding(problem: Problem, fit: Fit, name: str) -> list[str]:
    """Return the fitted parameters of an effect that tell whether it is there."""
    own = [key for key in fit.keys if key.split(".")[0] == name]
    if len(own) == 1:
        return own
    others = {key: value for key, value in fit.values.items() if key.split(".")[0] != name}
    without = problem.predicted(others)
    return [
        key
        for key in own
        if not isfinite(problem.parameters[key].neutral)
        or not np.array_equal(problem.predicted({**others, key: fit.values[key]}), without, equal_nan=True)
    ]


def _elsewhere_false(other: Problem, search: Search, best: Fit, causes: tuple[Candidate, ...]) -> list[str]:
    """Return those of several causes, the most useless last, that do not pay on the recording held out.

    Each is held against the fit without it, both frozen, both under the noise beneath the whole library: that of a
    fit's own residual would favour it, and its filter take a constant error for slow noise.
    """
    named = {each.effect: each for each in causes}
    if len(named) < 2:
        return []
    values = carried(other, best.values)
    residual = other.residual(values)
    white = noise_beneath(other, residual, columns_of(other, values, _smooth_keys(other, best)))
    told = float(np.sum(white(residual) ** 2))
    useless: list[tuple[float, str]] = []
    for name, cause in named.items():
        without = search.without(best, cause)
        rise = float(np.sum(white(other.residual(carried(other, without.values))) ** 2)) - told
        if rise < _CHANCE * (len(best.keys) - len(without.keys)) and not louder(other, without, best):
            useless.append((rise, name))
    return [name for _, name in sorted(useless, reverse=True)]


def louder(other: Problem, without: Fit, best: Fit) -> bool:
    """Return whether some channel is above the known noise `without` a cause, and above what is left with it."""
    if other.noise is None or not other.noise.whole:
        return False
    there, with_it = (other.residual(carried(other, fit.values)) for fit in (without, best))
    for part, (a, b) in zip(other.parts, pairwise(other.edges), strict=True):
        assert part.noise is not None
        rms, least = (
            np.sqrt((each[:, a:b] ** 2 * part.valid).sum(axis=1) / np.maximum(part.valid.sum(axis=1), 1))
            for each in (there, with_it)
        )
        if np.any(rms > LEVEL * np.maximum(part.noise.std, least)):
            return True
    return False


def _smooth_keys(other: Problem, best: Fit) -> list[str]:
    """Return the parameters that have a derivative where a fit is: those that were fitted, and all of finite neutral
    values.
    """
    return [key for key in other.parameters if key in best.values or isfinite(other.parameters[key].neutral)]
