"""A simulation with ports: a model and what was measured; every effect of its library acts at a place of the model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from discrepancy.ports.acting import Batch, Named, at_ports, on_signals
from discrepancy.ports.declared import Port, Term
from discrepancy.ports.ode import Ode, Whole
from discrepancy.simulation import Channels, Effect, Parameter, Values
from messages.arrays import FloatArray

_MOST_SIDE_BY_SIDE = 64
"""Sets of parameters in one pass: more would not be faster, and take memory."""


@dataclass(frozen=True)
class PortedSimulation:
    """A `Simulation` made of a model with ports; `terms` are what may be missing at them and on its signals."""

    system: str
    channels: Channels
    model: Ode | Whole
    ports: tuple[Port, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    terms: tuple[Term, ...] = ()

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Return the library: the effect of each term."""
        return tuple(term.effect for term in self.terms)

    def with_terms(self, terms: Sequence[Term]) -> "PortedSimulation":
        """Return the simulation with these terms as its library."""
        return replace(self, terms=tuple(terms))

    def predicted(self, values: Values) -> FloatArray:
        """Return what should have been measured, (n, c)."""
        found: FloatArray = self.predicted_many([values])[0]
        return found

    def predicted_many(self, sets: Sequence[Values]) -> FloatArray:
        """Return what should have been measured from each of k `sets` of parameters, (k, n, c), side by side.

        Raises ValueError where the model gives another number of outputs than there are channels.
        """
        parts = [sets[a : a + _MOST_SIDE_BY_SIDE] for a in range(0, len(sets), _MOST_SIDE_BY_SIDE)]
        return np.concatenate([self._side_by_side(part) for part in parts])

    def _side_by_side(self, sets: Sequence[Values]) -> FloatArray:
        k, n, c = len(sets), len(self.channels.t_s), len(self.channels.names)
        inputs = self._changed("input", self.channels.input_names, list(self.channels.inputs.T), sets)
        found, memory = at_ports(self.terms, sets)
        values = Named({p.name: np.array([each.get(p.name, p.neutral) for each in sets]) for p in self.parameters})
        batch = Batch(1.0 / self.channels.rate_hz, inputs, values, self.ports, found, memory)
        outputs = self.model.outputs(batch)
        if len(outputs) != c:
            raise ValueError(f"{self.system}: the model returned {len(outputs)} outputs; expected {c}")
        return np.moveaxis(self._changed("output", self.channels.names, outputs, sets).reshape(c, k, n), 0, 2)

    def _changed(
        self, side: str, names: Sequence[str], rows: Sequence[FloatArray], sets: Sequence[Values]
    ) -> FloatArray:
        """Return signals (s, k, n) of one side, from rows of (k, n) or (n,), as the terms there change them."""
        t_s = self.channels.t_s
        signals = np.empty((len(names), len(sets), len(t_s)))
        for signal, row in zip(signals, rows, strict=True):
            signal[:] = row
        with np.errstate(all="ignore"):
            for each in on_signals(self.terms, side, sets):
                place = names.index(each.term.channel)
                here = [signal[each.where] for signal in signals]
                signals[place, each.where] = each.term.formula(here, t_s, each.values)
        return signals
