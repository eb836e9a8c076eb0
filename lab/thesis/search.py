"""All causes, and all pairs of them, against the printed columns: by curves through what was simulated.

The estimator's answer to a pair is taken as the sum of its answers to either: x = x₀ + Δ_a(s_a) + Δ_b(s_b). Where the
foot's Jx would be below zero, the bounded estimator moves along the ridge, x + c (−Jx), c from the runs in which it
did. So the misfit of every pair over a grid of both sizes is |y − a|² + |b|² − 2 (y − a)·b. What comes out best is
simulated afterwards: sums are where to look, never what is told.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.interpolate import BarycentricInterpolator, PchipInterpolator
from scipy.optimize import minimize

from lab.thesis.causes import CAUSES
from lab.thesis.hypotheses import (
    FIT,
    PINNED,
    Columns,
    Misfit,
    Sizes,
    Study,
    printed_cells,
    tolerances,
)
from messages.arrays import FloatArray, IntArray

GRID: Final = 21  # sizes of each cause
_SETTLED: Final = 0.01  # of a size, by which it no longer moves
_SCALE_OF_RIDGE: Final = 5.0  # g m² below zero, from which on the bound tells the ridge's direction
_FINE: Final = 1e-3  # of a range of sizes, and of a tolerance: what is printed tells no more
_MOST_EVALUATIONS: Final = 150  # of the curves
_OUTSIDE: Final = 1e3  # tolerances for the square of a whole range beyond its end: no fit leaves the range


@dataclass(frozen=True)
class Curves:
    """What each cause does to the cells, (3 rates, 19), as a function of its size, and the ridge c (3, 19)."""

    base: FloatArray
    answers: Mapping[str, Callable[[FloatArray], FloatArray]]
    ridge: FloatArray

    @classmethod
    def of(cls, study: Study, names: Sequence[str]) -> "Curves":
        """Return the curves through all knots of the causes `names`; what the folder lacks is simulated."""
        base = study.columns({})
        found = {
            name: {
                size: base if size == CAUSES[name].neutral else study.columns({name: size})
                for size in CAUSES[name].knots
            }
            for name in names
        }
        every = [base, *(columns for curve in found.values() for columns in curve.values())]
        answers = {
            name: _through(name, [columns.cells(False) - base.cells(False) for columns in curve.values()])
            for name, curve in found.items()
        }
        return cls(base.cells(False), answers, _ridge(every))

    def answer(self, name: str, sizes: FloatArray) -> FloatArray:
        """Return Δ of a cause at `sizes` (g,) within its range, (g, 3, 19); of a switch, at its nearer end."""
        return self.answers[name](sizes)

    def cells(self, sizes: Sizes, bounded: bool) -> FloatArray:
        """Return the cells (3, 19) of a hypothesis as the sum of its causes."""
        total = self.base + sum(self.answer(name, np.array([size]))[0] for name, size in sizes.items())
        return self.on_ridge(total, np.minimum(total[:, PINNED], 0.0)) if bounded else total

    def on_ridge(self, cells: FloatArray, below: FloatArray) -> FloatArray:
        """Return cells (…, 3, 19) moved along the ridge until Jx is higher by −`below` (…, 3)."""
        moved: FloatArray = cells - below[..., None] * self.ridge
        return moved


def _tried(name: str) -> FloatArray:
    """Return a cause's sizes on the grid (GRID,): evenly over its range; of a switch, its ends alone."""
    knots = CAUSES[name].knots
    even: FloatArray = np.linspace(knots[0], knots[-1], GRID)
    return np.where(even < even.mean(), knots[0], knots[-1]) if CAUSES[name].switch else even


def _through(name: str, answers: Sequence[FloatArray]) -> Callable[[FloatArray], FloatArray]:
    """Return the curve through a cause's answers at its knots."""
    knots, values = np.array(CAUSES[name].knots), np.array(answers)
    if CAUSES[name].switch:
        return lambda sizes: values[np.abs(knots[:, None] - sizes).argmin(axis=0)]
    curve: Callable[[FloatArray], FloatArray] = (PchipInterpolator if len(knots) > 3 else BarycentricInterpolator)(
        knots, values
    )
    return curve


def _ridge(every: Sequence[Columns]) -> FloatArray:
    """Return c (3, 19): what the bound does to the cells for each g m² of Jx below zero, the median over all runs."""
    free, bounded = (np.array([columns.cells(which) for columns in every]) for which in (False, True))
    below = -free[..., PINNED]
    met = below > _SCALE_OF_RIDGE
    if not met.any(axis=0).all():  # at some rate no run met the bound: it moves Jx alone
        alone = np.zeros(free.shape[1:])
        alone[:, PINNED] = 1.0
        return alone
    moved = bounded - free
    return np.stack([np.median(moved[at, hz] / below[at, hz, None], axis=0) for hz, at in enumerate(met.T)])


@dataclass(frozen=True)
class Candidate:
    """A hypothesis with the sizes that meet 29 and 40 Hz best, whether J is bounded, and its misfit."""

    sizes: Sizes
    bounded: bool
    misfit: Misfit
    simulated: bool

    @property
    def names(self) -> tuple[str, ...]:
        """Return its causes."""
        return tuple(self.sizes)


