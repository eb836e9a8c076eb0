"""What no library names, constructed: terms at a simulation's ports, selected, sized, and judged frozen.

Called where the library's effects leave a simulation unexplained.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.construct.columns import Ports
from discrepancy.construct.selection import Selection
from discrepancy.construct.terms import MadeTerm
from discrepancy.judgement import LEAST_REMOVED, Judgement, Models, Recordings, judged
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.problem import Problem
from discrepancy.restricted import Restricted
from discrepancy.search.candidates import Candidate
from discrepancy.search.fit import Fit, Intervals
from discrepancy.search.pruning import immaterial, intervals_of
from discrepancy.search.search import Found
from discrepancy.simulation import Simulation
from discrepancy.values import Neutral

_LEAST_SMALLER = 0.67
"""Of the base model's held-out error: what a construction must bring it below; many forms fit anything a little."""


@dataclass(frozen=True)
class Construction:
    """Both recordings with the made terms in their library, the search there, and the models it left."""

    recordings: Recordings
    selection: Selection
    found: Found
    models: Models
    judgement: Judgement
    made: dict[str, MadeTerm]

    @property
    def holds(self) -> bool:
        """Return whether it removes half of the held-out excess, as any cause must, and makes the error smaller by a
        third.
        """
        gain = self.judgement.gain
        before, after, removed = gain.held_out_nrmse_before, gain.held_out_nrmse_after, gain.share_of_excess_removed
        if before is None or after is None or removed is None:
            return False
        return removed >= LEAST_REMOVED and after < _LEAST_SMALLER * before

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


def constructed(fit: Simulation, held_out: Simulation | None, base: dict[str, float], seed: int) -> Construction | None:
    """Return what can be constructed beside the base model, fitted at `base`, judged; None where the simulation has no
    ports, or no term is found that lowers the misfit by more than chance.
    """
    whole = ported(fit)
    other = ported(held_out) if held_out is not None else None
    if whole is None or (held_out is not None and other is None):
        return None
    at = Neutral(whole).completed(base)
    ports = Ports(whole, at)
    names = [each.name for each in fit.effects]
    found = _by_formulas(_Task(whole, other, ports, ports.terms(at), base, seed), names)
    if found is not None and found.holds:
        return found
    curves = _learned(_Task(whole, other, ports, ports.curves(at), base, seed))
    return curves if curves is not None and curves.holds else None


@dataclass(frozen=True)
class _Task:
    """Both simulations, the terms made at their ports, the base model's values, and the seed of the bootstrap."""

    fit: PortedSimulation
    held_out: PortedSimulation | None
    ports: Ports
    made: tuple[MadeTerm, ...]
    base: dict[str, float]
    seed: int

    @property
    def whole(self) -> PortedSimulation:
        """Return the simulation that is fitted, with the terms in its library."""
        return self._with(self.fit)

    @property
    def recordings(self) -> Recordings:
        """Return both recordings with the terms in the library."""
        return Recordings.of(self.whole, None if self.held_out is None else self._with(self.held_out))

    def _with(self, simulation: PortedSimulation) -> PortedSimulation:
        return simulation.with_terms((*simulation.library, *(each.term() for each in self.made)))


def _by_formulas(task: _Task, names: Sequence[str]) -> Construction | None:
    """Return what formulas can say, beside the library's effects `names`."""
    recordings, seed = task.recordings, task.seed
    problem = recordings.fit
    selection = Selection(problem, task.ports, task.whole, task.made, names, task.base, seed)

    def adequate(best: Fit) -> bool:
        nothing = Intervals((), np.zeros((0, 0)), np.zeros((0, 2)))
        causes = tuple(Candidate(key, (), (), {}, (), None) for key in best.keys[:1])
        return judged(recordings, Models(selection.base, nothing, best, nothing, causes), seed).after.adequate

    found = selection.found(adequate)
    models = _kept(problem, selection, found)
    made = {each.effect.name: each for each in task.made}
    if not any(cause.effect in made for cause in models.causes):
        return None
    return Construction(recordings, selection, found, models, judged(recordings, models, seed), made)


def _learned(task: _Task) -> Construction | None:
    """Return a learned curve of one signal."""
    recordings, seed = task.recordings, task.seed
    problem = recordings.fit
    selection = Selection(problem, task.ports, task.whole, task.made, (), task.base, seed)
    best = selection.curve()
    if best is None:
        return None
    made, found = best
    models = _models(problem, found.base, found.best, found.causes)
    judgement = judged(recordings, models, seed)
    return Construction(recordings, selection, found, models, judgement, {made.effect.name: made})


def _kept(problem: Problem, selection: Selection, found: Found) -> Models:
    """Return the models with those of the causes found that are surely larger than their scale."""
    best, causes = found.best, found.causes
    while causes:
        gone = immaterial(problem, best, intervals_of(problem, best), causes)
        if not gone:
            break
        cause = next(each for each in causes if each.effect == gone[-1])
        causes = tuple(each for each in causes if each.effect != cause.effect)
        best = selection.without(best, cause) if causes else found.base
    return _models(problem, found.base, best, causes)


def _models(problem: Problem, base: Fit, best: Fit, causes: tuple[Candidate, ...]) -> Models:
    return Models(base, intervals_of(problem, base), best, intervals_of(problem, best), causes)
