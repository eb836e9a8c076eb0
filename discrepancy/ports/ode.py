"""Models with ports: differential equations integrated for k sets of parameters side by side, or whole signals.

    ẋ = f(x, u, p),   y = h(x, u, p)                                                                               (1)

by the classical Runge-Kutta method of fourth order (Kutta 1901), a fixed number of steps to a sample. Inputs are held
over a sample, or go straight to the next one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from discrepancy.ports.acting import Batch, OpenActs, PortActs
from discrepancy.ports.declared import Act, Arrays, Rows
from discrepancy.ports.marching import Near, Step, march
from messages.arrays import FloatArray

Equation = Callable[[Rows, Rows, Arrays, Act], Sequence[FloatArray]]
"""From states, inputs, parameters and what acts at the ports: the states' rates, or the outputs."""
Start = Sequence[float] | Callable[[Arrays], Sequence[FloatArray | float]]
"""The states at the first sample, or what gives them from the parameters."""
WholeModel = Callable[[Rows, Arrays, Act], Sequence[FloatArray]]
"""From inputs (k, n), parameters (k, 1) and what acts at the ports: the outputs, each (k, n)."""


@dataclass(frozen=True)
class Ode:
    """A model as differential equations (1): the states at the `start`, or `start(values)` that gives them,
    `derivative(state, inputs, values, act)`, and the `output`: which states, or `output(state, inputs, values, act)`.

    States and inputs come as rows to unpack, `angle, rate = state`; parameters as `values["inertia"]`. `steps` are
    taken for each sample; 0 leaves it to the simulation how many the model needs; `held` says whether an input keeps
    its value until the next sample.
    """

    start: Start
    derivative: Equation
    output: Equation | Sequence[int]
    steps: int = 0
    held: bool = True

    def outputs(self, batch: Batch) -> list[FloatArray]:
        """Return the outputs, each (k, n) or what broadcasts to it."""
        states, own = self.integrated(batch)
        if not callable(self.output):
            return [states[place] for place in self.output]
        acts = PortActs(batch, batch.shape)
        acts.own = own
        with np.errstate(all="ignore"):
            output, values = self.output, batch.whole_values
            return list(acts.asked(lambda: output(tuple(states), tuple(batch.inputs), values, acts)))

    def traced(self, batch: Batch) -> Callable[[Act], FloatArray]:
        """Return what gives the states' rates (s, n) along the first set's trajectory, for anything at the ports."""
        states, _ = self.integrated(batch)

        def rates(act: Act) -> FloatArray:
            found = self.derivative(states[:, :1], batch.inputs[:, :1], batch.whole_values, act)
            return np.stack([np.broadcast_to(row, states[0, :1].shape)[0] for row in found])

        return rates

    def integrated(self, batch: Batch) -> tuple[FloatArray, FloatArray]:
        """Return the states (s, k, n), and those of the terms (memory, k, n)."""
        k, n = batch.shape
        leads = batch.leaders == np.arange(k)
        first = batch if leads.all() else batch.only(np.flatnonzero(leads))
        step, begun = self._stepping(first)
        with np.errstate(all="ignore"):
            path = march(step, begun, n, first.solved.near(first.layout, first.sets, begun, n))
            first.solved.keep(first.layout, first.sets, path)
            if not leads.all():
                rest = np.flatnonzero(~leads)
                near = Near.to(path, step, (np.cumsum(leads) - 1)[batch.leaders[rest]])
                whole = np.empty((len(path), k, n))
                whole[:, leads], whole[:, rest] = path, march(*self._stepping(batch.only(rest)), n, near)
                path = whole
        s = len(path) - batch.memory
        return path[:s], path[s:]

    def _stepping(self, batch: Batch) -> tuple[Step, FloatArray]:
        """Return what takes all states, the terms' own below the model's, one sample on, and those at the first one
        (s + memory, k).
        """
        k = batch.shape[0]
        begun = self.start(batch.values) if callable(self.start) else self.start
        s = len(begun)
        x = np.zeros((s + batch.memory, k, 1))
        for row, value in enumerate(begun):
            x[row] = np.reshape(value, (-1, 1))
        values = batch.whole_values
        if batch.memory:
            act = PortActs(batch, (k, 1))
            act.own, act.begins = x[s:], True
            act.asked(lambda: self.derivative(x[:s], batch.inputs[:, :, :1], values, act))
        acts: dict[int, PortActs] = {}
        steps = self.steps or 1
        h = batch.step_s / steps

        def step(x: FloatArray, first: int) -> FloatArray:
            w = x.shape[2]
            if w not in acts:
                acts[w] = PortActs(batch, (k, w))
            act = acts[w]

            def rates(x: FloatArray, u: FloatArray) -> FloatArray:
                out = np.zeros_like(x)
                act.own, act.rates = x[s:], out[s:]
                for row, rate in enumerate(act.asked(lambda: self.derivative(x[:s], u, values, act))):
                    out[row] = rate
                return out

            u = batch.inputs[:, :, first : first + w]
            slope = 0.0 if self.held else (batch.inputs[:, :, first + 1 : first + w + 1] - u) / steps
            for _ in range(steps):
                x = runge_kutta(rates, x, u, slope, h)
                u = u + slope
            return x

        return step, x[:, :, 0]


def runge_kutta(
    rates: Callable[[FloatArray, FloatArray], FloatArray],
    x: FloatArray,
    u: FloatArray,
    slope: FloatArray | float,
    h: float,
) -> FloatArray:
    """Return the states a step `h` later, the inputs going from `u` to `u` + `slope`."""
    half = u + 0.5 * slope
    k1 = rates(x, u)
    k2 = rates(x + 0.5 * h * k1, half)
    k3 = rates(x + 0.5 * h * k2, half)
    k4 = rates(x + h * k3, u + slope)
    return x + (h / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)


@dataclass(frozen=True)
class Whole:
    """A model as a function of whole signals, `model(inputs, values, act)`; what acts at its ports does so on whole
    signals too.
    """

    model: WholeModel
    steps: ClassVar[int] = 1
    held: ClassVar[bool] = False

    def outputs(self, batch: Batch) -> list[FloatArray]:
        """Return the outputs, each (k, n) or what broadcasts to it."""
        with np.errstate(all="ignore"):
            acts = OpenActs(batch)
            return list(acts.asked(lambda: self.model(tuple(batch.inputs), batch.whole_values, acts)))

    def traced(self, batch: Batch) -> Callable[[Act], FloatArray]:
        """Return what gives the first set's outputs (c, n), for anything at the ports."""
        shape = (1, batch.shape[1])

        def outputs(act: Act) -> FloatArray:
            found = self.model(batch.inputs[:, :1], batch.whole_values, act)
            return np.stack([np.broadcast_to(row, shape)[0] for row in found])

        return outputs
