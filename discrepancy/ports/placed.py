"""Terms of the generic library made at their places: named by the place, and told to a person with its words."""

from collections.abc import Mapping
from dataclasses import replace

from discrepancy.ports.declared import (
    Arrays,
    Beginning,
    Elsewhere,
    PortFormula,
    PortTerm,
    Rows,
    Side,
    SignalFormula,
    SignalTerm,
)
from discrepancy.ports.ranges import PortSpan
from discrepancy.simulation import Effect, Parameter, Values
from messages.arrays import FloatArray

_MATTERS = 0.02
"""Of a parameter's scale: less is of no matter to anybody, however surely it is there."""
_DIFFERS = 0.05
"""Likewise, at a port: the step of differentiation. A prediction may bend over the whole scale, and the model that is
integrated is exact to far less.
"""


def at_port(
    span: PortSpan,
    name: str,
    formula: PortFormula,
    parameters: tuple[Parameter, ...],
    explanation: str,
    remedy: str,
    experiment: str,
    *,
    choices: tuple[tuple[str, ...], ...] = (),
    starts: tuple[Values, ...] = (),
    memory: int = 0,
    begun: Beginning | None = None,
    elsewhere: Mapping[str, Elsewhere] | None = None,
) -> PortTerm:
    """Return a term at a port, whose formula tells what drives its signals up: a port may count the other way."""
    port = span.port
    told = _told(f"At {port.words}", explanation)
    smooth = tuple(replace(each, step=_DIFFERS * each.scale) for each in _sized(parameters))
    effect = Effect(f"{name}_at_{port.name}", smooth, told, remedy, experiment, choices, starts)
    return PortTerm(
        port.name, effect, formula if span.along > 0.0 else _reversed(formula), memory, begun, elsewhere or {}
    )


def _reversed(formula: PortFormula) -> PortFormula:
    def acting(signals: Rows, own: Rows, values: Arrays) -> tuple[FloatArray, Rows]:
        added, rates = formula(signals, own, values)
        return -added, rates

    return acting


def on_signal(
    side: Side,
    channel: str,
    name: str,
    formula: SignalFormula,
    parameters: tuple[Parameter, ...],
    explanation: str,
    remedy: str,
    experiment: str,
    *,
    choices: tuple[tuple[str, ...], ...] = (),
    starts: tuple[Values, ...] = (),
) -> SignalTerm:
    """Return a term on a whole input or output."""
    told = _told(f"{channel} ({'measured' if side == 'output' else 'input'})", explanation)
    effect = Effect(f"{name}_of_{channel}", _sized(parameters), told, remedy, experiment, choices, starts)
    return SignalTerm(side, channel, effect, formula)


def _sized(parameters: tuple[Parameter, ...]) -> tuple[Parameter, ...]:
    """Return parameters that matter where they are far smaller than the scale that they are fitted in."""
    return tuple(replace(each, matters=_MATTERS * each.scale) for each in parameters)


def _told(where: str, explanation: str) -> str:
    """Return a sentence that begins with where it holds."""
    return f"{where}: {explanation[0].lower()}{explanation[1:]}"
