"""What was found carried over to other recordings, or told by one of them alone: fits that begin at a known place."""

import copy

from discrepancy.evidence.whitening import White, unfiltered
from discrepancy.joint import plain
from discrepancy.problem import Problem
from discrepancy.search.fit import Fit, Fitter, columns_of
from discrepancy.simulation import Values

_ROUNDS = 3
"""Fits, each under the noise that the one before leaves, the first under white noise: what is left of a fit elsewhere
holds the very difference that is looked for, and a filter made of it would take that away."""


def carried(problem: Problem, values: Values) -> dict[str, float]:
    """Return `values` found elsewhere for the recordings of `problem`: what belongs to each of them, as an initial
    state, is fitted there, and nothing else is. The rest of a recording that was fitted has all of it already.
    """
    if problem.continued or not problem.own:
        return dict(values)
    begun = {key: problem.parameters[key].neutral for key in problem.own}
    own = {plain(key) for key in problem.own}
    shared = {key: value for key, value in values.items() if plain(key) not in own}
    only = copy.copy(problem)
    only.base = problem.own
    return refitted(only, {**shared, **begun}, ()).values


def refitted(problem: Problem, values: dict[str, float], keys: tuple[str, ...]) -> Fit:
    """Return the fit of the base model and `keys`, begun at `values` that were found elsewhere."""
    residual = problem.residual(values)
    white: White = unfiltered(residual, problem.valid)
    found = Fit(values, residual, float("inf"), keys)
    for _ in range(_ROUNDS):
        fitter = Fitter(problem, white, columns_of(problem, found.values, problem.base))
        found = fitter.fit(found.values, keys)
        white = problem.whitening(found.residual)
    return found
