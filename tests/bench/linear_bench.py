"""Simulations that are sums of fixed columns, for which least squares gives the exact answer, and how far a count of
draws may be from what is expected.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import signal, stats

from discrepancy.simulation import Channels, Effect, Parameter, Values
from messages.arrays import FloatArray

FALSE_FAILURE = 1e-4
"""Probability at which a correct program may fail a test of chance under another seed."""
SCALE = 1e-3
"""Of all parameters: columns of unit power beneath unit noise are found far above it."""


@dataclass(frozen=True)
class Columns:
    """An effect of a linear simulation: what each of its parameters adds, (n, c); `bounds` apply to all of them."""

    name: str
    columns: Mapping[str, FloatArray]
    bounds: tuple[float, float] = (-1e6, 1e6)
    choices: tuple[tuple[str, ...], ...] = ()
    starts: tuple[Values, ...] = ()

    @property
    def effect(self) -> Effect:
        return Effect(
            self.name,
            tuple(_parameter(name, self.bounds) for name in self.columns),
            "",
            "",
            "",
            self.choices,
            self.starts,
        )


@dataclass(frozen=True)
class LinearSimulation:
    """Predicts the sum of all parameters, each times its column (n, c)."""

    measured: FloatArray
    inputs: FloatArray
    base: Mapping[str, FloatArray] = field(default_factory=dict)
    library: Sequence[Columns] = ()
    noise_std: FloatArray | None = None
    rate_hz: float = 100.0
    system: str = "linear"

    @property
    def channels(self) -> Channels:
        n, c = self.measured.shape
        t_s = np.arange(n) / self.rate_hz
        names = tuple(f"y{row}" for row in range(c))
        inputs = tuple(f"u{row}" for row in range(self.inputs.shape[1]))
        return Channels(t_s, self.measured, names, self.inputs, inputs, self.noise_std)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(_parameter(name, (-1e6, 1e6)) for name in self.base)

    @property
    def effects(self) -> tuple[Effect, ...]:
        return tuple(each.effect for each in self.library)

    def predicted(self, values: Values) -> FloatArray:
        out = np.zeros_like(self.measured)
        for name, column in self.base.items():
            out += values[name] * column
        for each in self.library:
            for name, column in each.columns.items():
                out += values[f"{each.name}.{name}"] * column
        return out


def _parameter(name: str, bounds: tuple[float, float]) -> Parameter:
    return Parameter(name, "", 0.0, *bounds, SCALE)


def autoregressive(rng: np.random.Generator, shape: tuple[int, ...], coefficients: Sequence[float]) -> FloatArray:
    """Return noise r_t = Σ a_i r_{t−i} + e_t with unit innovations e along the last axis, after its beginning."""
    begun = 4000 if max(np.abs(coefficients), default=0.0) > 0.95 else 400
    white = rng.normal(size=(*shape[:-1], shape[-1] + begun))
    return np.asarray(signal.lfilter([1.0], [1.0, *(-a for a in coefficients)], white)[..., begun:])


def likely_counts(draws: int, probability: float, failure: float = FALSE_FAILURE) -> tuple[int, int]:
    """Return the least and the largest count of events of this `probability`; others are less likely than `failure`."""
    law = stats.binom(draws, probability)
    return int(law.ppf(failure / 2.0)), int(law.isf(failure / 2.0))
