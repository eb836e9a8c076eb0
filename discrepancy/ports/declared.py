"""Where something may act in a simulation, and what acts there: ports, and terms in the units of the system.

A port is a place inside a model where a force, torque, flow or any additive signal may be missing. The model asks there
what is to be added, and hands over the signals at hand: `force + act("joint", angle, rate)`. Every input and every
output is a place too, without being declared: what changes there is the whole signal, actuator or sensor.

All functions work on arrays of one shape by plain arithmetic: (k,) where k sets of parameters are integrated side by
side, (k, n) where whole signals are at hand. A parameter comes as (k,) or (k, 1), so that it broadcasts.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

from discrepancy.simulation import Channels, Effect
from messages.arrays import FloatArray
from messages.errors import UserError

Role = Literal["position", "velocity", "acceleration", "level", "input", "output", "other"]
"""What a signal is to a formula: friction needs a velocity, a spring a position, an overflow a level."""
Side = Literal["input", "output"]
Arrays = Mapping[str, FloatArray]
"""Parameters by name, each (k,) or (k, 1)."""
Rows = FloatArray | Sequence[FloatArray]
"""Signals, states or inputs, as many rows, each (k,) or (k, n)."""
PortFormula = Callable[[Rows, Rows, Arrays], tuple[FloatArray, Rows]]
"""From the port's signals, the term's own states and its parameters: what is added, and the own states' rates."""
Elsewhere = Callable[[Rows, Arrays], FloatArray]
"""From the signals of a term's own port and its parameters: what it adds at another port."""
Beginning = Callable[[Rows, Arrays], Rows]
"""From the port's signals at the first sample and the term's parameters: its own states there."""
SignalFormula = Callable[[Rows, Channels, Arrays], FloatArray]
"""From all signals (k, n) of the side, what was measured, and the parameters (k, 1): the changed signal, (k, n)."""


@dataclass(frozen=True)
class Signal:
    """A signal at hand: its name, unit, and what it is to a formula."""

    name: str
    unit: str
    role: Role = "other"


@dataclass(frozen=True)
class Port:
    """A place inside a model where something in `unit` may be missing; `words` tell a person where that is.

    The model hands over the `signals` in this order. Raises UserError where the name is more than letters, digits and
    underscores, as it becomes part of the effects' names.
    """

    name: str
    unit: str
    words: str
    signals: tuple[Signal, ...] = ()

    def __post_init__(self) -> None:
        if not self.name.isidentifier():
            raise UserError(f"port {self.name!r}: expected a name of letters, digits and underscores")

    def place(self, role: Role) -> int | None:
        """Return which of the signals is the first of a role, None if there is none."""
        return next((k for k, signal in enumerate(self.signals) if signal.role == role), None)


class Act(Protocol):
    """What a model calls at its ports."""

    def __call__(self, port: str, *signals: FloatArray) -> FloatArray:
        """Return what is to be added at a port; raises UserError for an unknown one, or another number of signals."""


@dataclass(frozen=True)
class PortTerm:
    """An effect at a port: `formula` gives what it adds from the signals there, from `memory` states of its own and
    from the effect's parameters by their own names. Its states begin at zero, or as `begun` tells.

    `elsewhere` gives what it adds at other ports, by their names, from the same signals. It is asked only where a
    parameter differs from neutral.
    """

    port: str
    effect: Effect
    formula: PortFormula
    memory: int = 0
    begun: Beginning | None = None
    elsewhere: Mapping[str, Elsewhere] = field(default_factory=dict)


@dataclass(frozen=True)
class SignalTerm:
    """An effect on the whole of one input (`side` input) or of one output, `channel` by its name."""

    side: Side
    channel: str
    effect: Effect
    formula: SignalFormula


Term = PortTerm | SignalTerm
