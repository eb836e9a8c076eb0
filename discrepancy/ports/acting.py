"""The terms that act in a batch of k sets of parameters: which sets each acts in, and what it is given there."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from discrepancy.ports.declared import Arrays, Elsewhere, Port, PortTerm, Rows, SignalTerm, Term
from discrepancy.ports.trajectories import Trajectories
from discrepancy.simulation import Effect, Values
from messages.arrays import FloatArray, IntArray
from messages.errors import UserError, unknown_name

T = TypeVar("T")

_MOST_APART = 2
"""Parameters in which sets differ that are moved from the same values, each along one."""

Where = slice | IntArray
"""Of k sets of parameters, those in which a term acts."""


@dataclass(frozen=True)
class PortActing:
    """A term at a port, the sets `where` it acts, its parameters (k,) there, and which of all terms' states it owns."""

    term: PortTerm
    where: Where
    values: Arrays
    own: slice

    def only(self, rows: IntArray, k: int) -> "PortActing | None":
        """Return the term where it acts in some `rows` of the k sets, None where in none."""
        acts = np.zeros(k, bool)
        acts[self.where] = True
        place = np.where(acts, np.cumsum(acts) - 1, -1)
        kept = np.flatnonzero(place[rows] >= 0)
        if not len(kept):
            return None
        here = place[rows[kept]]
        return PortActing(
            self.term, _where(kept.tolist()), {name: value[here] for name, value in self.values.items()}, self.own
        )


@dataclass(frozen=True)
class SignalActing:
    """A term on a whole signal, the sets `where` it acts and its parameters (k, 1) there."""

    term: SignalTerm
    where: Where
    values: Arrays


class Named(dict[str, FloatArray]):
    """Parameters by name; asked for another it raises UserError with the nearest."""

    def __missing__(self, name: str) -> FloatArray:
        """Raise UserError: there is no such parameter."""
        raise unknown_name(f"parameter {name}", name, self)


@dataclass(frozen=True)
class Batch:
    """What k predictions side by side are made from: samples `step_s` apart, inputs (i, k, n) and parameters (k,).

    `at_ports` are the terms that act, with `memory` states of their own together. `leaders` (k,) tell which set's
    prediction each is near to, its own where none is; `solved` keeps trajectories of `sets` of parameters.
    """

    step_s: float
    inputs: FloatArray
    values: Named
    ports: tuple[Port, ...]
    at_ports: tuple[PortActing, ...]
    memory: int
    leaders: IntArray
    sets: tuple[Values, ...]
    solved: Trajectories

    @property
    def shape(self) -> tuple[int, int]:
        """Return k and n."""
        return self.inputs.shape[1], self.inputs.shape[2]

    @property
    def whole_values(self) -> Named:
        """Return the parameters as (k, 1), for whole signals."""
        return Named({name: value[:, None] for name, value in self.values.items()})

    def only(self, rows: IntArray) -> "Batch":
        """Return the batch of some of the sets, each its own leader; all terms keep their states."""
        found = [each.only(rows, self.shape[0]) for each in self.at_ports]
        return Batch(
            self.step_s,
            self.inputs[:, rows],
            Named({name: value[rows] for name, value in self.values.items()}),
            self.ports,
            tuple(each for each in found if each is not None),
            self.memory,
            np.arange(len(rows)),
            tuple(self.sets[row] for row in rows),
            self.solved,
        )

    @property
    def layout(self) -> tuple[object, ...]:
        """Return what tells whose states of their own lie where: how many there are, and of each effect the first."""
        return self.memory, *((each.term.effect.name, each.own.start) for each in self.at_ports if each.term.memory)


def at_ports(terms: Sequence[Term], sets: Sequence[Values]) -> tuple[tuple[PortActing, ...], int]:
    """Return what acts at ports in some of the `sets` of parameters, and how many states of their own these have."""
    found: list[PortActing] = []
    memory = 0
    for term in terms:
        if isinstance(term, PortTerm) and (rows := _rows(term.effect, sets)):
            own = slice(memory, memory + term.memory)
            found.append(PortActing(term, _where(rows), _values(term.effect, sets, rows), own))
            memory = own.stop
    return tuple(found), memory


def on_signals(terms: Sequence[Term], side: str, sets: Sequence[Values]) -> list[SignalActing]:
    """Return what acts on the inputs or outputs in some of the `sets` of parameters."""
    found: list[SignalActing] = []
    for term in terms:
        if isinstance(term, SignalTerm) and term.side == side and (rows := _rows(term.effect, sets)):
            values = {name: value[:, None] for name, value in _values(term.effect, sets, rows).items()}
            found.append(SignalActing(term, _where(rows), values))
    return found


def leaders(sets: Sequence[Values]) -> IntArray:
    """Return for each of the `sets` the first that differs from it in so few parameters that one prediction is near to
    the other, itself where there is none (k,).
    """
    found: list[int] = []
    for k, values in enumerate(sets):
        near = (j for j in dict.fromkeys(found) if len(dict(values.items() ^ sets[j].items())) <= _MOST_APART)
        found.append(next(near, k))
    return np.array(found)


