"""Which cause or pair of causes made the printed tables, as far as they can tell, and how far that is proof."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lab.thesis.causes import CAUSES
from lab.thesis.hypotheses import (
    CELLS,
    MOST_TOLERANCES,
    Misfit,
    Sizes,
    Study,
    estimate_all,
    first_hypotheses,
    printed_cells,
    tolerances,
)
from lab.thesis.printed import RATES_HZ
from lab.thesis.search import (
    Candidate,
    Curves,
    Grid,
    Refinement,
    Scan,
    interpolated,
    random_pairs,
    with_third,
)
from messages.arrays import FloatArray

ROUNDS = 3  # of simulating a hypothesis and moving its sizes
_AGAIN = 3  # best hypotheses that are simulated with other torque steps and noise
_FIRST_PAIRS, _THIRDS = 4, 4  # pairs that get a third cause, and how many each
_MOST_CHANCE = 0.05  # with which a made-up table may be met as well, for a cause to be named
_AS_WELL = 1.1  # times the best misfit: no worse for a reader


@dataclass(frozen=True)
class Effort:
    """How much is simulated beyond the curves: the best hypotheses of each kind, random pairs, made-up tables."""

    best: int = 16
    random: int = 20
    flips: int = 200
    processes: int = 2


@dataclass(frozen=True)
class TablesVerdict:
    """What `gaiteyes explain tables` found; candidates are in rising misfit at 29 and 40 Hz.

    `singles` holds every cause and `pairs` the best pairs, by either estimator; `triples` what a third cause makes of
    the very best, and `random` pairs drawn evenly. `all_pairs` (p,) is the misfit of every pair by the curves,
    `flipped` (draws,) what the best pair leaves of the printed misfit and of made-up ones. `again` are the best with
    other torque steps and noise.
    """

    base: Candidate
    singles: tuple[Candidate, ...]
    pairs: tuple[Candidate, ...]
    triples: tuple[Candidate, ...]
    random: tuple[Candidate, ...]
    all_pairs: FloatArray
    flipped: FloatArray
    again: tuple[Candidate, ...]
    causes: int
    seed: int
    seconds: float

    @property
    def hypotheses(self) -> int:
        """Return how many were tried: each cause and each pair, by either estimator."""
        return self.causes * (self.causes + 1)

    @property
    def simulated(self) -> int:
        """Return how many of the causes and pairs, random ones apart, were simulated at their own sizes."""
        return sum(c.simulated for c in (*self.singles, *self.pairs))

    @property
    def reproducing(self) -> list[Candidate]:
        """Return the simulated hypotheses that meet every cell, 67 Hz and the plate included."""
        return [c for c in (*self.singles, *self.pairs) if c.simulated and c.misfit.reproduces]

    @property
    def verdict(self) -> str:
        """Return `named` where all that reproduces the tables shares an effect, beyond chance, else `unknown`."""
        return "named" if self.common and self.chance <= _MOST_CHANCE else "unknown"

    @property
    def common(self) -> list[str]:
        """Return the effects that all reproducing hypotheses have in common."""
        sets = [{CAUSES[name].effect for name in c.names} for c in self.reproducing]
        return sorted(set.intersection(*sets)) if sets else []

    @property
    def best(self) -> Candidate:
        """Return the simulated hypothesis of least misfit at 29 and 40 Hz."""
        return min((c for c in (*self.singles, *self.pairs) if c.simulated), key=lambda c: c.misfit.fit)

    @property
    def as_well(self) -> int:
        """Return how many of all pairs are no worse than 1.1 times the best simulated one, by the curves."""
        return int((self.all_pairs <= _AS_WELL * self.best.misfit.fit).sum())

    @property
    def chance(self) -> float:
        """Return how often a made-up table is met by its best pair as well as the printed one, (k + 1) / (n + 1)."""
        made_up = self.flipped[1:]
        return float((np.sum(made_up <= self.flipped[0]) + 1) / (len(made_up) + 1))

    @property
    def sentences(self) -> list[str]:
        """Return how far it is proof, to a person."""
        best = self.best
        fit, test, plate = best.misfit.fit, best.misfit.foot_test, best.misfit.plate
        what = " and ".join(best.names)
        missed = ", ".join(best.misfit.missed) or "nothing"
        found = len(self.reproducing)
        return [
            f"{self.hypotheses} hypotheses were tried: {self.causes} causes and all their pairs, with and without "
            f"J ≥ 0; all of them by curves between simulated sizes, the best {self.simulated} simulated themselves.",
            f"{found} of those simulated meet every cell of both tables at all rates within {MOST_TOLERANCES:g} "
            f"tolerances, with Jx at 0.0 in all three."
            + (f" They have {', '.join(self.common)} in common." if self.common else ""),
            f"The least misfit is that of {what}: {fit:.2f} tolerances RMS where it was fitted, {test:.2f} at 67 Hz, "
            f"{plate:.2f} on the plate; without any cause {self.base.misfit.fit:.2f}. It misses {missed}.",
            f"Of all pairs {self.as_well} of {len(self.all_pairs)} come within a tenth of that; a pair drawn at random "
            f"has {np.median(self.all_pairs):.2f} in the median.",
            f"Made-up tables, the signs of the printed deviations drawn anew, are met as well by their best pair with "
            f"a probability of {self.chance:.3f}.",
            "It is not proof that this happened in the laboratory: amplitude, noise and geometry of the real runs are "
            "not printed, three runs tell a spread to a factor of two, and Table 1's reference is the mean of the "
            "same three estimates.",
        ]

    @property
    def facts(self) -> dict[str, object]:
        """Return the same for a program."""
        return {
            "verdict": self.verdict,
            "common_effects": self.common,
            "seed": self.seed,
            "seconds": self.seconds,
            "rates_hz": RATES_HZ,
            "cells": CELLS,
            "printed": printed_cells().tolist(),
            "tolerances": tolerances().tolist(),
            "most_tolerances": MOST_TOLERANCES,
            "hypotheses": self.hypotheses,
            "simulated": self.simulated,
            "base": _facts_of(self.base),
            "singles": [_facts_of(c) for c in self.singles],
            "pairs": [_facts_of(c) for c in self.pairs],
            "triples": [_facts_of(c) for c in self.triples],
            "random_pairs": [_facts_of(c) for c in self.random],
            "again": [_facts_of(c) for c in self.again],
            "all_pairs_fit": {
                "quantiles": np.linspace(0.0, 1.0, 21).tolist(),
                "misfit": np.quantile(self.all_pairs, np.linspace(0.0, 1.0, 21)).tolist(),
                "no_worse_than_best": self.as_well,
                "count": len(self.all_pairs),
            },
            "made_up_tables": {"left_by_best_pair": self.flipped.tolist(), "chance": self.chance},
            "proof": self.sentences,
        }


def _facts_of(c: Candidate) -> dict[str, object]:
    m = c.misfit
    return {
        "causes": {
            name: {"value": size, "unit": CAUSES[name].unit, "in_library": CAUSES[name].library}
            for name, size in c.sizes.items()
        },
        "bounded": c.bounded,
        "simulated": c.simulated,
        "fit": m.fit,
        "foot_29_40": m.foot_fit,
        "foot_67": m.foot_test,
        "plate": m.plate,
        "pinned": m.pinned,
        "missed": m.missed,
        "reproduces": m.reproduces,
        "z": m.z.tolist(),
    }


def judged(
    study: Study,
    effort: Effort,
    shown: Callable[[Iterable[Sizes], int, str], None],
    names: Sequence[str] = tuple(CAUSES),
) -> TablesVerdict:
    """Try every cause of `names` and every pair of them against the printed tables.

    `shown` runs an iterable of so many steps to its end behind a progress bar of that name. What the study's folder
    holds already is not simulated again.
    """

    def simulate(hypotheses: Sequence[Sizes], what: str) -> None:
        wanted = [sizes for sizes in hypotheses if not study.holds(sizes)]
        shown(estimate_all(study, wanted, effort.processes), len(wanted), what)

    study.prepare()
    simulate(first_hypotheses(names), "each cause")
    curves = Curves.of(study, names)
    grids = {bounded: Grid(curves, bounded) for bounded in (False, True)}
    scans = {bounded: grid.scan() for bounded, grid in grids.items()}
    starts = [(sizes, bounded) for bounded, scan in scans.items() for sizes in _worth_simulating(scan, effort.best)]
    found = _tuned(study, curves, starts, simulate, "best hypotheses")
    drawn = list(random_pairs(scans[True], effort.random, study.seed))
    simulate(drawn, "random pairs")
    singles = {(c.names, c.bounded): c for bounded, scan in scans.items() for c in _all_singles(curves, scan, bounded)}
    singles.update({(c.names, c.bounded): c for c in found if len(c.names) == 1})
    pairs = [c for c in found if len(c.names) == 2]
    thirds = [(sizes, c.bounded) for c in pairs[:_FIRST_PAIRS] for sizes in with_third(study, curves, c, _THIRDS)]
    cells = 2 * len(CELLS)
    return TablesVerdict(
        base=Candidate({}, True, Misfit.of(study.columns({}).cells(True)), True),
        singles=tuple(sorted(singles.values(), key=lambda c: c.misfit.fit)),
        pairs=tuple(pairs),
        triples=tuple(_tuned(study, curves, thirds, simulate, "a third cause")),
        random=tuple(_as_simulated(study, sizes) for sizes in drawn),
        all_pairs=np.sqrt(scans[True].pair[np.triu_indices(len(names), 1)] / cells),
        flipped=grids[True].best_of_flipped(effort.flips + 1, study.seed),
        again=_again(study, [*singles.values(), *pairs]),
        causes=len(names),
        seed=study.seed,
        seconds=study.seconds,
    )


def _tuned(
    study: Study,
    curves: Curves,
    starts: Sequence[tuple[Sizes, bool]],
    simulate: Callable[[Sequence[Sizes], str], None],
    what: str,
) -> list[Candidate]:
    """Return the hypotheses with their sizes fitted to simulations of their own, in rising misfit."""
    refinements = [Refinement(curves, sizes, bounded) for sizes, bounded in starts]
    for step in range(ROUNDS):
        moving = [refinement for refinement in refinements if not refinement.settled]
        simulate([refinement.sizes for refinement in moving], f"{what}, {step + 1} of {ROUNDS}")
        for refinement in moving:
            refinement.take(study)
    best = [refinement.best for refinement in refinements if refinement.best is not None]
    return sorted(best, key=lambda c: c.misfit.fit)


def _worth_simulating(scan: Scan, count: int) -> list[dict[str, float]]:
    best_alone = np.argsort(scan.single)[: max(1, count // 3)].tolist()
    return [*(scan.single_sizes(i) for i in best_alone), *scan.best_pairs(count)]


def _all_singles(curves: Curves, scan: Scan, bounded: bool) -> list[Candidate]:
    return [interpolated(curves, scan.single_sizes(i), bounded) for i in range(len(scan.names))]


def _as_simulated(study: Study, sizes: Sizes) -> Candidate:
    return Candidate(sizes, True, Misfit.of(study.columns(sizes).cells(True)), True)


def _again(study: Study, candidates: list[Candidate]) -> tuple[Candidate, ...]:
    """Return the best candidates of equal sizes, with other torque steps and noise."""
    other = replace(study, folder=study.folder / "again", seed=study.seed + 1)
    other.prepare()
    best = sorted((c for c in candidates if c.simulated), key=lambda c: c.misfit.fit)[:_AGAIN]
    return tuple(replace(c, misfit=Misfit.of(other.columns(c.sizes).cells(c.bounded))) for c in best)
