"""A simulation with a part of its library: what a researcher leaves out cannot be named."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from discrepancy.simulation import Channels, Effect, Parameter, Simulation, TakesLibrary, Values, predicted_many
from discrepancy.values import Neutral
from messages.arrays import FloatArray
from messages.errors import UserError


@dataclass(frozen=True)
class Restricted:
    """A simulation whose effects are those of `whole` but for the names in `left_out`."""

    whole: Simulation
    left_out: frozenset[str]

    @property
    def system(self) -> str:
        """Return the system's name."""
        return self.whole.system

    @property
    def channels(self) -> Channels:
        """Return what was measured."""
        return self.whole.channels

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Return the base model's own parameters."""
        return self.whole.parameters

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Return what is left of the library."""
        return tuple(effect for effect in self.whole.effects if effect.name not in self.left_out)

    def predicted(self, values: Values) -> FloatArray:
        """Return what should have been measured, what is left out being neutral."""
        return self.whole.predicted(self._neutral.completed(values))

    def predicted_many(self, sets: Sequence[Values]) -> FloatArray:
        """Return what should have been measured from each of the `sets`, (k, n, c)."""
        return np.stack([*predicted_many(self.whole, [self._neutral.completed(values) for values in sets])])

    def like(self, fitted: Simulation) -> Simulation:
        """Return the simulation with the effects of the one `fitted`, where its own depend on its recording."""
        whole = fitted.whole if isinstance(fitted, Restricted) else fitted
        return replace(self, whole=self.whole.like(whole)) if isinstance(self.whole, TakesLibrary) else self

    @cached_property
    def _neutral(self) -> Neutral:
        return Neutral(self.whole)


def without(simulation: Simulation, names: Collection[str]) -> Simulation:
    """Return `simulation` without the effects `names`, itself if there are none."""
    return Restricted(simulation, frozenset(names)) if names else simulation


def check_names(option: str, names: Collection[str], simulation: Simulation) -> None:
    """Raise UserError, naming `option`, if one of `names` is no effect of the simulation."""
    known = [effect.name for effect in simulation.effects]
    for name in names:
        if name not in known:
            raise UserError(f"{option} {name}: not in the library of {simulation.system}; expected {', '.join(known)}")
