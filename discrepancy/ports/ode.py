"""Models with ports: differential equations integrated for k sets of parameters side by side, or whole signals.

    ẋ = f(x, u, p),   y = h(x, u, p)                                                                               (1)

by the classical Runge-Kutta method of fourth order (Kutta 1901), a fixed number of steps to a sample. Inputs are held
over a sample, or go straight to the next one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.ports.acting import Batch, OpenActs, PortActs
from discrepancy.ports.declared import Act, Arrays, Rows
from messages.arrays import FloatArray

Equation = Callable[[Rows, Rows, Arrays, Act], Sequence[FloatArray]]
"""From states, inputs, parameters and what acts at the ports: the states' rates, or the outputs."""
Start = Callable[[Arrays], Sequence[FloatArray | float]]
"""From the parameters: the states at the first sample."""
WholeModel = Callable[[Rows, Arrays, Act], Sequence[FloatArray]]
"""From inputs (k, n), parameters (k, 1) and what acts at the ports: the outputs, each (k, n)."""


@dataclass(frozen=True)
class Ode:
    """A model as differential equations (1): `start(values)`, `derivative(state, inputs, values, act)` and
    `output(state, inputs, values, act)`.

    States and inputs come as rows to unpack, `angle, rate = state`; parameters as `values["inertia"]`. `steps` are
    taken for each sample; `held` says whether an input keeps its value until the next sample.
    """

    start: Start
    derivative: Equation
    output: Equation
    steps: int = 1
    held: bool = True

    def outputs(self, batch: Batch) -> list[FloatArray]:
        """Return the outputs, each (k, n) or what broadcasts to it."""
        states, own = self.integrated(batch)
        acts = PortActs(batch, batch.shape)
        acts.own = own
        with np.errstate(all="ignore"):
            return list(self.output(tuple(states), tuple(batch.inputs), batch.whole_values, acts))

    def integrated(self, batch: Batch) -> tuple[FloatArray, FloatArray]:
        """Return the states (s, k, n), and those of the terms (memory, k, n)."""
        k, n = batch.shape
        begun = self.start(batch.values)
        s = len(begun)
        x = np.zeros((s + batch.memory, k))
        for row, value in enumerate(begun):
            x[row] = value
        acts = PortActs(batch, (k,))

        def rates(x: FloatArray, u: FloatArray) -> FloatArray:
            out = np.zeros_like(x)
            acts.own, acts.rates = x[s:], out[s:]
            for row, rate in enumerate(self.derivative(x[:s], u, batch.values, acts)):
                out[row] = rate
            return out

        at = np.ascontiguousarray(np.moveaxis(batch.inputs, 2, 0))
        path = np.empty((n, s + batch.memory, k))
        h = batch.step_s / self.steps
        with np.errstate(all="ignore"):
            for i in range(n):
                path[i] = x
                u = at[i]
                slope = np.zeros_like(u) if self.held or i + 1 == n else (at[i + 1] - u) / self.steps
                for _ in range(self.steps if i + 1 < n else 0):
                    x = runge_kutta(rates, x, u, slope, h)
                    u = u + slope
        path = np.moveaxis(path, 0, 2)
        return path[:s], path[s:]


def runge_kutta(
    rates: Callable[[FloatArray, FloatArray], FloatArray], x: FloatArray, u: FloatArray, slope: FloatArray, h: float
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

    def outputs(self, batch: Batch) -> list[FloatArray]:
        """Return the outputs, each (k, n) or what broadcasts to it."""
        with np.errstate(all="ignore"):
            return list(self.model(tuple(batch.inputs), batch.whole_values, OpenActs(batch)))
