"""What no library names, constructed: terms at a simulation's ports, selected, sized, and judged frozen.

Called where the library's effects leave a simulation unexplained.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from discrepancy.construct.columns import Ports
from discrepancy.construct.selection import MOST_TERMS, Selection
from discrepancy.construct.terms import MadeTerm
from discrepancy.judgement import Judgement, Models, far_better, judged
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.problem import Problem
from discrepancy.recordings import Recordings
from discrepancy.restricted import Restricted
from discrepancy.search.candidates import Candidate
from discrepancy.search.fit import Fit, Intervals
from discrepancy.search.pruning import immaterial, intervals_of, short_of_neutral
from discrepancy.search.search import Found
from discrepancy.simulation import Simulation
from discrepancy.values import Neutral

_FAR_LESS = 1.0 / 3.0
"""Of the held-out error that named causes leave: one term that leaves less is nearer to what is there."""


@dataclass(frozen=True)
class Construction:
    """All recordings with the made terms in their library, the search there, and the models it left."""

    recordings: Recordings
    selection: Selection
    found: Found
    models: Models
    judgement: Judgement
    made: dict[str, MadeTerm]

    @property
    def holds(self) -> bool:
        """Return whether what it gains holds on the recordings held out."""
        return far_better(self.judgement.gain)

    def outdoes(self, left: float) -> bool:
        """Return whether a single cause leaves nothing to explain, or far less of the held-out error than others do,
        which is `left`; of several, those of a library may be simpler.
        """
        after = self.judgement.gain.held_out_nrmse_after
        far_less = after is not None and after < _FAR_LESS * left
        return len(self.models.causes) == 1 and (self.judgement.after.adequate or far_less)

    def alike(self) -> tuple[dict[str, dict[str, float]], dict[str, float]]:
        """Return for each cause what fits as well in its place, with the rise of χ², and the rise of the best that does
        not.
        """
        return self.selection.alike(self.models.extended, self.models.causes)

    def rise(self, cause: Candidate) -> float:
        """Return by how much χ² rises without a cause."""
        return self.selection.rise(self.models.extended, cause)


def ported(simulation: Simulation) -> PortedSimulation | None:
    """Return the simulation with ports beneath, with what is left of its library; None if it has none."""
    if isinstance(simulation, Restricted):
        whole = ported(simulation.whole)
        if whole is None:
            return None
        return whole.with_terms([each for each in whole.library if each.effect.name not in simulation.left_out])
    return simulation if isinstance(simulation, PortedSimulation) and simulation.ports else None


def constructed(
    fit: Sequence[Simulation],
    held_out: Sequence[Simulation],
    names: Sequence[str],
    base: dict[str, float],
    seed: int,
    left: float | None = None,
) -> Construction | None:
    """Return what can be constructed beside the base model, fitted at `base`, judged; None where the simulation has no
    ports, or no term is found that lowers the misfit by more than chance. Terms are made from the first recording's
    motion. `names` are those of all recordings. Where causes of the library leave a held-out error, `left`, it is one
    term that outdoes them, or None.
    """
    wholes, others = ([each for each in map(ported, side) if each is not None] for side in (fit, held_out))
    if len(wholes) < len(fit) or len(others) < len(held_out):
        return None
    known = {p.name for p in wholes[0].parameters}
    at = Neutral(wholes[0]).completed({key: value for key, value in base.items() if key in known})
    ports = Ports(wholes[0], at)
    effects = [each.name for each in fit[0].effects]
    task = _Task(wholes, others, names, ports, ports.terms(at), base, seed)

    def told(made: Construction | None) -> bool:
        return made is not None and made.holds and (left is None or made.outdoes(left))

    found = _by_formulas(task, effects, MOST_TERMS if left is None else 1)
    if told(found):
        return found
    curves = _learned(_Task(wholes, others, names, ports, ports.curves(at), base, seed))
    return curves if told(curves) else None


@dataclass(frozen=True)
class _Task:
    """All simulations, their recordings' names, the terms made at their ports, the base model's values, and the seed of
    the bootstrap.
    """

    fit: Sequence[PortedSimulation]
    held_out: Sequence[PortedSimulation]
    names: Sequence[str]
    ports: Ports
    made: tuple[MadeTerm, ...]
    base: dict[str, float]
    seed: int

    @property
    def wholes(self) -> list[PortedSimulation]:
        """Return the simulations that are fitted, with the terms in their library."""
        return [self._with(each) for each in self.fit]

    @property
    def recordings(self) -> Recordings:
        """Return all recordings with the terms in the library."""
        return Recordings.of(self.wholes, [self._with(each) for each in self.held_out], self.names)

    def _with(self, simulation: PortedSimulation) -> PortedSimulation:
        library = simulation.like(self.fit[0]).library if len(self.fit) > 1 else simulation.library
        return simulation.with_terms((*library, *(each.term() for each in self.made)))


def _by_formulas(task: _Task, names: Sequence[str], most: int) -> Construction | None:
    """Return what `most` formulas can say, beside the library's effects `names`."""
    recordings, seed = task.recordings, task.seed
    problem = recordings.fit
    selection = Selection(problem, task.ports, task.wholes, task.made, names, task.base, seed)

    def adequate(best: Fit) -> bool:
        nothing = Intervals((), np.zeros((0, 0)), np.zeros((0, 2)))
        causes = tuple(Candidate(key, (), (), {}, (), None) for key in best.keys[:1])
        return judged(recordings, Models(selection.base, nothing, best, nothing, causes), seed).after.adequate

    found = selection.found(adequate, most)
    models = _kept(problem, selection, found)
    made = {each.effect.name: each for each in task.made}
    if not any(cause.effect in made for cause in models.causes):
        return None
    return Construction(recordings, selection, found, models, judged(recordings, models, seed), made)


def _learned(task: _Task) -> Construction | None:
    """Return a learned curve of one signal."""
    recordings, seed = task.recordings, task.seed
    problem = recordings.fit
    selection = Selection(problem, task.ports, task.wholes, task.made, (), task.base, seed)
    best = selection.curve()
    if best is None:
        return None
    made, found = best
    models = _models(problem, found.base, found.best, found.causes)
    judgement = judged(recordings, models, seed)
    return Construction(recordings, selection, found, models, judgement, {made.effect.name: made})


def _kept(problem: Problem, selection: Selection, found: Found) -> Models:
    """Return the models with those of the causes found that are surely larger than their scale, or without which the
    fit is surely worse.
    """
    best, causes = found.best, found.causes
    while causes:
        gone = immaterial(problem, best, intervals_of(problem, best), causes, partial(selection.rise, best))
        if not gone:
            break
        cause = next(each for each in causes if each.effect == gone[-1])
        causes = tuple(each for each in causes if each.effect != cause.effect)
        best = selection.without(best, cause) if causes else found.base
    models = _models(problem, found.base, best, causes)
    return replace(models, extended_intervals=short_of_neutral(problem, best, models.extended_intervals, causes))


def _models(problem: Problem, base: Fit, best: Fit, causes: tuple[Candidate, ...]) -> Models:
    return Models(base, intervals_of(problem, base), best, intervals_of(problem, best), causes)
