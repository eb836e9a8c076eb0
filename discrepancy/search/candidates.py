"""All candidates at the base fit as columns: how the prediction changes by one scale of every parameter.

A candidate is an effect with one choice of its parameters, judged at its neutral values or at one of its starts. From
there on the search is linear algebra on the whitened columns' products.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from discrepancy.evidence.whitening import White, unfiltered
from discrepancy.problem import MOST_LOST, Problem
from discrepancy.simulation import Effect
from messages.arrays import FloatArray

_RIDGE = 1e-9
"""Of each column's power: columns that say the same share one weight."""
_RIDGES = (_RIDGE, 1e-6, 1e-4, 1e-2)
"""Likewise: the stronger ones are for libraries with more columns than the recording has independent samples."""
_LAST_DIGITS = 1e-9
"""Of the largest column: one that changes no more than that is what rounding leaves of parameters without influence."""
_FAR_LESS = 0.3
"""Of the power left out of sample with the weakest: where a stronger leaves that little, that one explains anything."""
_PARTS = 5
"""Of a recording, each predicted from the others."""
_ROUNDS = 2
"""Estimates of the noise: the first weighs all frequencies alike, the second by the first."""


_Mark = tuple[str, tuple[tuple[str, float], ...]]
"""An effect, and what it begins at."""


@dataclass(frozen=True)
class Candidate:
    """An effect with a choice of its parameters; `keys` as in `Values`.

    `start` holds the values it is judged at, if not neutral. `columns` are the rows of its parameters in the library,
    `offset` the row of the difference that `start` makes, None at neutral.
    """

    effect: str
    choice: tuple[str, ...]
    keys: tuple[str, ...]
    start: dict[str, float]
    columns: tuple[int, ...]
    offset: int | None


@dataclass(frozen=True)
class Library:
    """Raw columns (m, c, n): the base model's parameters first, `base` of them, then those of the candidates."""

    columns: FloatArray
    base: int
    candidates: tuple[Candidate, ...]

    def whitened(self, white: White) -> FloatArray:
        """Return all columns whitened, (m, c · n)."""
        return np.stack([white(column).reshape(-1) for column in self.columns])


def choices_of(effect: Effect) -> tuple[tuple[str, ...], ...]:
    """Return the sets of an effect's parameters that are tried."""
    return effect.choices or (tuple(p.name for p in effect.parameters),)


def library(problem: Problem, values: dict[str, float], base_columns: FloatArray, names: tuple[str, ...]) -> Library:
    """Return the columns of the base model, given at `values`, and of the effects of these `names`.

    Samples that a column cannot give are taken out of the problem; a start at which the model diverges is no candidate.
    """
    before = problem.predicted(values)
    tried = [(name, choice, begun) for name in names for choice, begun in _beginnings(problem.effects[name])]
    starts = {_mark(name, begun): begun for name, _, begun in tried if begun}
    there = dict(zip(starts, problem.predicted_many([{**values, **begun} for begun in starts.values()]), strict=True))
    diverged = {mark for mark, each in there.items() if problem.lost(each) > MOST_LOST}
    rows: dict[tuple[_Mark, str], int] = {}
    offsets: dict[_Mark, int] = {}
    differences: dict[int, FloatArray] = {}
    asked: dict[int, tuple[dict[str, float], FloatArray, str]] = {}
    candidates: list[Candidate] = []
    count = len(base_columns)
    for name, choice, begun in tried:
        mark = _mark(name, begun)
        if mark in diverged:
            continue
        here = there.get(mark, before)
        if begun and mark not in offsets:
            problem.narrow(np.isfinite(here))
            offsets[mark] = count
            differences[count] = _finite(here - before)
            count += 1
        keys = tuple(problem.effects[name].qualified(p) for p in choice)
        for key in keys:
            if (mark, key) not in rows:
                rows[mark, key] = count
                asked[count] = ({**values, **begun}, here, key)
                count += 1
        columns = tuple(rows[mark, key] for key in keys)
        candidates.append(Candidate(name, choice, keys, begun, columns, offsets.get(mark)))
    stack = np.empty((count, problem.c, problem.n))
    stack[: len(base_columns)] = base_columns
    for row, difference in differences.items():
        stack[row] = problem.filled(difference)
    for row, column in zip(asked, problem.columns(list(asked.values())), strict=True):
        stack[row] = column
    return Library(stack, len(base_columns), tuple(candidates))


