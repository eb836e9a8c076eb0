"""Causes that gain only together, in slow noise that nobody knows: two tanks of which the lower one is seen."""

from dataclasses import replace

import numpy as np
import pytest

from discrepancy.evidence.whitening import LOADING, whitening
from discrepancy.own_simulation import OwnSimulation
from discrepancy.problem import Problem
from discrepancy.search.candidates import Candidate
from discrepancy.search.fit import Fit
from discrepancy.search.scores import threshold
from discrepancy.search.search import Search
from discrepancy.search.simulated import CauseSet, SimulatedSearch, distinct
from discrepancy.simulation import Channels, Effect, Parameter, Values
from messages.arrays import FloatArray

_N = 600
_TRUE = {"pump": 0.12, "upper": 0.08, "lower": 0.09}
_OVER = {"over_upper.limit": 4.0, "over_lower.limit": 3.5}
_INTO = 0.6


def _overflow(name: str) -> Effect:
    limit = Parameter("limit", "V", np.inf, -1.0, 12.0, 0.02, own_bounds=True)
    slope = Parameter("slope", "1", 0.3, 0.003, 0.5, 0.01)
    return Effect(name, (limit, slope), "", "", "", starts=tuple({"limit": at, "slope": 0.3} for at in (3.0, 5.0, 7.0)))


def _added(name: str, scale: float) -> Effect:
    return Effect(name, (Parameter("value", "1", 0.0, -1.0, 1.0, scale),), "", "", "")


_EFFECTS = (
    _overflow("over_upper"),
    _overflow("over_lower"),
    _added("leak", 1e-3),
    _added("constant", 1e-3),
    _added("offset", 1e-2),
    _added("drift", 1e-3),
)
_NAMES = [each.name for each in _EFFECTS]


def _level(inflow: FloatArray, values: Values) -> FloatArray:
    told = {f"{each.name}.{p.name}": p.neutral for each in _EFFECTS for p in each.parameters} | dict(values.items())
    upper, lower, seen = 2.0, 2.0, []
    for u in inflow.tolist():
        seen.append(lower)
        over = told["over_upper.slope"] * max(upper - told["over_upper.limit"], 0.0)
        lost = told["over_lower.slope"] * max(lower - told["over_lower.limit"], 0.0)
        lost += told["leak.value"] * lower - told["constant.value"]
        between, out = (told[name] * max(x, 0.0) ** 0.5 for name, x in (("upper", upper), ("lower", lower)))
        upper, lower = upper + told["pump"] * u - between - over, lower + between - out - lost + _INTO * over
    return np.array(seen) + told["offset.value"] + told["drift.value"] * np.arange(_N) / _N


def _tanks(seed: int, hidden: Values) -> Problem:
    rng = np.random.default_rng(seed)
    turns = rng.uniform(1.0, 7.0, 6) / _N
    waves = np.sin(2.0 * np.pi * np.outer(np.arange(_N), turns) + rng.uniform(0.0, 6.3, 6)).sum(axis=1)
    inflow = 2.0 + 0.9 * waves / waves.std()
    noise = np.zeros(_N)
    for k in range(1, _N):
        noise[k] = 0.98 * noise[k - 1] + rng.normal(0.0, 0.02)
    level = _level(inflow, {**_TRUE, **hidden}) + noise + rng.normal(0.0, 0.01, _N)
    channels = Channels(np.arange(_N, dtype=np.float64), level[:, None], ("level",), inflow[:, None], ("inflow",))
    base = tuple(Parameter(name, "1", 0.1, 0.005, 1.0, 1e-3) for name in _TRUE)
    return Problem(OwnSimulation("tanks", channels, lambda values: _level(inflow, values)[:, None], _EFFECTS, base))


def _search(problem: Problem) -> tuple[list[str], SimulatedSearch]:
    """Return what is found one by one, and the search for what gains together."""
    search = Search(problem, _NAMES, 1)
    found = search.found()
    alone = [each.effect for each in found.causes]
    return alone, SimulatedSearch(problem, search.refits, _NAMES, threshold(found.chance))


@pytest.mark.long
@pytest.mark.parametrize("seed", [2, 3])
def test_causes_are_found_that_one_by_one_are_not(seed: int) -> None:
    alone, search = _search(_tanks(seed, _OVER))
    found = search.found()
    assert set(alone) != {"over_upper", "over_lower"}
    assert found.effects == {"over_upper", "over_lower"}
    assert found.fit.values["over_lower.limit"] == pytest.approx(3.5, abs=0.3)
    intervals = search.intervals(found)
    low, high = intervals.of("over_lower.limit")
    assert low < 3.5 < high
    assert all(search.rise(found, cause) > 50.0 for cause in found.causes)


@pytest.mark.long
def test_slow_noise_alone_has_no_cause() -> None:
    _, search = _search(_tanks(4, {}))
    assert search.found().causes == ()


def test_of_effects_that_say_the_same_the_first_is_taken_whatever_the_last_bits_are() -> None:
    residual = np.sin(np.arange(50.0))[None]

    def told(name: str, cost: float, change: float = 0.0) -> CauseSet:
        fit = Fit({}, residual + change * np.cos(np.arange(50.0)), 0.0, ("a",))
        return CauseSet(fit, (Candidate(name, (), (), {}, (), None),), cost)

    order = {"first": 0, "second": 1}
    for cost in (-1.0 - 1e-12, -1.0 + 1e-12):
        kept = distinct([told("second", -1.0), told("first", cost)], order)
        assert [each.effects for each in kept] == [{"first"}]
    assert len(distinct([told("second", -1.0), told("first", -1.0, 0.5)], order)) == 2


def test_a_colour_comes_by_degrees() -> None:
    rng = np.random.default_rng(6)
    slow = np.cumsum(rng.normal(size=(1, _N)), axis=1)
    valid = np.ones(slow.shape, bool)
    grown = [float(np.abs(whitening(slow, valid, each).kernels[0, 1:]).sum()) for each in (100.0, 1.0, 1e-2, LOADING)]
    assert grown == sorted(grown)
    assert grown[0] < 0.5 * grown[-1]
    assert np.array_equal(whitening(slow, valid).kernels, whitening(slow, valid, LOADING).kernels)


def test_a_cause_on_a_bound_that_is_not_its_own_is_not_believed() -> None:
    within, beyond = (_tanks(2, {"leak.value": 0.02}) for _ in range(2))
    beyond.parameters["leak.value"] = replace(beyond.parameters["leak.value"], low=-0.015, high=0.015)
    for problem, named in ((within, True), (beyond, False)):
        search = SimulatedSearch(problem, Search(problem, ["leak"], 1).refits, ["leak"], 0.0)
        assert ("leak" in search.found().effects) is named
