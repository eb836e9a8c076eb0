"""Sizes and units of what effects may add at their places, from what a recording spans."""

from discrepancy.simulation import Parameter

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
