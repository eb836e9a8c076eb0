"""The values that a simulation predicts from: every parameter, neutral where nobody set it, and no misspelt one."""

from collections.abc import Iterator, Mapping

from discrepancy.simulation import Simulation, Values
from messages.arrays import FloatArray
from messages.errors import UserError, unknown_name


class Complete(Mapping[str, float]):
    """A value for every parameter of a simulation. Asked for any other, by `get` or `in` too, it raises UserError."""

    def __init__(self, system: str, values: dict[str, float]) -> None:
        self._system, self._values = system, values

    def __getitem__(self, key: str) -> float:
        """Return the value of one parameter; raises UserError, naming the nearest one, where there is no such one."""
        try:
            return self._values[key]
        except KeyError:
            raise unknown_name(f"{self._system}: parameter {key}", key, self._values) from None

    def __iter__(self) -> Iterator[str]:
        """Return all keys, those of the base model first."""
        return iter(self._values)

    def __len__(self) -> int:
        """Return the number of parameters."""
        return len(self._values)


class Neutral:
    """Every parameter of a simulation at its neutral value.

    Raises UserError where two of base model and effects share a key.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._system = simulation.system
        parameters = [(p.name, p) for p in simulation.parameters]
        parameters += [(effect.qualified(p.name), p) for effect in simulation.effects for p in effect.parameters]
        self._values = {key: p.neutral for key, p in parameters}
        if len(self._values) < len(parameters):
            keys = [key for key, _ in parameters]
            twice = next(key for key in keys if keys.count(key) > 1)
            raise UserError(f"{self._system}: parameter {twice} is there twice; expected a name of its own for each")

    def completed(self, values: Values) -> Complete:
        """Return `values` and all that they leave out; raises UserError, naming the nearest, for an unknown key."""
        for key in values:
            if key not in self._values:
                raise unknown_name(f"{self._system}: parameter {key}", key, self._values)
        return Complete(self._system, {**self._values, **values})

    def mark(self, values: Values) -> frozenset[tuple[str, float]]:
        """Return what tells `values` apart from all that predict otherwise: those that are not neutral."""
        return frozenset(each for each in values.items() if each[1] != self._values.get(each[0]))


def predicted(simulation: Simulation, values: Values) -> FloatArray:
    """Return what `simulation` predicts from `values`, all else neutral; raises UserError for an unknown key."""
    return simulation.predicted(Neutral(simulation).completed(values))
