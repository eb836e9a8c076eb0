"""Several recordings of one system as one problem: one set of parameters, but for what belongs to each recording.

The recordings stand one after another in the arrays (c, n), n the sum of their lengths. Nothing reaches across their
ends: each is predicted, filled and made white by itself, at its own rate. A parameter that belongs to each recording
has the key `name` for the first and `name@p` for the p-th.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import numpy as np

from discrepancy.evidence.whitening import LOADING, JointWhitening, whitening
from discrepancy.problem import Problem
from discrepancy.simulation import Parameter, Simulation, Values
from discrepancy.values import Complete
from messages.arrays import BoolArray, FloatArray
from messages.errors import UserError

OF = "@"
"""Between a parameter's name and the number of the recording that it belongs to."""


def joined(problems: Sequence[Problem]) -> Problem:
    """Return one problem of all, the only one itself."""
    return problems[0] if len(problems) == 1 else JointProblem(problems)


def check_one_system(simulations: Sequence[Simulation], names: Sequence[str]) -> None:
    """Raise UserError, by a recording's name, where channels, parameters or effects are not those of the first."""
    for simulation, name in zip(simulations[1:], names[1:], strict=True):
        _check_alike(simulations[0], simulation, name)


def plain(key: str) -> str:
    """Return a key as a simulation knows it, whichever recording it belongs to."""
    return key.partition(OF)[0]


class JointProblem(Problem):
    """The residuals of several recordings, one after another.

    Channels, rate and effects are told as of the first.
    """

    def __init__(self, parts: Sequence[Problem]) -> None:
        first = parts[0]
        self._parts = tuple(parts)
        self.continued = first.continued
        self.simulation, self.channels, self.rate_hz = first.simulation, first.channels, first.rate_hz
        known = [part.noise for part in parts]
        self.noise = None if any(each is None or not each.whole for each in known) else first.noise
        self.effects = first.effects
        own = {
            f"{name}{OF}{place}": part.parameters[name] for place, part in enumerate(parts[1:], 2) for name in part.own
        }
        shared = {name: first.parameters[name] for name in first.base}
        self.base = (*shared, *own)
        self.own = (*first.own, *own)
        effects = {key: p for key, p in first.parameters.items() if key not in shared}
        self.parameters: dict[str, Parameter] = {**shared, **own, **effects}
        self._edges = tuple(np.cumsum([0, *(part.n for part in parts)]).tolist())
        self.c, self.n = first.c, self._edges[-1]
        self.measured = np.concatenate([part.measured for part in parts], axis=1)
        self._join()

    @property
    def parts(self) -> tuple[Problem, ...]:
        """Return the recordings one by one."""
        return self._parts

    @property
    def edges(self) -> tuple[int, ...]:
        """Return where each recording begins, and where the last one ends."""
        return self._edges

    def values_of(self, part: int, values: Values) -> Values:
        """Return `values` as the recording `part` takes them."""
        own = {name: values[key] for name in self._parts[part].own if (key := _key(name, part)) in values}
        return {**{key: value for key, value in values.items() if plain(key) not in self._parts[part].own}, **own}

    def whitening(self, residual: FloatArray, loading: float = LOADING) -> JointWhitening:
        """Return the whitening under which `residual` (c, n) is unit noise, each recording by itself, with white noise
        of the share `loading` of its power beside it.
        """
        stretches = [(part.valid, np.ascontiguousarray(residual[:, a:b])) for part, (a, b) in self._stretches()]
        own = [whitening(left, valid, loading) for valid, left in stretches]
        return JointWhitening(own, self.edges)

    def completed(self, values: Values) -> Complete:
        """Return `values` of the first recording with all that they leave out at neutral."""
        return self._parts[0].completed(self.values_of(0, values))

    def predicted(self, values: Values) -> FloatArray:
        """Return what should have been measured, (c, n); raises UserError where `values` hold an unknown key."""
        return np.concatenate(
            [part.predicted(self.values_of(place, values)) for place, part in enumerate(self._parts)], axis=1
        )

    def predicted_many(self, sets: Sequence[Values]) -> Iterator[FloatArray]:
        """Yield what should have been measured, (c, n), from each of the `sets`, side by side where that is faster.

        Sets that differ only in what belongs to other recordings are predicted once.
        """
        by_part: list[list[FloatArray]] = []
        for place, part in enumerate(self._parts):
            asked = [self.values_of(place, values) for values in sets]
            marks = [tuple(sorted(each.items())) for each in asked]
            different = dict(zip(marks, asked, strict=True))
            found = dict(zip(different, part.predicted_many(list(different.values())), strict=True))
            by_part.append([found[mark] for mark in marks])
        for rows in zip(*by_part, strict=True):
            yield np.concatenate(rows, axis=1)

    def lost(self, predicted: FloatArray) -> float:
        """Return the share of the compared samples that a prediction (c, n) cannot give, of the recording with most."""
        return max(part.lost(predicted[:, a:b]) for part, (a, b) in self._stretches())

    def filled(self, values: FloatArray) -> FloatArray:
        """Return `values` (c, n) with what is missing on the line between its neighbours of the same recording."""
        return np.concatenate(
            [part.filled(np.ascontiguousarray(values[:, a:b])) for part, (a, b) in self._stretches()], axis=1
        )

    def narrow(self, finite: BoolArray) -> None:
        """Take samples (c, n) out that some prediction could not give."""
        for part, (a, b) in self._stretches():
            part.narrow(finite[:, a:b])
        self._join()

    def _join(self) -> None:
        self.valid = np.concatenate([part.valid for part in self._parts], axis=1)
        self.reach = np.max([part.reach for part in self._parts], axis=0)

    def _stretches(self) -> Iterator[tuple[Problem, tuple[int, int]]]:
        return zip(self._parts, pairwise(self._edges), strict=True)


def _key(name: str, part: int) -> str:
    return f"{name}{OF}{part + 1}" if part else name


def _check_alike(first: Simulation, other: Simulation, name: str) -> None:
    named: tuple[tuple[str, Callable[[Simulation], Sequence[str]]], ...] = (
        ("the system is", lambda simulation: [simulation.system]),
        ("the channels are", lambda simulation: simulation.channels.names),
        ("the inputs are", lambda simulation: simulation.channels.input_names),
        ("the parameters are", lambda simulation: [p.name for p in simulation.parameters]),
        ("the effects are", lambda simulation: [e.qualified(p.name) for e in simulation.effects for p in e.parameters]),
    )
    for what, names in named:
        here, there = list(names(other)), list(names(first))
        if here != there:
            apart = [each for each in (*here, *there) if (each in here) != (each in there)] or here
            raise UserError(f"{name}: {what} not those of the first ({', '.join(apart[:3])}); expected one system")
