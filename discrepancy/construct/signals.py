"""What the signals at a simulation's ports do, and what a signal added there by itself would change.

To first order a term a φ(x) changes the outputs as the signal φ(x̂) does, x̂ from the simulation without it: the columns
of all terms are had from one integration, whatever they are made of.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.ports.acting import OpenActs, PortActs
from discrepancy.ports.declared import Arrays, PortTerm, Rows
from discrepancy.ports.ode import Ode
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.simulation import Effect, Parameter, Values
from messages.arrays import FloatArray

_GIVEN = "given_signal"
"""What stands in for a term, as an effect: a signal that was worked out beforehand."""


class _Noted:
    """Acts at the ports as `acts` does, and notes the signals handed over."""

    def __init__(self, acts: PortActs) -> None:
        self._acts = acts
        self.signals: dict[str, tuple[FloatArray, ...]] = {}

    def __call__(self, port: str, *signals: FloatArray) -> FloatArray:
        self.signals[port] = signals
        return self._acts(port, *signals)


def signals_at_ports(simulation: PortedSimulation, values: Values) -> dict[str, list[FloatArray]]:
    """Return for each port its signals (n,) at complete `values`."""
    batch = simulation.batch([values])
    model = simulation.stepped
    with np.errstate(all="ignore"):
        if isinstance(model, Ode):
            states, remembered = model.integrated(batch)
            acts = PortActs(batch, batch.shape)
            acts.own = remembered
            noted = _Noted(acts)
            acts.asked(lambda: model.derivative(tuple(states), tuple(batch.inputs), batch.whole_values, noted))
        else:
            acts = OpenActs(batch)
            noted = _Noted(acts)
            acts.asked(lambda: model.model(tuple(batch.inputs), batch.whole_values, noted))
    n = batch.shape[1]
    return {
        port: [np.broadcast_to(np.asarray(signal, dtype=np.float64), (1, n))[0] for signal in rows]
        for port, rows in noted.signals.items()
    }


@dataclass(frozen=True)
class Given:
    """A signal (n,) to be added at a port."""

    port: str
    signal: FloatArray


def responses(simulation: PortedSimulation, values: Values, given: Sequence[Given]) -> FloatArray:
    """Return what the simulation predicts at complete `values` with each of the `given` added alone, (k, n, c)."""
    step_s = 1.0 / simulation.channels.rate_hz
    by_port: dict[str, list[int]] = {}
    for k, each in enumerate(given):
        by_port.setdefault(each.port, []).append(k)
    terms = [_given(port, np.stack([given[k].signal for k in rows]), step_s) for port, rows in by_port.items()]
    key = {port: f"{_GIVEN}_{port}.row" for port in by_port}
    sets: list[Mapping[str, float]] = [dict(values) for _ in given]
    for port, rows in by_port.items():
        for place, k in enumerate(rows, 1):
            sets[k] = {**values, key[port]: float(place)}
    return simulation.with_terms((*simulation.library, *terms)).predicted_many(sets)


def _given(port: str, signals: FloatArray, step_s: float) -> PortTerm:
    """Return a term that adds the row of `signals` (r, n) that its parameter counts, from 1, between samples on the
    line; its own state is the time.
    """
    row = Parameter("row", "1", 0.0, 0.0, float(len(signals) + 1), 1.0)
    effect = Effect(f"{_GIVEN}_{port}", (row,), "", "", "")
    last = signals.shape[1] - 1
    padded = np.concatenate((signals, signals[:, -1:]), axis=1)

    def formula(_signals: Rows, own: Rows, values: Arrays) -> tuple[FloatArray, Rows]:
        rows = values["row"].astype(np.intp) - 1
        at = np.clip(own[0] / step_s, 0.0, last)
        lower = np.floor(at + 1e-9).astype(np.intp)
        share = at - lower
        return (1.0 - share) * padded[rows, lower] + share * padded[rows, lower + 1], [np.ones_like(own[0])]

    return PortTerm(port, effect, formula, memory=1)
