"""Causes of a library that only together explain a simulation with ports: searched, judged frozen, and told.

Called where the causes found one by one leave most of the error, or none was found.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from discrepancy.findings import Alternatives
from discrepancy.judgement import LEAST_SMALLER, Judgement, Models, far_better, judged
from discrepancy.problem import Problem
from discrepancy.recordings import Recordings
from discrepancy.search.carried import carried
from discrepancy.search.equivalents import SAME_CHI2
from discrepancy.search.fit import Fit
from discrepancy.search.pruning import immaterial
from discrepancy.search.scores import threshold
from discrepancy.search.search import Found, Search
from discrepancy.search.simulated import CauseSet, SimulatedSearch, deviance
from discrepancy.verdict import MOST_EQUIVALENTS


@dataclass(frozen=True)
class Together:
    """The causes found together, the search that found them, the models, how they were judged, and what the search for
    each by itself had `found`.
    """

    search: SimulatedSearch
    causes: CauseSet
    models: Models
    judgement: Judgement
    found: Found

    def likelier(self, than: Fit) -> bool:
        """Return whether the causes explain the recording better than another model's fit, beside the price of each."""
        return self.search.likelihood(self.causes) < self.search.rated(than)

    def alternatives(self) -> Alternatives:
        """Return what the fit loses without each cause, and what fits as well in its place."""
        rise: dict[str, float] = {}
        as_good: dict[str, dict[str, float]] = {}
        rival: dict[str, float] = {}
        for cause in self.causes.causes:
            effect = cause.effect
            rise[effect] = self.search.rise(self.causes, cause)
            worse = sorted((more, name) for name, more in self.search.alike(self.causes, effect).items())
            near = [(more, name) for more, name in worse if more < SAME_CHI2]
            as_good[effect] = {name: more for more, name in near[:MOST_EQUIVALENTS]}
            if len(worse) > len(near):
                rival[effect] = worse[len(near)][0]
        return Alternatives(rise, as_good, rival)


def little_explained(problem: Problem, models: Models) -> bool:
    """Return whether the causes found leave most of the simulated error on the recordings they are fitted to."""
    fell = deviance(problem, models.base) - deviance(problem, models.extended)
    return bool(fell < -2.0 * problem.valid.sum() * np.log(LEAST_SMALLER))


def together(
    recordings: Recordings, search: Search, found: Found, base: Models, names: Sequence[str], seed: int
) -> Together | None:
    """Return the causes of a library that explain the recordings together, beside the `base` models; None where none
    are found, or what they gain does not hold on the recordings held out.
    """
    among = SimulatedSearch(recordings.fit, search.refits, names, threshold(found.chance))
    causes = _kept(recordings, among, among.found())
    if not causes.causes:
        return None
    models = replace(base, extended=causes.fit, extended_intervals=among.intervals(causes), causes=causes.causes)
    judgement = judged(recordings, models, seed)
    if not far_better(judgement.gain):
        return None
    return Together(among, causes, models, judgement, replace(found, best=causes.fit, causes=causes.causes))


def _kept(recordings: Recordings, search: SimulatedSearch, found: CauseSet) -> CauseSet:
    """Return those of the causes that are surely there, and of several those without which the simulated error would be
    larger on the recordings held out too, frozen.
    """
    problem, other = recordings.fit, recordings.held_out

    def elsewhere(causes: CauseSet) -> float:
        values = carried(other, causes.fit.values)
        return deviance(other, replace(causes.fit, residual=other.residual(values)))

    while found.causes:
        gone = immaterial(problem, found.fit, search.intervals(found), found.causes, partial(search.rise, found))
        if not gone and len(found.causes) > 1:
            told = elsewhere(found)
            gone = [name for name in found.effects if elsewhere(search.without(found, name)) < told]
        if not gone:
            break
        found = search.without(found, sorted(gone)[-1])
    return found
