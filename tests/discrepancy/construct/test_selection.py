"""A construction whose simulation diverges as soon as one of its causes is taken out."""

from math import isfinite

import numpy as np

from discrepancy.construct.columns import Ports
from discrepancy.construct.selection import Selection
from discrepancy.ports.declared import Act, Arrays, Port, Rows, Signal
from discrepancy.ports.ode import Ode
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.problem import Problem
from discrepancy.search.candidates import Candidate
from discrepancy.search.fit import Fit
from discrepancy.simulation import Channels, Parameter
from discrepancy.values import Neutral
from messages.arrays import FloatArray


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


def _fit(values: dict[str, float], residual: FloatArray) -> Fit:
    return Fit(values, residual, float(np.sum(residual**2)), ("leak_at_store.value",))
