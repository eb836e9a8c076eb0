"""Under whose noise fits are held against each other, where the one at hand is none of theirs."""

import numpy as np

from discrepancy.problem import Problem
from discrepancy.search.fit import Fit
from discrepancy.search.refits import Refits
from messages.arrays import FloatArray
from tests.bench.ported import sled


def _leaving(problem: Problem, refits: Refits, residual: FloatArray) -> Fit:
    return refits.rated(Fit(problem.start(), residual, 0.0, ()))


def test_what_changes_nothing_does_not_matter_however_far_its_parameters_are_from_neutral() -> None:
    problem = Problem(sled(1))
    refits = Refits(problem, ["dead_band_spring_at_sled"])
    cause = next(each for each in refits.candidates if "dead_band_spring_at_sled.gap" in each.keys)
    for value, matters in ((0.0, False), (0.5, True)):
        told = {"dead_band_spring_at_sled.value": value, "dead_band_spring_at_sled.gap": 0.3}
        fit = Fit({**refits.base.values, **told}, refits.base.residual, 0.0, cause.keys)
        assert refits.matters(fit, cause) is matters


def test_a_noise_that_is_of_no_fit_is_told_and_each_fit_has_the_likelihood_of_its_own() -> None:
    random = np.random.default_rng(11)
    problem = Problem(sled(1))
    refits = Refits(problem, ["gain_of_force_N"])
    assert not refits.unlike_all([refits.base])
    shape = (problem.c, problem.n)
    beneath = np.cumsum(random.normal(0.0, 1e-3, shape), axis=1)
    refits.white = problem.whitening(beneath)
    wanders = _leaving(problem, refits, 10.0 * beneath)
    scatters = _leaving(problem, refits, random.normal(0.0, 8.5e-3, shape))
    assert np.sum(wanders.residual**2) > 10.0 * np.sum(scatters.residual**2)
    assert wanders.chi2 < scatters.chi2
    assert refits.unlike_all([wanders, scatters])
    assert not refits.unlike_all([wanders, _leaving(problem, refits, beneath)])
    assert refits.deviance(scatters) < refits.deviance(wanders)
    assert not refits.outdoes(wanders, scatters)  # better under a noise that is of neither
    refits.white = problem.whitening(scatters.residual)
    assert refits.outdoes(*map(refits.rated, (scatters, wanders)))
