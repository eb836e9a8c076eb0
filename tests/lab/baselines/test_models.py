"""The baselines on a mass that is shaken: each does what its name says, and none invents much on clean data."""

import re
from dataclasses import dataclass

import numpy as np
import pytest

from discrepancy.evidence.gain import nrmse
from discrepancy.problem import Problem
from discrepancy.simulation import Channels, Effect, Parameter, Values
from lab.baselines.judged_case import JudgedCase
from lab.baselines.models import Case, parameters_fitted, process_regressed, sparsely_regressed
from lab.hidden.case import Kind
from messages.arrays import FloatArray

RATE_HZ, SAMPLES, NOISE_N = 200.0, 2400, 0.02
DELAY_S, GAIN, BIAS_N, CUBE = 0.004, 0.06, 0.3, 0.08


@dataclass(frozen=True)
class Shaken:
    """A mass moved along sines; the force is measured, with what `hidden` says."""

    seed: int
    hidden: str = ""

    @property
    def system(self) -> str:
        return "shaken"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("mass_kg", "kg", 1.0, 0.1, 10.0, 0.1),)

    @property
    def effects(self) -> tuple[Effect, ...]:
        return ()

    def acceleration(self, late_s: float) -> FloatArray:
        rng = np.random.default_rng(self.seed)
        f_hz, phase = rng.uniform(1.0, 15.0, 12), rng.uniform(0.0, 6.28, 12)
        t_s = np.arange(SAMPLES) / RATE_HZ - late_s
        waves: FloatArray = np.cos(2 * np.pi * np.outer(t_s, f_hz) + phase).sum(axis=1) / 2.0
        return waves

    @property
    def channels(self) -> Channels:
        ideal = self.acceleration(0.0)
        force = 1.7 * self.acceleration(DELAY_S if self.hidden == "instrument" else 0.0)
        if self.hidden == "instrument":
            force = (1.0 + GAIN) * force + BIAS_N
        if self.hidden == "cube":
            force = force + CUBE * ideal**2
        force = force + NOISE_N * np.random.default_rng(self.seed + 1000).standard_normal(SAMPLES)
        t_s = np.arange(SAMPLES) / RATE_HZ
        return Channels(t_s, force[:, None], ("f_n",), ideal[:, None], ("a_mps2",))

    def predicted(self, values: Values) -> FloatArray:
        return values.get("mass_kg", 1.0) * self.acceleration(0.0)[:, None]


def _case(hidden: str) -> Case:
    return Case.of(Problem(Shaken(3, hidden)), Problem(Shaken(4, hidden)))


def _left(case: Case, predicted: FloatArray) -> float:
    return nrmse(case.held, case.held.difference(predicted)) / nrmse(case.held, case.residual_held)


def test_parameter_fitting_finds_delay_and_bias_and_removes_all() -> None:
    case = _case("instrument")
    told = parameters_fitted(case)
    told_values = [re.search(f"{what} of f_n ([-+.0-9]+)", told.says) for what in ("bias", "delay")]
    bias, delay = (float(found[1]) for found in told_values if found is not None)
    assert bias == pytest.approx(BIAS_N, abs=0.01)
    assert delay == pytest.approx(1e3 * DELAY_S, abs=0.02)
    assert _left(case, told.predicted) < 0.1


def test_parameter_fitting_leaves_a_structure_that_it_does_not_have() -> None:
    case = _case("cube")
    assert _left(case, parameters_fitted(case).predicted) > 0.7


def test_nothing_is_made_much_worse_where_nothing_is_hidden() -> None:
    case = _case("")
    assert _left(case, parameters_fitted(case).predicted) < 1.02


def test_sparse_regression_finds_the_square() -> None:
    pytest.importorskip("pysindy")
    case = _case("cube")
    told = sparsely_regressed(case)
    assert "a_mps2^2" in told.says
    assert _left(case, told.predicted) < 0.5
    clean = _case("")
    assert _left(clean, sparsely_regressed(clean).predicted) < 1.05


def test_a_gaussian_process_removes_the_square() -> None:
    pytest.importorskip("sklearn")
    case = _case("cube")
    assert _left(case, process_regressed(case).predicted) < 0.5


def test_shares_are_of_the_excess_over_the_floor() -> None:
    case = JudgedCase("s", Kind.SINGLE, ("gain",), 1, 0.5, 0.3, {"a": 0.4, "b": 0.3, "c": 9.0}, {}, {})
    assert case.has_excess
    assert case.share("a") == pytest.approx((0.25 - 0.16) / (0.25 - 0.09))
    assert case.share("b") == pytest.approx(1.0)
    assert case.share("c") == -1.0
