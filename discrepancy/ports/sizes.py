"""What the effects at all places share: sizes from what a recording spans, names from their places."""

from discrepancy.ports.declared import Port, Side
from discrepancy.simulation import Effect, Parameter, Values

SHARE = 0.005
"""Of what moves a system as much as it moves: a smaller effect is of no matter to anybody."""
MOST = 5.0
"""Likewise: a larger effect would be seen without any search."""


def half(name: str, unit: str, size: float) -> Parameter:
    """Return a parameter that is never negative, of what can be as large as `size` and more."""
    return Parameter(name, unit, 0.0, 0.0, MOST * size, SHARE * size)


def both(name: str, unit: str, size: float) -> Parameter:
    """Return a parameter of either sign, of what can be as large as `size` and more."""
    return Parameter(name, unit, 0.0, -MOST * size, MOST * size, SHARE * size)


def over(unit: str, other: str) -> str:
    """Return the unit of one over another."""
    return f"{unit}/({other})" if any(sign in other for sign in "/ *") else f"{unit}/{other}"


def at_port(
    port: Port,
    name: str,
    parameters: tuple[Parameter, ...],
    explanation: str,
    remedy: str,
    experiment: str,
    *,
    choices: tuple[tuple[str, ...], ...] = (),
    starts: tuple[Values, ...] = (),
) -> Effect:
    """Return an effect at a port, named by it and told with its words."""
    told = f"At {port.words}: {explanation[0].lower()}{explanation[1:]}"
    return Effect(f"{name}_at_{port.name}", parameters, told, remedy, experiment, choices, starts)


def on_signal(
    side: Side,
    channel: str,
    name: str,
    parameters: tuple[Parameter, ...],
    explanation: str,
    remedy: str,
    experiment: str,
    *,
    choices: tuple[tuple[str, ...], ...] = (),
    starts: tuple[Values, ...] = (),
) -> Effect:
    """Return an effect on an input or output, named by it."""
    told = f"{channel} ({'measured' if side == 'output' else 'input'}): {explanation[0].lower()}{explanation[1:]}"
    return Effect(f"{name}_of_{channel}", parameters, told, remedy, experiment, choices, starts)