@dataclass(frozen=True)
class Scan:
    """Least squares of z over both tables at 29 and 40 Hz: of each cause `single` (E,), and of each pair (E, E).

    `single_at` (E,) and `pair_at` (E, E, 2) are the sizes' places in `sizes` (E, GRID). `pair` holds pairs i < j and
    infinity elsewhere.
    """

    names: tuple[str, ...]
    sizes: FloatArray
    single: FloatArray
    single_at: IntArray
    pair: FloatArray
    pair_at: IntArray

    def best_pairs(self, count: int) -> list[dict[str, float]]:
        """Return so many pairs of least misfit with their sizes, the best first."""
        order = np.argsort(self.pair, axis=None)[:count]
        return [self.pair_sizes(*divmod(int(k), len(self.names))) for k in order]

    def pair_sizes(self, i: int, j: int) -> dict[str, float]:
        """Return the best sizes of the pair of causes number i and j."""
        a, b = self.pair_at[i, j]
        return {self.names[i]: float(self.sizes[i, a]), self.names[j]: float(self.sizes[j, b])}

    def single_sizes(self, i: int) -> dict[str, float]:
        """Return the best size of cause number i."""
        return {self.names[i]: float(self.sizes[i, self.single_at[i]])}


class Grid:
    """The answers of all causes on a grid of sizes, in tolerances, of the free or the bounded estimator."""

    def __init__(self, curves: Curves, bounded: bool) -> None:
        self.names = tuple(curves.answers)
        self.sizes = np.array([_tried(name) for name in self.names])
        answers = np.array([curves.answer(name, sizes) for name, sizes in zip(self.names, self.sizes, strict=True)])
        self.jx = answers[..., list(FIT), PINNED]
        self.jx_base = curves.base[list(FIT), PINNED]
        self.bounded = bounded
        self.free, self.free_target = self._in_tolerances(curves, answers, False)
        self.held, self.held_target = self._in_tolerances(curves, answers, True)

    def _in_tolerances(self, curves: Curves, answers: FloatArray, bounded: bool) -> tuple[FloatArray, FloatArray]:
        """Return the answers (E, GRID, 38) and what they must add up to (38,), over both tables at 29 and 40 Hz."""
        base = curves.base
        if bounded:
            answers, base = (curves.on_ridge(cells, cells[..., PINNED]) for cells in (answers, base))
        fit = list(FIT)
        target = ((printed_cells() - base) / tolerances())[fit].reshape(-1)
        return (answers / tolerances())[..., fit, :].reshape(*answers.shape[:2], -1), target

    def scan(self) -> Scan:
        """Return the least misfit of each cause and each pair, by trying all sizes."""
        E = len(self.names)
        single, single_at = np.empty(E), np.empty(E, dtype=np.int64)
        pair, pair_at = np.full((E, E), np.inf), np.zeros((E, E, 2), dtype=np.int64)
        for i in range(E):
            alone = self._cost(self.free[i], self.held[i], self.jx[i], None)
            single_at[i], single[i] = int(alone.argmin()), float(alone.min())
            both = self._cost(self.free[i], self.held[i], self.jx[i], slice(i + 1, E))
            flat = both.transpose(1, 0, 2).reshape(E - i - 1, GRID * GRID)
            best = flat.argmin(axis=1)
            pair[i, i + 1 :] = flat.min(axis=1)
            pair_at[i, i + 1 :] = np.column_stack(np.divmod(best, GRID))
        return Scan(self.names, self.sizes, single, single_at, pair, pair_at)

    def _cost(self, free: FloatArray, held: FloatArray, jx: FloatArray, others: slice | None) -> FloatArray:
        """Return the squares' sum of one cause (GRID,), or with each other cause (GRID, others, GRID)."""

        def squares(answers: FloatArray, every: FloatArray, target: FloatArray) -> FloatArray:
            rest = target - answers
            if others is None:
                alone: FloatArray = (rest**2).sum(axis=-1)
                return alone
            more = every[others]
            cross: FloatArray = (
                (rest**2).sum(axis=-1)[:, None, None]
                + (more**2).sum(axis=-1)
                - 2.0 * np.tensordot(rest, more, axes=(-1, -1))
            )
            return cross

        cost = squares(free, self.free, self.free_target)
        if not self.bounded:
            return cost
        total = self.jx_base + jx
        if others is not None:
            total = total[:, None, None] + self.jx[others]
        return np.where((total < 0.0).all(axis=-1), squares(held, self.held, self.held_target), cost)

    def best_of_flipped(self, draws: int, seed: int) -> FloatArray:
        """Return what the best pair leaves of made-up tables, as a share of their misfit (draws,); the first is real.

        A made-up table has the printed deviations with the sign of each of its rows drawn anew, the same at both rates,
        so that any pattern of the same size may appear. The estimator is taken as held on the ridge.
        """
        rng = np.random.default_rng(seed)
        rows = len(self.held_target) // len(FIT)
        signs = np.where(rng.random((draws, rows)) < 0.5, -1.0, 1.0)
        signs[0] = 1.0
        targets = self.held_target * np.tile(signs, (1, len(FIT)))
        flat = self.held.reshape(-1, self.held.shape[-1])
        onto, least = flat @ targets.T, np.full(draws, np.inf)
        own = (flat**2).sum(axis=1)
        for first in range(0, len(flat) - GRID, GRID):
            block = slice(first, first + GRID)
            joint = own[block, None] + own[None, first + GRID :] + 2.0 * flat[block] @ flat[first + GRID :].T
            for k in range(draws):
                change = joint - 2.0 * (onto[block, k][:, None] + onto[first + GRID :, k])
                least[k] = min(least[k], float(change.min()))
        whole = (targets**2).sum(axis=1)
        share: FloatArray = (whole + least) / whole
        return share