def _mark(name: str, begun: dict[str, float]) -> _Mark:
    """Return what tells the beginnings of effects apart; neutral ones are all alike within one."""
    return name, tuple(sorted(begun.items()))


def _beginnings(effect: Effect) -> list[tuple[tuple[str, ...], dict[str, float]]]:
    """Return every choice of an effect with the values it begins at, by key; of a start only what is in the choice
    counts.
    """
    found: list[tuple[tuple[str, ...], dict[str, float]]] = []
    for start in effect.starts or ({},):
        for choice in choices_of(effect):
            begun = {effect.qualified(p): float(start[p]) for p in choice if p in start}
            open_ = [p.name for p in effect.parameters if p.name in choice and not np.isfinite(p.neutral)]
            begins = bool(begun) or not start
            if begins and all(effect.qualified(p) in begun for p in open_) and (choice, begun) not in found:
                found.append((choice, begun))
    return found


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, 0.0)


def noise_beneath(problem: Problem, residual: FloatArray, columns: FloatArray, rounds: int = _ROUNDS) -> White:
    """Return the whitening by what no column (m, c, n) explains of `residual` (c, n).

    A filter estimated from the residual itself would take a missing effect for colour and swallow it; what is left
    beside the whole library is noise, if the effect is in the library and small enough to be linear, and if the library
    is not so large that it explains anything: then its weights are held down until they hold out of sample.
    """
    if not len(columns):
        return problem.whitening(residual)
    white: White = unfiltered(residual, problem.valid)
    for _ in range(rounds):
        stack = np.stack([white(column).reshape(-1) for column in columns])
        e = white(residual).reshape(-1)
        weights = ridge(stack @ stack.T, stack @ e, _held_down(stack, e, problem.n))
        left = residual - np.tensordot(weights, columns, axes=1)
        white = problem.whitening(left)
    return white


def _held_down(stack: FloatArray, e: FloatArray, n: int) -> float:
    """Return the ridge under which columns (m, c · n) explain a residual (c · n,) out of sample: the weakest one, but
    for a stronger that leaves far less.

    Each is a share of a column's power in the whole recording, so that one which moves nothing outside a part, but for
    last digits, is held down there and does not explode in it.
    """
    m = len(stack)
    edges = np.linspace(0, n, _PARTS + 1).astype(int)
    shaped, left = stack.reshape(m, -1, n), e.reshape(-1, n)
    parts = [(shaped[:, :, a:b].reshape(m, -1), left[:, a:b].reshape(-1)) for a, b in pairwise(edges)]
    grams, scores = np.stack([x @ x.T for x, _ in parts]), np.stack([x @ y for x, y in parts])
    whole = np.diag(grams.sum(axis=0))
    power = [0.0] * len(_RIDGES)
    for row, (x, y) in enumerate(parts):
        gram, score = (np.delete(each, row, axis=0).sum(axis=0) for each in (grams, scores))
        for place, share in enumerate(_RIDGES):
            power[place] += float(np.sum((y - ridge(gram, score, share, whole) @ x) ** 2))
    best = int(np.argmin(power))
    return _RIDGES[best] if power[best] < _FAR_LESS * power[0] else _RIDGES[0]


def ridge(gram: FloatArray, score: FloatArray, share: float = _RIDGE, power: FloatArray | None = None) -> FloatArray:
    """Return the least-squares weights for products (m, m) and score (m,), columns that say the same sharing; with a
    larger `share` of each column's `power` (m,), that of the products unless told, held down. A column of last digits
    has none.
    """
    size = np.sqrt(np.diag(gram) if power is None else power)
    felt = size > _LAST_DIGITS * size.max(initial=0.0)
    scaled = gram[np.ix_(felt, felt)] / np.outer(size[felt], size[felt])
    scaled[np.diag_indices(len(scaled))] += share
    weights = np.zeros(len(size))
    weights[felt] = np.linalg.solve(scaled, score[felt] / size[felt]) / size[felt]
    return weights
