"""Several recordings fitted jointly: what each of them tells by itself, and on what they disagree."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import isfinite

import numpy as np

from discrepancy.joint import plain
from discrepancy.problem import Problem
from discrepancy.search.carried import refitted
from discrepancy.search.fit import Fit
from discrepancy.search.pruning import intervals_of
from discrepancy.simulation import Parameter
from messages.arrays import FloatArray


@dataclass(frozen=True)
class Alone:
    """The parameters that the recordings share, as one of them tells them by itself, and the root mean square (c,) that
    is left then; no parameters where it cannot be fitted.
    """

    values: dict[str, float]
    bounds: dict[str, tuple[float, float]]
    rms: FloatArray


@dataclass(frozen=True)
class Disagreement:
    """A parameter that two recordings, by their places, tell apart: their 95 % intervals lie apart."""

    key: str
    first: int
    second: int


def each_alone(problem: Problem, joint: Fit) -> list[Alone]:
    """Return what each recording of a problem tells by itself, begun at the `joint` fit, with the same causes."""
    out = []
    for place, part in enumerate(problem.parts):
        values = {key: value for key, value in problem.values_of(place, joint.values).items() if key in part.parameters}
        fit = refitted(part, values, joint.keys)
        rms = np.sqrt((fit.residual**2 * part.valid).sum(axis=1) / np.maximum(part.valid.sum(axis=1), 1))
        intervals = intervals_of(part, fit) if isfinite(fit.chi2) else None
        shared = [key for key in intervals.keys if plain(key) not in part.own] if intervals is not None else []
        bounds = {key: intervals.of(key) for key in shared} if intervals is not None else {}
        out.append(Alone({key: fit.values[key] for key in shared}, bounds, rms))
    return out


def disagreements(problem: Problem, alone: Sequence[Alone]) -> list[Disagreement]:
    """Return the parameters that recordings tell apart by more than matters, each with the two that do so most.

    A recording that cannot tell a parameter has a wide interval, and disagrees with none.
    """
    keys = dict.fromkeys(key for each in alone for key in each.bounds)
    return [most for key in keys if (most := _most(key, problem.parameters[key], alone)) is not None]


def _most(key: str, parameter: Parameter, alone: Sequence[Alone]) -> Disagreement | None:
    gaps = [(gap, a, b) for gap, a, b in _gaps(key, alone) if gap > parameter.least]
    if not gaps:
        return None
    _, a, b = max(gaps)
    return Disagreement(key, a, b)


def _gaps(key: str, alone: Sequence[Alone]) -> Iterator[tuple[float, int, int]]:
    """Yield how far the intervals of a parameter lie apart, for each two recordings that tell it."""
    for a, b in combinations(range(len(alone)), 2):
        if key in alone[a].bounds and key in alone[b].bounds:
            (low, high), (other_low, other_high) = alone[a].bounds[key], alone[b].bounds[key]
            yield max(low - other_high, other_low - high), a, b
