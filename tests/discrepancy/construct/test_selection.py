"""Constructions whose simulation diverges without one of the causes, or whose intervals say less than their fit."""

from math import isfinite
from types import SimpleNamespace
from typing import cast

import numpy as np

from discrepancy.construct.columns import Ports
from discrepancy.construct.construction import _kept
from discrepancy.construct.selection import Selection
from discrepancy.ports.declared import Act, Arrays, Port, Rows, Signal
from discrepancy.ports.ode import Ode
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.problem import Problem
from discrepancy.search.candidates import Candidate
from discrepancy.search.fit import Fit
from discrepancy.search.search import Found
from discrepancy.simulation import Channels, Parameter
from discrepancy.values import Neutral
from messages.arrays import FloatArray
from tests.bench.linear_bench import Columns, LinearSimulation


def _growing() -> PortedSimulation:
    """Return ẋ = growth·x + u, whose growth is negative, and which is measured with noise."""

    def derivative(state: Rows, inputs: Rows, values: Arrays, act: Act) -> tuple[FloatArray, ...]:
        return (values["growth"] * state[0] + inputs[0] + act("store", state[0]),)

    t_s = 0.5 * np.arange(600, dtype=np.float64)
    noise = np.random.default_rng(1).normal(0.0, 0.01, (len(t_s), 1))
    drive = np.sin(0.1 * t_s) + np.sin(0.031 * t_s)
    model = Ode(start=(0.0,), derivative=derivative, output=(0,))
    port = Port("store", "1/s", "the store", (Signal("level", "1", "level"),))
    growth = Parameter("growth", "1/s", neutral=-0.3, low=-3.0, high=3.0, scale=0.01)
    channels = Channels(t_s, noise, ("level",), drive[:, None], ("drive",))
    whole = PortedSimulation("store", channels, model, (port,), (growth,))
    return PortedSimulation(
        "store",
        Channels(t_s, noise + whole.predicted({}), ("level",), drive[:, None], ("drive",)),
        model,
        (port,),
        (growth,),
    )


def test_without_a_cause_that_it_needs_the_fit_begins_at_the_base_model() -> None:
    whole = _growing()
    at = Neutral(whole).completed({})
    ports = Ports(whole, at)
    made = ports.terms(at)
    whole = whole.with_terms((*whole.library, *(each.term() for each in made)))
    problem = Problem(whole)
    selection = Selection(problem, ports, [whole], made, ("leak_at_store",), {"growth": -0.3}, 1)
    selection._round(selection.base, ())
    leak = Candidate("leak_at_store", ("value",), ("leak_at_store.value",), {}, (), None)
    values = {"growth": 2.5, "leak_at_store.value": 2.8}
    best = problem.residual(values)
    assert not np.isfinite(problem.predicted({"growth": 2.5})).all()
    fit = selection.without(_fit(values, best), leak)
    assert isfinite(fit.chi2)
    assert abs(fit.values["growth"] + 0.3) < 0.01


class _Needed:
    """Stands in for a selection in whose fit χ² rises by `by` without any cause."""

    def __init__(self, by: float) -> None:
        self._by = by

    def rise(self, _best: Fit, _cause: Candidate) -> float:
        return self._by


def test_a_term_that_the_fit_needs_is_kept_and_its_interval_ends_at_neutral() -> None:
    rng = np.random.default_rng(6)
    column = rng.normal(size=(1000, 1))
    measured = 0.01 * column + rng.normal(size=(1000, 1))
    simulation = LinearSimulation(measured, column, library=[Columns("steep", {"p": column})])
    problem = Problem(simulation)
    base = Fit({}, problem.residual({}), 0.0, ())
    best = Fit({"steep.p": 0.01}, problem.residual({"steep.p": 0.01}), 0.0, ("steep.p",))
    causes = (Candidate("steep", ("p",), ("steep.p",), {}, (), None),)
    for by, names, low in ((1000.0, ["steep"], 0.0), (0.0, [], None)):
        found = SimpleNamespace(base=base, best=best, causes=causes)
        models = _kept(problem, cast(Selection, _Needed(by)), cast(Found, found))
        assert [each.effect for each in models.causes] == names
        if low is not None:
            assert models.extended_intervals.of("steep.p")[0] == low


def _fit(values: dict[str, float], residual: FloatArray) -> Fit:
    return Fit(values, residual, float(np.sum(residual**2)), ("leak_at_store.value",))