def _rows(effect: Effect, sets: Sequence[Values]) -> list[int]:
    """Return in which of the sets a parameter of an effect differs from neutral."""
    keys = [(effect.qualified(p.name), p.neutral) for p in effect.parameters]
    return [k for k, values in enumerate(sets) if any(values.get(key, neutral) != neutral for key, neutral in keys)]


def _values(effect: Effect, sets: Sequence[Values], rows: Sequence[int]) -> dict[str, FloatArray]:
    return {
        p.name: np.array([sets[k].get(effect.qualified(p.name), p.neutral) for k in rows]) for p in effect.parameters
    }


def _where(rows: list[int]) -> Where:
    return slice(rows[0], rows[-1] + 1) if rows[-1] - rows[0] + 1 == len(rows) else np.array(rows)


class PortActs:
    """What a model calls at its ports: adds up the terms there, and notes their own states' rates.

    `own` and `rates` (memory, ...) are set and read by whoever integrates; what is added is of `shape`, (k,) or (k, n).
    While it `begins`, terms with memory set their own states.
    """

    def __init__(self, batch: Batch, shape: tuple[int, ...]) -> None:
        self._shape = shape
        self.begins = False
        self.own = self.rates = np.zeros((batch.memory, *shape))
        self._count = {port.name: len(port.signals) for port in batch.ports}
        self._at: dict[str, list[tuple[PortActing, Arrays]]] = {port.name: [] for port in batch.ports}
        self._from: dict[str, list[tuple[PortActing, Arrays, Elsewhere]]] = {port.name: [] for port in batch.ports}
        self._seen: dict[str, tuple[FloatArray, ...]] = {}
        self._early = False
        trail = (1,) * (len(shape) - 1)
        for each in batch.at_ports:
            values = {name: value.reshape(value.shape + trail) for name, value in each.values.items()}
            self._at[each.term.port].append((each, values))
            for port, formula in each.term.elsewhere.items():
                self._from[port].append((each, values, formula))

    def asked(self, equation: Callable[[], T]) -> T:
        """Return what an equation gives that asks here; it is asked again where a term adds at one port what follows
        from the signals of another that was asked later.
        """
        self._seen, self._early = {}, False
        found = equation()
        return equation() if self._early else found

    def __call__(self, port: str, *signals: FloatArray) -> FloatArray:
        """Return what the terms at a port add; raises UserError for an unknown one or another number of signals."""
        check_port(self._count, port, signals)
        self._seen[port] = signals
        total = np.zeros(self._shape)
        for each, values, formula in self._from[port]:
            if each.term.port not in self._seen:
                self._early = True
                continue
            there = [self._of(signal, each.where) for signal in self._seen[each.term.port]]
            total[each.where] += formula(there, values)
        for each, values in self._at[port]:
            here = [self._of(signal, each.where) for signal in signals]
            if self.begins and each.term.begun is not None:
                self.own[each.own, each.where] = each.term.begun(here, values)
            added, rates = each.term.formula(here, self.own[each.own, each.where], values)
            total[each.where] += added
            for row, rate in enumerate(rates, each.own.start):
                self.rates[row, each.where] = rate
        return total

    def _of(self, signal: FloatArray, where: Where) -> FloatArray:
        here: FloatArray = signal if np.shape(signal) == self._shape else np.broadcast_to(signal, self._shape)
        return here[where]


class OpenActs(PortActs):
    """What a model of whole signals (k, n) calls at its ports: a term with memory follows the signals as they are,
    held from sample to sample.
    """

    def __init__(self, batch: Batch) -> None:
        super().__init__(batch, batch.shape)
        self._step_s = batch.step_s

    def __call__(self, port: str, *signals: FloatArray) -> FloatArray:
        """Return what the terms at a port add; raises UserError for an unknown one or another number of signals."""
        check_port(self._count, port, signals)
        for each, _ in self._at[port]:
            if each.term.memory:
                here = [self._of(signal, each.where) for signal in signals]
                self.own[each.own, each.where] = self._followed(each, here, each.values)
        return super().__call__(port, *signals)

    def _followed(self, each: PortActing, signals: Rows, values: Arrays) -> FloatArray:
        """Return a term's own states (memory, k, n) by Heun's method."""
        k, n = signals[0].shape
        path = np.zeros((each.term.memory, k, n))
        if each.term.begun is not None:
            path[:, :, 0] = each.term.begun([s[:, 0] for s in signals], values)
        for i in range(n - 1):
            now, then = [s[:, i] for s in signals], [s[:, i + 1] for s in signals]
            x = path[:, :, i]
            first = np.array(each.term.formula(now, x, values)[1])
            second = np.array(each.term.formula(then, x + self._step_s * first, values)[1])
            path[:, :, i + 1] = x + 0.5 * self._step_s * (first + second)
        return path


def check_port(count: Mapping[str, int], port: str, signals: Sequence[object]) -> None:
    """Raise UserError where a model calls a port that it has not declared, or with another number of signals."""
    if port not in count:
        raise unknown_name(f"act: port {port}", port, count)
    if len(signals) != count[port]:
        raise UserError(f"act: port {port}: {len(signals)} signals; expected the {count[port]} that it declares")
