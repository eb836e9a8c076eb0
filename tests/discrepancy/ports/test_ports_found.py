"""What a port's own sign, sharp friction, unfelt parameters and diverging models do to what is found."""

from dataclasses import replace

import numpy as np
import pytest

from discrepancy import explain
from discrepancy.explanation import Explanation
from discrepancy.ports.declared import Act, Arrays, Rows
from discrepancy.ports.ranges import spans
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.problem import Problem
from discrepancy.search.refits import base_of
from lab.hidden.five.acting import Hidden
from lab.hidden.five.hidden import mechanisms
from lab.hidden.five.systems import drawn
from lab.undeclared.five_systems import simulation
from messages.arrays import FloatArray
from tests.bench.ported import MODEL, derivative, hiding, sled


def _explained(system: str, mechanism: str, constants: dict[str, float], seed: int) -> Explanation:
    """Return what is said of a system of `lab.hidden.five` with a mechanism hidden, its noise undeclared."""
    hidden = mechanisms(system)[mechanism].makes(constants)
    recorded = [drawn(system, hidden, np.random.default_rng(s), np.random.default_rng(s + 9)) for s in (seed, seed + 1)]
    fit, other = (simulation(system, each, declared=False, bare=False) for each in recorded)
    return explain(fit, other, seed=1)


def _against(whole: PortedSimulation) -> PortedSimulation:
    """Return the sled with a port that counts what is added the other way."""

    def reversed_(state: Rows, inputs: Rows, values: Arrays, act: Act) -> tuple[FloatArray, ...]:
        return derivative(state, inputs, values, lambda port, *signals: -act(port, *signals))

    return replace(whole, model=replace(MODEL, derivative=reversed_))


def test_a_port_that_counts_the_other_way_has_the_same_friction() -> None:
    fit, other = (_against(each) for each in hiding({"coulomb_friction_at_sled.value": 0.3}, 5))
    assert [each.along for each in spans(fit).ports] == [-1.0]
    assert [each.along for each in spans(sled(5)).ports] == [1.0]
    (cause,) = explain(fit, other, seed=1).verdict.causes
    assert cause.name == "coulomb_friction_at_sled"
    value = cause.parameters["value"].value
    assert value is not None
    assert value == pytest.approx(0.3, rel=0.02)


def test_sharp_friction_of_somebody_else_s_is_named_alone() -> None:
    (cause,) = _explained("motor", "coulomb_friction_at_shaft", {"value": 0.0045}, 1).verdict.causes
    assert cause.name == "coulomb_friction_at_shaft"
    value = cause.parameters["value"].value
    assert value is not None
    assert value == pytest.approx(0.0045, rel=0.02)


def test_a_tone_is_found_though_its_frequency_is_not_felt_at_first() -> None:
    told = {"sine": 0.03, "cosine": 0.17, "hz": 13.2}
    (cause,) = _explained("motor", "tone_of_speed_radps", told, 1).verdict.causes
    assert cause.name == "tone_of_speed_radps"
    found = {name: each.value for name, each in cause.parameters.items()}
    assert found == pytest.approx(told, rel=0.05)


def test_one_term_that_leaves_nothing_stands_before_a_name_that_leaves_something() -> None:
    verdict = _explained("motor", "drag_of_power_three_halves", {"c": 0.0025}, 1).verdict
    assert verdict.verdict == "constructed"
    (term,) = verdict.constructed
    assert term.form == "signed_three_halves"
    assert not verdict.remainder.present


def test_one_term_that_leaves_far_less_stands_before_a_name_that_leaves_much() -> None:
    found = _explained("motor", "eddy_brake", {"c": 0.02}, 1)
    assert found.verdict.verdict == "constructed"
    after = found.verdict.gain.held_out_nrmse_after
    assert after is not None
    assert after < 0.01


def test_a_prediction_far_beyond_all_that_was_measured_is_lost() -> None:
    problem = Problem(sled(1))
    predicted = problem.predicted({})
    assert problem.lost(predicted) == 0.0
    assert problem.lost(1e9 * np.sign(predicted + 1e-9) * np.abs(problem.measured).max()) == 1.0


def test_a_model_whose_starting_values_are_off_is_fitted_and_nothing_is_missing() -> None:
    recorded = [drawn("pendulum", Hidden(), np.random.default_rng(7), np.random.default_rng(s)) for s in (16, 17)]
    fit, other = (simulation("pendulum", each, declared=False, bare=False) for each in recorded)
    far = {"weight": 1.45, "damping": 0.02}
    begun = tuple(replace(p, neutral=far.get(p.name, p.neutral)) for p in fit.parameters)
    fit, other = (replace(each, parameters=begun) for each in (fit, other))
    base, _ = base_of(Problem(fit.with_terms(())))
    assert base.values == pytest.approx({"inertia": 0.05, "damping": 0.08, "weight": 1.2}, rel=0.02)
    assert explain(fit, other, seed=1).verdict.verdict == "nothing"
