"""Causes that stand on nothing are not named: strong remainders, bounds, surplus seconds, promises of starts."""

from dataclasses import replace

import numpy as np

from discrepancy import explain
from discrepancy.evidence.gain import gain
from discrepancy.problem import Problem
from discrepancy.search.candidates import Candidate
from discrepancy.search.fit import Intervals
from discrepancy.search.pruning import deciding, immaterial, louder, short_of_neutral
from discrepancy.search.refits import base_of
from discrepancy.search.scores import PENALTY
from discrepancy.search.search import Search
from tests.bench.discrepancy_bench import EFFECTS, Path, Rig, coloured, measured

_N = 3000


def rig(*causes: str, seed: int = 1, noise_std: float | None = None) -> Rig:
    """Return a recording with these causes and 0.3 N of noise, or a wrong level declared."""
    rng = np.random.default_rng(seed)
    path = Path.drawn(rng)
    still = measured(path, "", 1.0, _N)
    truth = still + sum(measured(path, cause, 1.0, _N) - still for cause in causes)
    declared = None if noise_std is None else np.full(2, noise_std)
    return Rig(path, truth + coloured(rng, _N, 0.3, 0.5), declared)


def test_what_is_left_far_above_the_declared_noise_counts_as_excess() -> None:
    problem = Problem(rig(noise_std=0.02))
    after = problem.residual(problem.start())
    before = 1.001 * after
    nothing = np.zeros_like(after)
    share = gain(problem, before, after, nothing, True).share_of_excess_removed
    assert share is not None
    assert share < 0.01
    undeclared = gain(Problem(rig()), before, after, nothing, True).share_of_excess_removed
    assert undeclared == 1.0


def test_a_declared_noise_that_is_nearly_right_does_not_hide_a_small_gain() -> None:
    problem = Problem(rig(noise_std=0.3))
    noise = coloured(np.random.default_rng(3), _N, 0.3, 0.5).T
    share = gain(problem, 1.001 * noise, noise, np.zeros_like(noise), True).share_of_excess_removed
    assert share == 1.0


def test_a_damping_does_not_decide_and_a_bound_is_no_finding() -> None:
    problem = Problem(rig())
    base = base_of(problem)[0]
    keys = ("lag.tau_s", "resonance.hz", "resonance.zeta")
    values = {**base.values, "lag.tau_s": 0.05, "resonance.hz": 40.0, "resonance.zeta": 0.3}
    fit = replace(base, values=values, keys=keys)
    candidates = [Candidate(name, (), (), {}, (), None) for name in ("lag", "resonance")]
    bounds = np.array([[0.049, 0.05], [39.0, 41.0], [0.29, 0.31]])
    found = Intervals(keys, np.zeros((3, 3)), bounds)
    assert deciding(problem, fit, "resonance") == ["resonance.hz"]
    assert immaterial(problem, fit, found, candidates) == ["lag"]
    problem.parameters["lag.tau_s"] = replace(problem.parameters["lag.tau_s"], own_bounds=True)
    assert immaterial(problem, fit, found, candidates) == []  # the bound is one that the effect took from the recording
    inside = replace(fit, values={**values, "lag.tau_s": 0.04})
    assert immaterial(problem, inside, Intervals(keys, np.zeros((3, 3)), bounds - 0.01), candidates) == []


def test_a_cause_that_the_fit_needs_stays_though_its_interval_reaches_what_does_not_matter() -> None:
    problem = Problem(rig())
    base = base_of(problem)[0]
    key = "lag.tau_s"
    fit = replace(base, values={**base.values, key: 0.01}, keys=(key,))
    found = Intervals((key,), np.zeros((1, 1)), np.array([[-0.01, 0.03]]))
    lag = [Candidate("lag", (), (), {}, (), None)]
    assert immaterial(problem, fit, found, lag) == ["lag"]
    assert immaterial(problem, fit, found, lag, lambda _: PENALTY - 1.0) == ["lag"]
    assert immaterial(problem, fit, found, lag, lambda _: PENALTY + 1.0) == []
    on_a_bound = replace(fit, values={**base.values, key: problem.parameters[key].high})
    assert immaterial(problem, on_a_bound, found, lag, lambda _: 1000.0) == ["lag"]
    assert short_of_neutral(problem, fit, found, lag).of(key) == (0.0, 0.03)


def test_best_candidates_at_neutral_and_at_starts_are_both_refitted() -> None:
    names = [effect.name for effect in EFFECTS]
    refitted = [each.candidate for each in Search(Problem(rig("delay")), names, 1).found().singles if each.fit]
    assert "delay" in {each.effect for each in refitted if each.offset is None}
    assert "resonance" in {each.effect for each in refitted if each.offset is not None}


def test_a_cause_of_the_fit_recording_alone_is_not_kept_beside_a_true_one() -> None:
    fit = rig("delay", "offset", seed=4)
    held_out = rig("delay", seed=5)
    found = explain(fit, held_out, seed=1)
    assert [cause.name for cause in found.verdict.causes] == ["delay"]


def test_a_constant_far_above_the_declared_noise_is_no_slow_noise() -> None:
    held_out = Problem(rig("offset", noise_std=0.1))
    base = base_of(held_out)[0]
    without = replace(base, values={**base.values, "offset.fz_n": 0.0})
    best = replace(base, values={**base.values, "offset.fz_n": 0.8})
    assert louder(held_out, without, best)
    assert not louder(held_out, best, best)
    assert not louder(Problem(rig("offset")), without, best)


def test_a_constant_that_is_there_on_both_recordings_stays_beside_another_cause() -> None:
    fit, held_out = (rig("delay", "offset", seed=seed, noise_std=0.3) for seed in (4, 5))
    found = explain(fit, held_out, seed=1)
    assert {cause.name for cause in found.verdict.causes} == {"delay", "offset"}