class Refinement:
    """A hypothesis that is simulated, and its sizes moved to where simulation and curves together are best.

    After each simulation, what the curves missed there is added to them.
    """

    def __init__(self, curves: Curves, start: Sizes, bounded: bool) -> None:
        self.curves, self.bounded = curves, bounded
        self.sizes = dict(start)
        self.best: Candidate | None = None
        self.settled = False

    def take(self, study: Study) -> None:
        """Judge the sizes as simulated, and move them for the next time; settled where they stay."""
        columns = study.columns(self.sizes)
        found = Candidate(dict(self.sizes), self.bounded, Misfit.of(columns.cells(self.bounded)), True)
        if self.best is None or found.misfit.fit < self.best.misfit.fit:
            self.best = found
        free_off = columns.cells(False) - self.curves.cells(self.sizes, False)
        held_off = columns.cells(True) - _moved(self.curves, self.sizes, free_off, True)
        before, self.sizes = self.sizes, _continued(self.curves, self.sizes, self.bounded, free_off, held_off)
        self.settled = all(np.isclose(self.sizes[name], before[name], rtol=_SETTLED, atol=0.0) for name in before)


def with_third(study: Study, curves: Curves, pair: Candidate, count: int) -> list[dict[str, float]]:
    """Return the `count` best hypotheses of a simulated pair and one more cause, by the curves.

    The pair's sizes are kept.
    """
    free_off = study.columns(pair.sizes).cells(False) - curves.cells(pair.sizes, False)
    found: list[tuple[float, dict[str, float]]] = []
    for name in curves.answers:
        if name not in pair.sizes:
            tried = [{**pair.sizes, name: float(size)} for size in _tried(name)]
            cost = [Misfit.of(_moved(curves, sizes, free_off, pair.bounded)).fit for sizes in tried]
            found.append((min(cost), tried[int(np.argmin(cost))]))
    return [sizes for _, sizes in sorted(found, key=lambda each: each[0])[:count]]


def _moved(curves: Curves, sizes: Sizes, free_off: FloatArray, bounded: bool) -> FloatArray:
    free = curves.cells(sizes, False) + free_off
    return curves.on_ridge(free, np.minimum(free[:, PINNED], 0.0)) if bounded else free


def _continued(
    curves: Curves, start: Sizes, bounded: bool, free_off: FloatArray, held_off: FloatArray
) -> dict[str, float]:
    """Return sizes, not on the grid, of least misfit by the corrected curves; switches stay."""
    moving = [name for name in start if not CAUSES[name].switch]
    low, high = (np.array([CAUSES[name].knots[end] for name in moving]) for end in (0, -1))

    def sizes_of(shares: FloatArray) -> dict[str, float]:
        placed = low + np.clip(shares, 0.0, 1.0) * (high - low)
        return {**start, **dict(zip(moving, placed.tolist(), strict=True))}

    def cost(shares: FloatArray) -> float:
        cells = _moved(curves, sizes_of(shares), free_off, bounded) + (held_off if bounded else 0.0)
        outside = float(np.square(shares - np.clip(shares, 0.0, 1.0)).sum())
        return Misfit.of(cells).fit + _OUTSIDE * outside

    at = (np.array([start[name] for name in moving]) - low) / (high - low)
    if not moving:
        return dict(start)
    found = minimize(
        cost, at, method="Nelder-Mead", options={"maxfev": _MOST_EVALUATIONS, "xatol": _FINE, "fatol": _FINE}
    )
    return sizes_of(found.x)


def interpolated(curves: Curves, sizes: Sizes, bounded: bool) -> Candidate:
    """Return a hypothesis by its curves alone."""
    return Candidate(sizes, bounded, Misfit.of(curves.cells(sizes, bounded)), False)


def random_pairs(scan: Scan, count: int, seed: int) -> Iterator[dict[str, float]]:
    """Yield so many different pairs, drawn evenly from all, with their best sizes."""
    firsts, seconds = np.triu_indices(len(scan.names), 1)
    count = min(count, len(firsts))
    for k in np.random.default_rng(seed).choice(len(firsts), count, replace=False):
        yield scan.pair_sizes(int(firsts[k]), int(seconds[k]))
