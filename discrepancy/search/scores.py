"""Linear scores of candidates from the products of whitened columns, and what chance gives their best.

With e the whitened residual, X the columns and the base model's own columns projected out (variable projection, Golub
and Pereyra 1973), a candidate with columns J lowers χ² by

    Δ = zᵀ δ, δ = G⁻¹ z, z = Jᵀ e, G = Jᵀ J                                                                        (1)

and one judged at a start, which changes the prediction by d, by

    Δ = 2 dᵀ e − dᵀ d + 2 δᵀ (z − Jᵀ d) − δᵀ G δ                                                                   (2)

where δ is kept within the parameters' bounds. Under noise alone (z, d'e) is normal with covariance G: the best of all
candidates is drawn from that without a single simulation.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from discrepancy.problem import Problem
from discrepancy.search.candidates import Candidate
from discrepancy.search.fit import BLOCKS
from messages.arrays import FloatArray

PENALTY = 8.0
"""By what each parameter must lower χ² to be worth naming, beside what chance reaches."""
_DRAWS = 1000
"""Of noise: ten of them lie beyond the threshold of `_CHANCE`."""
_CHANCE = 0.01
"""Of noise giving the best of all candidates as much: a cause that is less surprising is not taken in."""
_RIDGE = 1e-9
"""Of each column's power: columns that say the same leave their products solvable."""
_OWN = 1e-6
"""Of a column's power: with less beside the columns that are in already, it says nothing that these do not."""
_NOISE_RIDGE = 1e-6
"""Likewise, of all the library's columns together, which say the same far more often."""


@dataclass(frozen=True)
class Products:
    """What scores need: `gram` (m, m) and `score` (m,) of the library with the base columns projected out.

    `inflation` (m,) is by how much the score of a column varies more, from stretch to stretch of the recording, than
    unit noise would let it; 1 where it does not.
    """

    gram: FloatArray
    score: FloatArray
    inflation: FloatArray


def products(stack: FloatArray, base: int, e: FloatArray, samples: int, extra: FloatArray | None = None) -> Products:
    """Return the products of whitened columns (m, c · n), the first `base` of the base model, with a residual (c · n,).

    `extra` (j, c · n) are columns of effects that are in already, projected out like the base model's.
    """
    own = stack[:base] if extra is None else np.concatenate((stack[:base], extra))
    rest = stack[base:]
    if len(own):
        own = own / np.sqrt(np.maximum(np.sum(own**2, axis=1), np.finfo(float).tiny))[:, None]
        cross = rest @ own.T
        inner = own @ own.T
        inner[np.diag_indices(len(own))] += _RIDGE
        weight = np.linalg.solve(inner, np.column_stack((cross.T, own @ e)))
        gram = rest @ rest.T - cross @ weight[:, :-1]
        score = rest @ e - cross @ weight[:, -1]
    else:
        gram, score, weight = rest @ rest.T, rest @ e, np.zeros((0, len(rest) + 1))
    power = np.sum(rest**2, axis=1)
    said = np.diag(gram) <= _OWN * power
    if said.any():
        score[said], gram[said], gram[:, said] = 0.0, 0.0, 0.0
        gram[said, said] = np.maximum(power[said], np.finfo(float).tiny)
    beneath = _noise(stack, own, e, gram, score, base, weight)
    return Products(gram, score, _inflation(rest, own, weight[:, :-1], beneath, gram, samples))


def _noise(
    stack: FloatArray,
    own: FloatArray,
    e: FloatArray,
    gram: FloatArray,
    score: FloatArray,
    base: int,
    weight: FloatArray,
) -> FloatArray:
    """Return what of the residual (c · n,) no column explains."""
    size = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    scaled = gram / np.outer(size, size)
    scaled[np.diag_indices(len(size))] += _NOISE_RIDGE
    share = np.linalg.solve(scaled, score / size) / size
    left: FloatArray = e - share @ stack[base:]
    if len(own):
        left -= (weight[:, -1] - weight[:, :-1] @ share) @ own
    return left


def _inflation(
    rest: FloatArray, own: FloatArray, weight: FloatArray, e: FloatArray, gram: FloatArray, samples: int
) -> FloatArray:
    """Return how much more than the Gram matrix says each score varies between stretches, at least 1."""
    edges = np.linspace(0, samples, BLOCKS + 1).astype(int)
    e = e.reshape(-1, samples)
    sums = np.stack(
        [np.concatenate((_part(rest, e, a, b), _part(own, e, a, b))) for a, b in pairwise(edges)],
        axis=1,
    )
    projected = sums[: len(rest)] - weight.T @ sums[len(rest) :]
    spread = np.sum(projected**2, axis=1)
    inflation: FloatArray = np.maximum(spread / np.maximum(np.diag(gram), np.finfo(float).tiny), 1.0)
    return inflation


