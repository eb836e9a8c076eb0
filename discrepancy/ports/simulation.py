"""A simulation with ports: a model and what was measured; every effect of its library acts at a place of the model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from discrepancy.ports.acting import Batch, Named, at_ports, leaders, on_signals
from discrepancy.ports.declared import Port, Term
from discrepancy.ports.generic import generic_terms
from discrepancy.ports.ode import Ode, Whole
from discrepancy.ports.trajectories import Trajectories
from discrepancy.simulation import Channels, Effect, Parameter, Simulation, Values
from messages.arrays import FloatArray

_MOST_SIDE_BY_SIDE = 32
"""Sets of parameters in one pass: more would not be faster, and take memory. Terms with memory have passes of their
own, since their states are carried along in every set."""
_STEPS = (1, 2, 4)
"""To a sample: how many are tried where a model leaves them open, and twice the last."""
_EXACT = 1e-3
"""Of an output's deviation: what the integrator may be off by, a fraction of most sensors' noise."""
_BETTER = 0.25
"""Of an error: what is left of it with half as long steps, or they are not worth their time; a sixteenth, where all is
smooth.
"""


@dataclass(frozen=True)
class PortedSimulation:
    """A `Simulation` made of a model with ports; `terms` are what may be missing at them and on its signals, by
    default all of the generic library that have the signals they need.

    Raises UserError where the model diverges from its own starting values, or does not use a port that it declares.
    """

    system: str
    channels: Channels
    model: Ode | Whole
    ports: tuple[Port, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    terms: tuple[Term, ...] | None = None

    @cached_property
    def library(self) -> tuple[Term, ...]:
        """Return the terms; by default those that can act at such places, sized by what the recording spans."""
        return generic_terms(self) if self.terms is None else self.terms

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Return the effect of each term."""
        return tuple(term.effect for term in self.library)

    def with_terms(self, terms: Sequence[Term]) -> "PortedSimulation":
        """Return the simulation with these terms as its library."""
        return replace(self, terms=tuple(terms), model=self.stepped)

    @cached_property
    def stepped(self) -> Ode | Whole:
        """Return the model with the `steps` that it needs, if it leaves them open: half as long ones would change
        no output by more than `_EXACT` of its deviation, or are hardly better, as where a model has kinks.
        """
        model = self.model
        if not isinstance(model, Ode) or model.steps:
            return model

        def predicted(steps: int) -> FloatArray:
            return replace(self, terms=(), model=replace(model, steps=steps)).predicted({})

        off, before = np.inf, predicted(1)
        for steps in _STEPS:
            after = predicted(2 * steps)
            last, off = off, _apart(before, after)
            if off <= _EXACT:
                return replace(model, steps=steps)
            if off > _BETTER * last:
                return replace(model, steps=steps // 2)
            before = after
        return replace(model, steps=2 * _STEPS[-1])

    def like(self, fitted: Simulation) -> "PortedSimulation":
        """Return the simulation with the library of the `fitted` one, whose sizes and constants its recording told."""
        return self.with_terms(fitted.library) if isinstance(fitted, PortedSimulation) else self

    def predicted(self, values: Values) -> FloatArray:
        """Return what should have been measured, (n, c)."""
        found: FloatArray = self.predicted_many([values])[0]
        return found

    def predicted_many(self, sets: Sequence[Values]) -> FloatArray:
        """Return what should have been measured from each of k `sets` of parameters, (k, n, c), side by side.

        Raises ValueError where the model gives another number of outputs than there are channels.
        """
        out = np.empty((len(sets), len(self.channels.t_s), len(self.channels.names)))
        remembering = [at_ports(self.library, [values])[1] > 0 for values in sets]
        for alike in (False, True):
            rows = [k for k, remembers in enumerate(remembering) if remembers == alike]
            for first in range(0, len(rows), _MOST_SIDE_BY_SIDE):
                part = rows[first : first + _MOST_SIDE_BY_SIDE]
                out[part] = self._side_by_side([sets[k] for k in part])
        return out

    def batch(self, sets: Sequence[Values]) -> Batch:
        """Return what predictions from these `sets` are made from, side by side."""
        inputs = self._changed("input", self.channels.input_names, list(self.channels.inputs.T), sets)
        found, memory = at_ports(self.library, sets)
        values = Named({p.name: np.array([each.get(p.name, p.neutral) for each in sets]) for p in self.parameters})
        return Batch(
            1.0 / self.channels.rate_hz,
            inputs,
            values,
            self.ports,
            found,
            memory,
            leaders(sets),
            tuple(self._chosen(each) for each in sets),
            self._solved,
        )

    @cached_property
    def _solved(self) -> Trajectories:
        return Trajectories()

    @cached_property
    def _neutral(self) -> dict[str, float]:
        """Return the neutral value of each effect's parameter."""
        return {effect.qualified(p.name): p.neutral for effect in self.effects for p in effect.parameters}

    def _chosen(self, values: Values) -> dict[str, float]:
        """Return the model's own parameters, and those of effects that are not neutral."""
        own = {p.name: values.get(p.name, p.neutral) for p in self.parameters}
        return own | {key: values[key] for key, neutral in self._neutral.items() if values.get(key, neutral) != neutral}

    def _side_by_side(self, sets: Sequence[Values]) -> FloatArray:
        k, n, c = len(sets), len(self.channels.t_s), len(self.channels.names)
        outputs = self.stepped.outputs(self.batch(sets))
        if len(outputs) != c:
            raise ValueError(f"{self.system}: the model returned {len(outputs)} outputs; expected {c}")
        return np.moveaxis(self._changed("output", self.channels.names, outputs, sets).reshape(c, k, n), 0, 2)

    def _changed(
        self, side: str, names: Sequence[str], rows: Sequence[FloatArray], sets: Sequence[Values]
    ) -> FloatArray:
        """Return signals (s, k, n) of one side, from rows of (k, n) or (n,), as the terms there change them."""
        signals = np.empty((len(names), len(sets), len(self.channels.t_s)))
        for signal, row in zip(signals, rows, strict=True):
            signal[:] = row
        with np.errstate(all="ignore"):
            for each in on_signals(self.library, side, sets):
                place = names.index(each.term.channel)
                here = [signal[each.where] for signal in signals]
                signals[place, each.where] = each.term.formula(here, self.channels, each.values)
        return signals


def _apart(found: FloatArray, other: FloatArray) -> float:
    """Return by how much two predictions (n, c) of all outputs differ at most, RMS, of the other's deviation; infinite
    where one is not finite.
    """
    if not (np.isfinite(found).all() and np.isfinite(other).all()):
        return np.inf
    spread = np.maximum(other.std(axis=0), np.finfo(float).tiny)
    return float((np.sqrt(np.mean((found - other) ** 2, axis=0)) / spread).max())
