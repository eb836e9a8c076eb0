"""The recordings that are fitted, jointly, and those held out, on which nothing is fitted."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

from discrepancy.evidence.noise import Noise, known_noise, repeated
from discrepancy.joint import check_one_system, joined
from discrepancy.problem import THIS, Part, Problem
from discrepancy.simulation import Simulation, TakesLibrary
from messages.errors import UserError

_FIT_SHARE = 0.7
"""Of a recording that has no other beside it: what is fitted; the rest judges."""


@dataclass(frozen=True)
class Recordings:
    """What is fitted and what is held out, of either one recording or several as one problem, with the names of all.

    `held_out_is_own` is False where the last part of each fitted recording is held out.
    """

    fit: Problem
    held_out: Problem
    held_out_is_own: bool
    fitted_names: tuple[str, ...]
    held_out_names: tuple[str, ...]

    @classmethod
    def of(cls, fit: Sequence[Simulation], held_out: Sequence[Simulation], names: Sequence[str] = ()) -> "Recordings":
        """Return all; `names` are those of the fitted and then of the held-out ones. Raises UserError where too little
        of one can be compared, or they are not of one system.
        """
        fit = [_like(each, fit[0]) if place else each for place, each in enumerate(fit)]
        held_out = [_like(each, fit[0]) for each in held_out]
        numbered = [f"recording {place}" for place in range(1, len(fit) + 1)]
        numbered += [f"held out {place}" for place in range(1, len(held_out) + 1)]
        told = tuple(names) or tuple(numbered)
        first, rest = told[: len(fit)], told[len(fit) :]
        check_one_system(fit, first)
        check_one_system(held_out, rest)
        if held_out:
            every = zip((*fit, *held_out), _noises([*fit, *held_out]), told, strict=True)
            problems = [_problem(each, known, name) for each, known, name in every]
            return cls(joined(problems[: len(fit)]), joined(problems[len(fit) :]), True, first, rest)
        last = tuple(f"{name}, its end" for name in first)
        beginnings, ends = [], []
        for each, name, end in zip(fit, first, last, strict=True):
            n = len(each.channels.t_s)
            cut = round(_FIT_SHARE * n)
            known = known_noise(each.channels)
            beginnings.append(_problem(Part(each, 0, cut), known, name))
            ends.append(_problem(Part(each, cut, n), known, end, continued=True))
        return cls(joined(beginnings), joined(ends), False, first, last)


def _problem(simulation: Simulation, noise: Noise | None, name: str, *, continued: bool = False) -> Problem:
    try:
        return Problem(simulation, noise, continued=continued)
    except UserError as error:
        raise UserError(str(error).replace(THIS, name, 1)) from error


def _like(simulation: Simulation, fitted: Simulation) -> Simulation:
    return simulation.like(fitted) if isinstance(simulation, TakesLibrary) else simulation


def _noises(simulations: Sequence[Simulation]) -> list[Noise | None]:
    """Return what repeats tell of the noise of each recording, None for one that no other repeats."""
    found: list[Noise | None] = [None] * len(simulations)
    for a, b in combinations(range(len(simulations)), 2):
        told = repeated(simulations[a].channels, simulations[b].channels)
        found[a], found[b] = found[a] or told, found[b] or told
    return found


def check_different(files: Sequence[Path]) -> None:
    """Raise UserError where a recording is given twice: it would pass for two that agree."""
    places = [file.resolve() for file in files]
    for file, place in zip(files, places, strict=True):
        if places.count(place) > 1:
            raise UserError(f"{file}: given twice; expected different recordings")
