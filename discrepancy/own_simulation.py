"""Anybody's simulation: what was measured, a function that predicts it, and the effects that may be missing in it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from discrepancy.simulation import Channels, Effect, Parameter, Values
from messages.arrays import FloatArray


@dataclass(frozen=True)
class OwnSimulation:
    """A `Simulation` made of a function: `model(values)` returns what should have been measured, (n, c).

    `values` holds every parameter, those of an effect as `effect.parameter`: neutral ones are filled in and unknown
    ones refused before the function is called. To read one that is in no effect raises UserError with the nearest.
    """

    system: str
    channels: Channels
    model: Callable[[Values], FloatArray]
    effects: tuple[Effect, ...]
    parameters: tuple[Parameter, ...] = ()

    def predicted(self, values: Values) -> FloatArray:
        """Return what should have been measured, (n, c); raises ValueError if the function returns another shape."""
        found = np.asarray(self.model(values), dtype=np.float64)
        if found.shape != self.channels.values.shape:
            raise ValueError(f"{self.system}: the model returned {found.shape}; expected {self.channels.values.shape}")
        return found