def _part(columns: FloatArray, e: FloatArray, first: int, last: int) -> FloatArray:
    part: FloatArray = np.einsum(
        "mcn,cn->m", columns.reshape(len(columns), *e.shape)[:, :, first:last], e[:, first:last], optimize=True
    )
    return part


def drops(
    problem: Problem, found: Products, sets: Sequence[Sequence[Candidate]], base: int, values: dict[str, float]
) -> FloatArray:
    """Return Δ of (1) or (2) for each set of candidates."""
    score = found.score[:, None]
    places: dict[int, _Place] = {}
    for each in sets:
        for candidate in each:
            if id(candidate) not in places:
                places[id(candidate)] = _Place.of(problem, candidate, base, values)
    return np.array([_drop(found, [places[id(candidate)] for candidate in each], score)[0] for each in sets])


def pairs(first: Sequence[Candidate], second: Sequence[Candidate]) -> list[tuple[Candidate, Candidate]]:
    """Return the pairs of candidates of different effects with one out of each list."""
    place = {id(each): k for k, each in enumerate(first)}
    return [
        (a, b) for a in first for b in second if a.effect != b.effect and place.get(id(b), len(first)) > place[id(a)]
    ]


def chance_maximum(
    problem: Problem,
    found: Products,
    candidates: Sequence[Candidate],
    base: int,
    values: dict[str, float],
    rng: np.random.Generator,
) -> FloatArray:
    """Return draws (k,) of the largest penalised Δ that noise alone gives over all `candidates`, sorted."""
    if not candidates:
        return np.zeros(1)
    size = np.sqrt(np.maximum(np.diag(found.gram), np.finfo(float).tiny))
    value, vector = np.linalg.eigh(found.gram / np.outer(size, size))
    root = size[:, None] * vector * np.sqrt(np.maximum(value, 0.0))
    draws = root @ rng.standard_normal((len(size), _DRAWS))
    best = np.zeros(_DRAWS)
    for each in candidates:
        place = _Place.of(problem, each, base, values)
        best = np.maximum(best, _drop(found, (place,), draws) - PENALTY * len(each.keys))
    return np.sort(best)


def threshold(chance: FloatArray) -> float:
    """Return what chance exceeds once in a hundred."""
    return float(np.quantile(chance, 1.0 - _CHANCE))


def probability(chance: FloatArray, value: float) -> float:
    """Return the share of draws that reach `value`, at least one of them counted."""
    return float((1 + np.sum(chance >= value)) / (1 + len(chance)))


def inflation_of(found: Products, each: Sequence[Candidate], base: int) -> float:
    """Return the mean inflation of a set's columns."""
    rows = [row - base for candidate in each for row in candidate.columns]
    return float(np.mean(found.inflation[rows]))


@dataclass(frozen=True)
class _Place:
    """Where a candidate's columns stand in the products, and how far its parameters may go, in scales."""

    rows: tuple[int, ...]
    offset: tuple[int, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]

    @classmethod
    def of(cls, problem: Problem, candidate: Candidate, base: int, values: dict[str, float]) -> "_Place":
        p = [problem.parameters[key] for key in candidate.keys]
        at = [candidate.start.get(key, problem.value(values, key)) for key in candidate.keys]
        return cls(
            tuple(row - base for row in candidate.columns),
            () if candidate.offset is None else (candidate.offset - base,),
            tuple((each.low - here) / each.scale for each, here in zip(p, at, strict=True)),
            tuple((each.high - here) / each.scale for each, here in zip(p, at, strict=True)),
        )


def _drop(found: Products, places: Sequence[_Place], score: FloatArray) -> FloatArray:
    """Return Δ (k,) for scores (m, k)."""
    rows = [row for place in places for row in place.rows]
    offsets = [row for place in places for row in place.offset]
    gram = found.gram[np.ix_(rows, rows)]
    z = score[rows]
    if offsets:
        z = z - found.gram[np.ix_(rows, offsets)].sum(axis=1)[:, None]
    size = np.sqrt(np.maximum(gram.diagonal(), np.finfo(float).tiny))
    scaled = gram / np.outer(size, size)
    scaled[np.diag_indices(len(rows))] += _RIDGE
    delta = np.linalg.solve(scaled, z / size[:, None]) / size[:, None]
    low = np.array([each for place in places for each in place.low])[:, None]
    high = np.array([each for place in places for each in place.high])[:, None]
    delta = np.minimum(np.maximum(delta, low), high)
    drop = np.sum(delta * (2.0 * z - gram @ delta), axis=0)
    if offsets:
        drop += 2.0 * score[offsets].sum(axis=0) - found.gram[np.ix_(offsets, offsets)].sum()
    return np.asarray(np.maximum(drop, 0.0), dtype=np.float64)
